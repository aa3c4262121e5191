import dataclasses

import pytest
import yaml

from cablecast.arm.robot import Obstacle, RobotConfig
from cablecast.arm.ur import ArmUR
from cablecast.cable import load_cable, save_cable
from cablecast.camera.settings import CameraSettings
from cablecast.errors import InputError, UnknownNameError
from cablecast.setup import MotionConfig, Setup, load_setup, save_setup
from cablecast.workspace import Workspace

OTHER = Setup(
    cable="cable_2",
    workspace=Workspace(table_width=2.0, table_depth=1.2, table_yaw_deg=90.0, reset_y=0.55),
    arm=ArmUR(model="ur5e", base_yaw_deg=90.0, measured=True),
    motion=MotionConfig(v_max=1.2),
)
ROBOT = RobotConfig(
    address="127.0.0.1",
    payload_mass=0.9,
    payload_cog=(0.0, 0.0, 0.05),
    box_low=(-1.0, 0.1, 0.0),
    box_high=(1.0, 1.0, 0.9),
    obstacles=(Obstacle(start=(1.2, 1.0, 0.0), end=(1.2, 1.0, 2.0), radius=0.03),),
)
REAL = Setup(robot=ROBOT, camera=CameraSettings(source="0"))


@pytest.mark.parametrize("setup", [Setup(), OTHER, REAL], ids=["default", "other", "real"])
def test_a_set_up_survives_its_dictionary_and_its_file(setup, tmp_path):
    assert Setup.from_dict(setup.to_dict()) == setup
    save_setup(setup, tmp_path / "lab.yaml")
    assert load_setup(tmp_path / "lab.yaml") == setup


def test_what_a_lab_file_leaves_out_takes_its_default(tmp_path):
    file = tmp_path / "lab.yaml"
    file.write_text("arm:\n  model: ur5e\n")
    assert load_setup(file) == Setup(arm=ArmUR(model="ur5e"))
    file.write_text("{}")
    assert load_setup(file) == Setup()


def test_the_cable_of_a_lab_file_may_lie_beside_it(tmp_path):
    cable = dataclasses.replace(load_cable("cable_1"), name="mine", length=0.7)
    save_cable(cable, tmp_path / "mine.yaml")
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
        ("arm: {base_height: high}\n", "arm base_height = 'high' is not a number"),
        ("arm: {measured: 1}\n", "must be true or false"),
        ("arm: {limits: {velocity: [1, 2]}}\n", "velocity limits .* must be six numbers"),
        ("arm: [1]\n", "arm must be a mapping"),
        ("workspace: {table_yaw_deg: 45}\n", "not a multiple of 90"),
        ("workspace: {table_depth: 1.0}\n", "may be at most 0.4 m long"),
        ("workspace: {reset_y: 0.95}\n", "beyond r_max"),
        ("workspace: {grip_height: 0.003}\n", "below the axis of the lying cable"),
        ("motion: {v_max: .nan}\n", "v_max = nan"),
        ("cable: cable_9\n", "unknown cable 'cable_9'"),
        ("cable: 7\n", "cable must be a mapping"),
        ("cable: {name: x}\n", "lacks the keys"),
    ],
)
def test_a_lab_file_that_makes_no_sense_is_refused_with_its_name(tmp_path, text, words):
    file = tmp_path / "lab.yaml"
    file.write_text(text)
    with pytest.raises((InputError, UnknownNameError), match=words) as caught:
        load_setup(file)
    assert "\n" not in str(caught.value)


def test_a_cable_that_is_too_long_for_the_table_is_refused_with_the_bound():
    long = dataclasses.replace(load_cable("cable_1"), length=0.95)
    with pytest.raises(InputError, match=r"may be at most 0\.9 m long"):
        Setup(cable=long)
    deeper = Workspace(table_depth=1.6)
    assert Setup(cable=long, workspace=deeper).workspace.y_max == 1.6


def test_parts_of_the_wrong_kind_are_refused():
    with pytest.raises(InputError, match="workspace must be a Workspace, not dict"):
        Setup(workspace={})  # pyright: ignore[reportArgumentType]


def test_whether_the_arm_was_measured_does_not_change_what_was_done():
    measured = dataclasses.replace(Setup(), arm=ArmUR(measured=True))
    assert measured != Setup()
    assert measured.to_settings() == Setup().to_settings()


def test_how_to_reach_robot_and_camera_does_not_change_what_was_done():
    assert REAL.to_settings() == Setup().to_settings()
    assert hash(REAL) != hash(Setup())


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"address": "one two"}, "robot address = 'one two' is neither"),
        ({"payload_mass": 30.0}, r"robot payload_mass = 30 kg is outside \[0, 20\]"),
        ({"payload_cog": (0.0, 0.0)}, "must be three numbers"),
        ({"box_low": (-1.0, 0.1, 0.9)}, "must be below box_high"),
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


def test_a_lab_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(UnknownNameError, match=r"there is no lab file .*none\.yaml"):
        load_setup(tmp_path / "none.yaml")
