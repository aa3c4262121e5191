"""The public face: names, lazily, each with one path."""

import json
import subprocess
import sys
import typing

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


class OwnRig(cc.RigLifecycle):
    description: typing.ClassVar[dict] = {}

    def execute(self, trajectory):
        raise NotImplementedError


MISTAKES = {
    "tune('runs/cable_1/tune-data')": "casts must be Dataset, not str 'runs",
    "collect('virtual')": "rig must be CheckedRig, not str 'virtual'",
    "collect(OwnRig())": "rig must be CheckedRig, not OwnRig",
    "repeat('virtual')": "rig must be CheckedRig",
    "simulate('cable_1')": "setup must be Setup",
    "simulate(SETUP, 'runs/cable_1/tune')": "tuned must be Tuned or CableParams, not str",
    "train('runs/cable_1/dataset')": "simulated must be Dataset",
    "evaluate('runs/cable_1/model', 'virtual')": "must be (Policy|CheckedRig), not str",
    "plan_motion('model', r=1.0, theta_deg=5.0)": "policy must be Policy, not str 'model'",
    "select('lab.yaml')": "setup must be Setup, not str 'lab.yaml'",
    "check('lab.yaml')": "setup must be Setup, not str 'lab.yaml'",
    "prepare_aim('virtual')": "rig must be CheckedRig",
    "aim('runs/cable_1/aim', 'virtual', r=1.0, theta_deg=5.0)": "must be .*, not str",
    "track_video('film.mp4', 'lab.yaml')": "setup must be Setup",
    "reproduce('runs', budget='quick')": "budget must be Budget",
    "EngineWarp('cpu')": "segment_count = 'cpu' is not a whole number",
    "make_rig('virtual:5:1', SETUP)": "unknown rig 'virtual:5:1': one of virtual, virtual:LAB",
    "Action(-40.0, 40.0, 0.7)": r"theta1\| = 2292 deg is outside",
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_in_python_is_answered_by_what_to_give_instead(mistake):
    pytest.importorskip("torch")
    names = {"SETUP": cc.Setup(), "OwnRig": OwnRig}
    names |= {name: getattr(cc, name) for name in cc.__all__}
    with pytest.raises(cc.CablecastError, match=MISTAKES[mistake]) as caught:
        eval(mistake, names)
    assert "\n" not in str(caught.value)
