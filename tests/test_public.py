"""The public face: names, lazily, each with one path."""

import json
import subprocess
import sys

import pytest

import cablecast as cc

HEAVY = ("numpy", "scipy", "yaml", "torch", "warp", "mujoco", "pyarrow", "tyro")


def test_importing_the_package_imports_nothing_heavy():
    code = (
        f"import cablecast, json, sys; print(json.dumps([n for n in {HEAVY} if n in sys.modules]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == []


def test_every_public_name_is_there_and_says_what_it_is():
    for name in cc.__all__:
        value = getattr(cc, name)
        assert name == "__version__" or value.__doc__, name


def test_every_public_name_is_listed_once_and_sorted():
    names = [name for name in cc.__all__ if name != "__version__"]
    assert names == sorted(set(names))
    assert set(names) <= set(dir(cc))


def test_a_name_that_does_not_exist_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'Robot'"):
        _ = cc.Robot
