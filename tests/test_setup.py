import dataclasses
import json
import re

import numpy as np
import pytest
import yaml
from tests.robot import ROBOT

from cablecast.arm.robot import Obstacle
from cablecast.arm.ur import ArmUR
from cablecast.cable import load_cable
from cablecast.camera.settings import CameraSettings
from cablecast.errors import InputError, UnknownNameError
from cablecast.runs.folder import plain_settings
from cablecast.setup import MotionConfig, Setup, load_setup, save_setup, update_lab_file
from cablecast.workspace import Workspace

OTHER = Setup(
    cable="cable_2",
    workspace=Workspace(table_width=2.0, table_depth=1.2, table_yaw_deg=90.0, reset_y=0.55),
    arm=ArmUR(model="ur5e", base_yaw_deg=90.0, measured=True),
    motion=MotionConfig(v_max=1.2),
)
POST = Obstacle(start=(1.2, 1.0, 0.0), end=(1.2, 1.0, 2.0), radius=0.03)
REAL = Setup(robot=dataclasses.replace(ROBOT, obstacles=(POST,)), camera=CameraSettings(source="0"))


@pytest.mark.parametrize("setup", [Setup(), OTHER, REAL], ids=["default", "other", "real"])
def test_a_set_up_survives_its_dictionary_and_its_file(setup, tmp_path):
    assert Setup.from_dict(setup.to_dict()) == setup
    save_setup(setup, tmp_path / "lab.yaml")
    assert load_setup(tmp_path / "lab.yaml") == setup


def test_what_a_lab_file_leaves_out_takes_its_default(tmp_path):
    file = tmp_path / "lab.yaml"
    for text, setup in (("arm:\n  model: ur5e\n", Setup(arm=ArmUR(model="ur5e"))), ("{}", Setup())):
        file.write_text(text)
        assert load_setup(file) == setup
    with pytest.raises(UnknownNameError, match=r"there is no lab file .*none\.yaml"):
        load_setup(tmp_path / "none.yaml")


def test_the_cable_of_a_lab_file_may_lie_beside_it(tmp_path):
    cable = dataclasses.replace(load_cable("cable_1"), name="mine", length=0.7)
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(cable.to_dict()))
    (tmp_path / "lab.yaml").write_text("cable: mine.yaml\n")
    assert load_setup(tmp_path / "lab.yaml").cable == cable
    (tmp_path / "lab.yaml").write_text(yaml.safe_dump({"cable": cable.to_dict()}))
    assert load_setup(tmp_path / "lab.yaml").cable == cable


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("robots: {}\n", r"unknown keys \['robots'\]: known are"),
        ("robot: {}\n", r"robot lacks the keys \['address', 'box_high', 'box_low', 'payload_cog'"),
        ("camera: 7\n", "camera must be a mapping"),
        ("arm: {model: ur7}\n", "unknown arm model 'ur7': one of ur3, ur3e, ur5"),
        ("arm: {model: panda}\n", "for an arm of another maker give `file:` with its URDF"),
        ("arm: {model: UR5e}\n", "unknown arm model 'UR5e': write ur5e"),
        ("arm: {base_height: high}\n", "arm base_height = 'high' is not a number"),
        ("arm: {measured: 1}\n", "must be true or false"),
        ("arm: {limits: {velocity: [1, 2]}}\n", "velocity limits .* must be 6 numbers"),
        ("arm: [1]\n", "arm must be a mapping"),
        ("workspace: {table_yaw_deg: 45}\n", "table_yaw_deg = 45 deg is not a multiple of 90"),
        ("workspace: {table_depth: 0.7}\n", "may be at most 0.42 m long"),
        ("workspace: {reset_y: 0.95}\n", "beyond r_max"),
        ("workspace: {grip_height: 0.003}\n", "below the axis of the lying cable"),
        ("motion: {v_max: .nan}\n", "v_max = nan"),
        ("cable: cable_9\n", "unknown cable 'cable_9'"),
        ("cable: 7\n", "cable must be a mapping"),
        ("cable: {name: x}\n", "lacks the keys"),
        ("{length: 0.7, diameter: 0.01, mass: 0.05}\n", "this is a cable, not a laboratory"),
    ],
)
def test_a_lab_file_that_makes_no_sense_is_refused_with_its_name(tmp_path, text, words):
    file = tmp_path / "lab.yaml"
    file.write_text(text)
    with pytest.raises((InputError, UnknownNameError), match=words) as caught:
        load_setup(file)
    assert "\n" not in str(caught.value)
    assert str(file) in str(caught.value)


