import sys

import pytest

from cablecast.errors import MissingExtraError, RigError
from cablecast.rigs.base import make_rig
from cablecast.rigs.engine import RigEngine

MODULE = """
import missing_library_of_a_rig
"""
FACTORIES = """
from cablecast.errors import InputError

number = 3


def nothing(cable, workspace, seed):
    return None


def half(cable, workspace, seed):
    class Half:
        description = {}

        def reset(self):
            pass

    return Half()


def fails(cable, workspace, seed):
    raise ValueError("no camera at /dev/video0\\nplug it in")


def refuses(cable, workspace, seed):
    raise InputError("seed = 1 is not what I want")


def takes_nothing():
    return None
"""


@pytest.fixture
def user_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rig_factories_of_a_user.py").write_text(FACTORIES)
    (tmp_path / "rig_broken_of_a_user.py").write_text(MODULE)
    yield tmp_path
    sys.modules.pop("rig_factories_of_a_user", None)


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("robot", ["'robot'", "virtual, engine, or package.module:factory"]),
        (":make", ["':make'"]),
        ("no_such_package.rig:make", ["no module 'no_such_package'"]),
        ("cablecast.no_such_rig:make", ["no module 'cablecast.no_such_rig'"]),
        ("rig_broken_of_a_user:make", ["cannot be imported", "missing_library_of_a_rig"]),
        ("rig_factories_of_a_user:make", ["rig_factories_of_a_user", "no factory 'make'"]),
        ("rig_factories_of_a_user:number", ["is a int"]),
        ("rig_factories_of_a_user:nothing", ["NoneType", "no Rig"]),
        ("rig_factories_of_a_user:half", ["lacks execute, close"]),
        ("rig_factories_of_a_user:fails", ["ValueError: no camera at /dev/video0 plug it in"]),
        ("rig_factories_of_a_user:takes_nothing", ["failed: TypeError"]),
    ],
)
def test_a_rig_that_cannot_be_made_is_refused_in_one_line(
    spec, words, user_folder, cable, workspace
):
    with pytest.raises(RigError) as caught:
        make_rig(spec, cable, workspace, 0)
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message


def test_a_refusal_of_the_factory_itself_is_passed_on(user_folder, cable, workspace):
    with pytest.raises(ValueError, match="seed = 1 is not what I want"):
        make_rig("rig_factories_of_a_user:refuses", cable, workspace, 0)


def test_looking_for_a_rig_leaves_the_import_path_as_it_was(user_folder, cable, workspace):
    before = list(sys.path)
    with pytest.raises(RigError):
        make_rig("rig_factories_of_a_user:nothing", cable, workspace, 0)
    assert sys.path == before


def test_the_named_rigs_can_be_made(cable, workspace):
    pytest.importorskip("mujoco")
    assert make_rig("virtual", cable, workspace, 5).description["seed"] == 5
    assert isinstance(make_rig("engine", cable, workspace, 0), RigEngine)


def test_without_mujoco_the_virtual_rig_says_what_to_install(monkeypatch, cable, workspace):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(MissingExtraError, match=r"cablecast\[mujoco\]"):
        make_rig("virtual", cable, workspace, 0)
