import csv
import pathlib

import numpy as np
import pytest

from cablecast.arm.ur import ArmUR
from cablecast.cli import main
from cablecast.setup import Setup, save_setup

CONTROL_DT = 1 / 125
ANGLE_ROUNDING = 1e-8  # The file holds nine decimals [rad].
# Central differences of positions at 125 Hz against the speeds beside them: the jerk bound of
# 100 rad/s³ makes them differ by up to jerk dt² / 6, about 1e-3 rad/s; twice that for the wrist.
SPEED_DIFFERENCE = 5e-3


def plan(model_folder, capsys, *target, status=0):
    # The model knows too little to plan well: how far off a plan is has a test of its own.
    arguments = ["--model", str(model_folder), "--miss-max", "200", "--target", *target]
    assert main(["plan", *arguments]) == status
    return capsys.readouterr().out


def measured_lab(folder, **arm):
    """Return a lab file whose arm a person has measured."""
    setup = Setup(arm=ArmUR(measured=True, **arm))
    save_setup(setup, folder / "lab.yaml")
    return folder / "lab.yaml"


def test_a_target_may_be_given_in_x_and_y(model_folder, capsys):
    arguments = ["plan", "--model", str(model_folder), "--miss-max", "200"]
    assert main([*arguments, "--target-xy", "-0.3", "0.9"]) == 0
    text = capsys.readouterr().out
    assert "theta = -18.4 deg (x = -0.300 m, y = 0.900 m)" in text
    assert main(arguments) == 2
    assert "--target R THETA or --target-xy X Y" in capsys.readouterr().err
    assert main([*arguments, "--target-xy", "0", "1", "--target", "1", "9"]) == 2
    assert "2 targets are given: it takes 1" in capsys.readouterr().err


def test_a_plan_names_action_landing_duration_and_joint_speeds(model_folder, capsys):
    text = plan(model_folder, capsys, "1.10", "16.7", "--cable", "cable_1")
    assert "cable_1, 0.62 m" in text
    assert "r = 1.100 m, theta = 16.7 deg" in text
    for word in ("theta1 =", "theta2 =", "r2 =", "psi =", "predicted", "duration", "q1", "q6"):
        assert word in text


def test_a_saved_motion_holds_positions_and_their_speeds_at_125_hz(model_folder, tmp_path, capsys):
    file = tmp_path / "motion.csv"
    lab = measured_lab(tmp_path)
    plan(model_folder, capsys, "1.0", "20", "--save", str(file), "--setup", str(lab))
    lines = file.read_text().splitlines()
    # The header says what the joint angles hold for.
    header = "\n".join(line for line in lines if line.startswith("#"))
    for words in ("ur5", "base 0.183 m above", "0.17 m from flange", "grip: 0.02 m"):
        assert words in header
    rows = list(csv.reader(line for line in lines if not line.startswith("#")))
    joints = range(1, 7)
    assert rows[0] == ["t", *(f"q{k}" for k in joints), *(f"qd{k}" for k in joints)]
    values = np.array(rows[1:], dtype=float)
    t, q, qd = values[:, 0], values[:, 1:7], values[:, 7:]
    np.testing.assert_allclose(np.diff(t), CONTROL_DT, atol=1e-6)
    np.testing.assert_allclose(qd[[0, -1]], 0.0, atol=ANGLE_ROUNDING)
    differences = (q[2:] - q[:-2]) / (2 * CONTROL_DT)
    np.testing.assert_allclose(differences, qd[1:-1], atol=SPEED_DIFFERENCE)


def test_the_model_of_a_cable_is_found_where_train_puts_it(model_folder, capsys, in_new_folder):
    place = in_new_folder / "runs" / "cable_1"
    place.mkdir(parents=True)
    (place / "model").symlink_to(model_folder)
    assert main(["plan", "--target", "1.0", "10"]) == 0
    assert "cable_1" in capsys.readouterr().out


def test_a_motion_is_saved_only_for_an_arm_that_was_measured(model_folder, tmp_path, capsys):
    file = tmp_path / "motion.csv"
    arguments = ["plan", "--model", str(model_folder), "--target", "1.0", "20", "--save", str(file)]
    assert main(arguments) == 2
    assert "measured: true" in capsys.readouterr().err
    # A gripper that is 3 cm longer would be driven into the table by the same angles.
    lab = measured_lab(tmp_path, gripper_length=0.2)
    assert main([*arguments, "--setup", str(lab)]) == 2
    assert "arm.gripper_length is 0.17 there and 0.2 here" in capsys.readouterr().err
    assert not file.exists()


def test_a_plan_that_misses_by_more_than_the_bound_has_its_own_exit_status(model_folder, capsys):
    arguments = ["plan", "--model", str(model_folder), "--target", "0.05", "0"]
    assert main([*arguments, "--miss-max", "5"]) == 3
    said = capsys.readouterr().out
    assert "above --miss-max 5 %" in said
    assert "no simulated cast" in said
    assert main([*arguments, "--miss-max", "1000"]) == 0


@pytest.mark.parametrize("kind", ["device", "link", "folder"])
def test_only_a_regular_file_is_ever_replaced(kind, model_folder, tmp_path, capsys):
    lab, target = measured_lab(tmp_path), tmp_path / "precious"
    path = tmp_path / "there"
    target.write_text("precious")
    if kind == "device":
        path = pathlib.Path("/dev/null")
    elif kind == "link":
        path.symlink_to(target)
    else:
        path.mkdir()
    arguments = ["--model", str(model_folder), "--target", "1.0", "20", "--setup", str(lab)]
    assert main(["plan", *arguments, "--save", str(path), "--force"]) == 2
    assert "is no regular file" in capsys.readouterr().err
    assert target.read_text() == "precious"