def test_a_cable_that_is_too_long_for_the_table_is_refused_with_the_bound():
    long = dataclasses.replace(load_cable("cable_1"), length=0.95)
    with pytest.raises(InputError, match=r"may be at most 0\.9 m long"):
        Setup(cable=long, workspace=Workspace())
    assert Setup(cable=long).workspace.reset_y == pytest.approx(0.44)
    narrow = Workspace(table_width=1.1, table_depth=1.8, table_yaw_deg=90.0)
    with pytest.raises(InputError, match=r"with table_yaw_deg = 0 the table is 1\.8 m deep"):
        Setup(cable=long, workspace=narrow)
    near = Workspace(reset_y=0.76)
    with pytest.raises(InputError, match=r"leave reset_y out, or set it to 0\.54 m at most"):
        Setup(cable=long, workspace=near)
    with pytest.raises(InputError, match=r"m long$"):
        Setup(cable=long, workspace=Workspace(table_width=1.2, table_depth=1.5))
    for deeper in (Workspace(table_depth=1.6), Workspace(table_yaw_deg=90.0)):
        assert Setup(cable=long, workspace=deeper).cable is long


def test_what_was_measured_and_how_to_reach_the_robot_do_not_change_what_was_done():
    measured = dataclasses.replace(Setup(), arm=ArmUR(measured=True))
    assert measured != Setup()
    assert measured.to_settings() == REAL.to_settings() == Setup().to_settings()
    assert hash(REAL) != hash(Setup())


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"address": "one two"}, "robot address = 'one two' is neither"),
        ({"payload_mass": 30.0}, r"robot payload_mass = 30 kg is outside \[0, 20\]"),
        ({"payload_cog": (0.0, 0.0)}, "must be three numbers"),
        ({"box_low": (*ROBOT.box_low[:2], ROBOT.box_high[2])}, "must be below box_high"),
        ({"seen_safe": "yes"}, "must be true or false"),
        ({"obstacles": (1,)}, "must be at most 20 capsules"),
    ],
)
def test_a_robot_that_makes_no_sense_is_refused_with_the_value(changes, words):
    with pytest.raises(InputError, match=words):
        dataclasses.replace(ROBOT, **changes)


def test_only_this_computer_counts_as_a_twin():
    assert ROBOT.is_loopback
    assert not dataclasses.replace(ROBOT, address="192.168.0.10").is_loopback


def test_a_section_is_added_written_out_or_filled(tmp_path):
    file = tmp_path / "lab.yaml"
    file.write_text("# mine\ncable: cable_2\n")
    update_lab_file(file, {"camera": {"source": "0", "row_time": 1e-05}})
    assert file.read_text().startswith("# mine\ncable: cable_2\ncamera:\n")
    assert load_setup(file).camera == CameraSettings(source="0", row_time=1e-5)
    file.write_text("camera: {source: 0, rate: 30}\narm: {model: ur5e}\n")
    update_lab_file(file, {"camera": {"exposure": 0.002}, "arm": {"base_height": 0.1}})
    assert yaml.safe_load(file.read_text()) == {
        "camera": {"source": 0, "rate": 30, "exposure": 0.002},
        "arm": {"model": "ur5e", "base_height": 0.1},
    }
    for text in ("arm:\ncable: cable_2\n", "arm: {}\ncable: cable_2", "arm: ~\ncable: cable_2"):
        file.write_text(text)
        update_lab_file(file, {"arm": {"model": "ur5e", "base_height": 0.1}})
        setup = load_setup(file)
        assert (setup.arm.model, setup.arm.base_height) == ("ur5e", 0.1)
        assert setup.cable.name == "cable_2"


BY_HAND = """---
# my lab
cable:    cable_1     # the blue one
camera:   # a webcam
    source: "0"
    rate:   30.0        # mine
    tags:   # by tape
    - {id: 1, x: 0, y: 0}
    - {id: 2,  x: 0, y: 1}   # beside the door
    - {id: 3, x: 1.00, y: 0}
    - {id: 4, x: 1, y: 1}

arm:
  limits:
      velocity: [1, 1,
                 1, 1, 1, 1]
  base_height: 0.10   # by tape

# the end
"""


@pytest.mark.parametrize(
    ("old", "new", "change"),
    [
        ("30.0  ", "25.0  ", {"camera": {"rate": 25.0}}),
        ("0.10  ", "0.1795  ", {"arm": {"base_height": 0.1795}}),
        ("# by tape\n\n", "# by tape\n  model: ur5e\n\n", {"arm": {"model": "ur5e"}}),
        ('"0"', "rtsp://a.b/c?d=e#f", {"camera": {"source": "rtsp://a.b/c?d=e#f"}}),
        ('"0"', "'7'", {"camera": {"source": "7"}}),
    ],
)
def test_only_the_characters_of_a_value_change(tmp_path, old, new, change):
    file = tmp_path / "lab.yaml"
    file.write_text(BY_HAND)
    update_lab_file(file, change)
    assert file.read_text() == BY_HAND.replace(old, new, 1)
    load_setup(file)


