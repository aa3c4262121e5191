"""Rigs made from names, factories and objects, and refusals of what is none."""

import dataclasses
import sys

import pytest

from cablecast.errors import InputError, MissingExtraError, RigError
from cablecast.rigs.base import RigLifecycle
from cablecast.rigs.checked import TIME_LIMIT, CheckedRig
from cablecast.rigs.engine import RigEngine, RigSwing
from cablecast.rigs.make import make_rig
from cablecast.setup import Setup, StrikeConfig

MODULE = """
import missing_library_of_a_rig
"""
FACTORIES = """
import dataclasses
import sys

from cablecast.errors import InputError

number = 3


def nothing(setup, seed):
    return None


def half(setup, seed):
    class Half:
        description = {}

        def reset(self):
            pass

    return Half()


def fails(setup, seed):
    raise ValueError("no camera at /dev/video0\\nplug it in")


def leaves(setup, seed):
    sys.exit("no robot")


def refuses(setup, seed):
    raise InputError("seed = 1 is not what I want")


def takes_nothing():
    return None


def of_an_earlier_version(cable, workspace, seed):
    return None
"""


def test_a_laboratory_is_given_by_its_number():
    pytest.importorskip("mujoco")
    from cablecast.rigs.virtual import VirtualConfig

    with make_rig("virtual:3", Setup()) as rig:
        described = rig.description["config"]
    assert described == dataclasses.asdict(VirtualConfig(lab_seed=3)) | {"without": []}


class Still(RigLifecycle):
    """A rig that is there and does nothing."""

    def __init__(self, setup=None, seed=0):
        super().__init__()
        self.description = {"rig": "still", "seed": seed}

    def execute(self, trajectory):
        raise NotImplementedError


@pytest.fixture
def user_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rig_factories_of_a_user.py").write_text(FACTORIES)
    (tmp_path / "rig_broken_of_a_user.py").write_text(MODULE)
    (tmp_path / "rig_leaving_of_a_user.py").write_text("import sys\nsys.exit(3)\n")
    yield tmp_path
    sys.modules.pop("rig_factories_of_a_user", None)


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("robot", ["'robot'", "virtual, virtual:LAB, engine, engine:NAME, ur, or"]),
        ("virtual:5:1", ["'virtual:5:1'", "virtual, virtual:LAB, engine"]),
        ("virtual:lab", ["'virtual:lab'", "virtual, virtual:LAB, engine"]),
        (":make", ["':make'"]),
        ("no_such_package.rig:make", ["no module 'no_such_package'"]),
        ("cablecast.no_such_rig:make", ["no module 'cablecast.no_such_rig'"]),
        ("rig_broken_of_a_user:make", ["cannot be imported", "missing_library_of_a_rig"]),
        ("rig_leaving_of_a_user:make", ["cannot be imported", "SystemExit: 3"]),
        ("rig_factories_of_a_user:make", ["rig_factories_of_a_user", "no factory 'make'"]),
        ("rig_factories_of_a_user:number", ["is a int"]),
        ("rig_factories_of_a_user:nothing", ["NoneType", "no rig"]),
        ("rig_factories_of_a_user:half", ["lacks execute, close"]),
        ("rig_factories_of_a_user:fails", ["ValueError: no camera at /dev/video0 plug it in"]),
        ("rig_factories_of_a_user:leaves", ["SystemExit: no robot"]),
        ("rig_factories_of_a_user:takes_nothing", ["takes ()", "must take (setup, seed)"]),
        ("rig_factories_of_a_user:of_an_earlier_version", ["must take (setup, seed)"]),
        (3, ["a int is no rig", "lacks reset, execute, close, description"]),
        (lambda setup, seed: 3, ["lambda", "returned a int"]),
    ],
    ids=lambda value: getattr(value, "__name__", str(value)),
)
def test_a_rig_that_cannot_be_made_is_refused_in_one_line(spec, words, user_folder, setup):
    with pytest.raises(RigError) as caught:
        make_rig(spec, setup)
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message


def test_a_refusal_of_the_factory_itself_is_passed_on(user_folder, setup):
    with pytest.raises(ValueError, match="seed = 1 is not what I want"):
        make_rig("rig_factories_of_a_user:refuses", setup)


def test_looking_for_a_rig_leaves_the_import_path_as_it_was(user_folder, setup):
    before = list(sys.path)
    with pytest.raises(RigError):
        make_rig("rig_factories_of_a_user:nothing", setup)
    assert sys.path == before


def test_the_named_rigs_can_be_made_and_are_checked(setup):
    pytest.importorskip("mujoco")
    virtual = make_rig("virtual", setup, 5)
    assert virtual.description["seed"] == 5
    engine = make_rig("engine", setup)
    assert isinstance(engine.rig, RigEngine)
    for rig in (virtual, engine):
        assert isinstance(rig, CheckedRig)
        assert rig.setup is setup
        assert rig.time_limit == TIME_LIMIT
        assert rig.execute_many is not None
    assert virtual.seek is not None
    assert engine.seek is None


def test_an_engine_that_swings_no_cable_in_the_air_is_refused_and_not_replaced(setup):
    strike = dataclasses.replace(setup, strike=StrikeConfig())
    assert isinstance(make_rig("engine:warp", strike).rig, RigSwing)
    with pytest.raises(RigError, match="--rig engine:mujoco swings no cable in the air"):
        make_rig("engine:mujoco", strike)


def test_an_object_or_a_factory_of_ones_own_is_taken_as_it_is(setup):
    rig = Still()
    made = make_rig(rig, setup, 3)
    assert (made.rig, made.setup) == (rig, setup)
    assert make_rig(Still, setup, 4).description == {"rig": "still", "seed": 4}
    assert made.seek is None
    assert made.execute_many is None


def test_a_rig_that_was_made_is_not_wrapped_again_nor_used_for_another_setup(setup):
    made = make_rig(Still(), setup)
    assert make_rig(made, Setup()) is made
    with pytest.raises(RigError, match="another set-up"):
        make_rig(made, Setup(cable="cable_2"))


def test_seeds_out_of_bounds_are_refused(setup):
    with pytest.raises(InputError, match="seed = -1"):
        make_rig(Still, setup, -1)


def test_without_mujoco_the_virtual_rig_says_what_to_install(monkeypatch, setup):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(MissingExtraError, match=r"cablecast\[mujoco\]"):
        make_rig("virtual", setup)