def test_rows_replace_rows_at_their_indentation_and_comments_around_them_stay(tmp_path):
    file = tmp_path / "lab.yaml"
    file.write_text(BY_HAND)
    tags = [{"id": k, "x": k % 2, "y": k // 2} for k in range(4)]
    update_lab_file(file, {"camera": {"tags": tags}})
    rows = "".join(f"    - {{id: {k}, x: {k % 2}, y: {k // 2}}}\n" for k in range(4))
    before, after = BY_HAND.index("    - {id: 1"), BY_HAND.index("\narm:")
    assert file.read_text() == BY_HAND[:before] + rows + BY_HAND[after:]


def test_a_change_that_makes_no_sense_leaves_the_file_alone(tmp_path):
    file = tmp_path / "lab.yaml"
    file.write_text("arm: {model: ur5e}\n")
    with pytest.raises(InputError, match="base_height"):
        update_lab_file(file, {"arm": {"base_height": 99.0}})
    assert file.read_text() == "arm: {model: ur5e}\n"
    file.write_text("cable: cable_1\n")
    with pytest.raises(InputError, match=r"section `cable` .* must be a mapping"):
        update_lab_file(file, {"cable": {"length": 1.0}})
    assert file.read_text() == "cable: cable_1\n"
    with pytest.raises(InputError, match=re.escape("no file")):
        update_lab_file(tmp_path / "none.yaml", {})


def test_what_a_lab_file_leaves_out_follows_from_the_reset_position():
    setup = Setup.from_dict({"workspace": {"reset_y": 0.28}})
    assert setup.motion.r0 == setup.workspace.support_depth == 0.28
    assert Setup(workspace=Workspace(reset_y=0.28)).motion.r0 == 0.28
    assert Setup.from_dict({"workspace": {"reset_y": 0.28}, "motion": {"r0": 0.5}}).motion.r0 == 0.5
    assert Setup().motion.r0 == 0.6
    assert Setup().workspace.support_depth == 0.466
    with pytest.raises(InputError, match=r"support_depth = 0.466 m is beyond reset_y = 0.28 m"):
        Setup.from_dict({"workspace": {"reset_y": 0.28, "support_depth": 0.466}})


def test_what_the_file_does_not_say_follows_from_arm_table_and_cable():
    hose = {"name": "hose", "length": 0.9, "diameter": 0.005, "mass": 0.022, "kind": "hose"}
    small = {"table_width": 1.6, "table_depth": 1.2}
    setup = Setup.from_dict({"cable": hose, "workspace": small, "arm": {"model": "ur5e"}})
    # As near as the elbow allows, to leave the most room for the pull.
    assert setup.workspace.reset_y == setup.motion.r0 == pytest.approx(0.28)
    assert setup.workspace.support_depth == pytest.approx(0.28)
    thick = Setup.from_dict({"cable": {**hose, "diameter": 0.045}})
    assert thick.workspace.grip_height == pytest.approx(0.0275)
    long_arm = Setup(arm=ArmUR(model="ur10e"))
    pose = [0.0, 0.9, 0.02, 0.0, 0.0]
    reach = long_arm.arm.inverse_motion(pose, [0.0] * 5, [0.0] * 5).radius_max
    assert long_arm.workspace.r_max == pytest.approx(reach + long_arm.arm.grip_offset, abs=0.01)
    assert long_arm.workspace.reset_y > 0.75
    # What the file says stays.
    stated = Setup.from_dict({"arm": {"model": "ur10e"}, "workspace": {"r_max": 1.0}})
    assert (stated.workspace.r_max, stated.workspace.reset_y) == (1.0, pytest.approx(0.63))


@pytest.mark.parametrize(
    "values",
    [
        {"arm": {"model": "ur10"}, "workspace": {"reset_y": 1.0, "table_depth": 2.0}},
        {"workspace": {"r_max": 0.5}},
        {"arm": {"model": "ur10"}, "workspace": {"support_depth": 0.65, "table_depth": 2.0}},
    ],
    ids=["reset_y", "r_max", "support_depth"],
)
def test_one_value_of_the_workspace_is_held_against_what_follows_from_it(values):
    made = Setup.from_dict(values).workspace
    for name, value in values["workspace"].items():
        assert getattr(made, name) == value
    assert made.support_depth <= made.reset_y <= made.r_max


def test_whole_numbers_and_those_of_numpy_are_the_same_settings(tmp_path):
    plain = Setup.from_dict({"workspace": {"table_width": 2.0}, "arm": {"base_yaw_deg": 0.0}})
    whole = Setup.from_dict({"workspace": {"table_width": 2}, "arm": {"base_yaw_deg": 0}})
    assert json.dumps(plain.to_settings()) == json.dumps(whole.to_settings())
    save_setup(Setup().with_motion(v_max=np.float64(1.2)), tmp_path / "lab.yaml")
    assert load_setup(tmp_path / "lab.yaml").motion.v_max == 1.2
    assert plain_settings({"seed": np.int64(3), "share": np.float32(0.5)}) == {
        "seed": 3,
        "share": 0.5,
    }


def test_the_reset_lies_on_a_table_that_begins_far_from_the_base():
    setup = Setup.from_dict({"workspace": {"table_near_y": 0.7}})
    assert setup.workspace.reset_y == 0.7
    with pytest.raises(InputError, match=r"reset_y = 0\.6 m lies before the table's near edge"):
        Setup.from_dict({"workspace": {"table_near_y": 0.7, "reset_y": 0.6}})
