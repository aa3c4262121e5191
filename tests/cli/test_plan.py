import csv
import re

import numpy as np
import pytest

from cablecast.cli import main

CONTROL_DT = 1 / 125
ANGLE_ROUNDING = 1e-8  # The file holds nine decimals [rad].
# Central differences of positions at 125 Hz against the speeds beside them: the jerk bound of
# 100 rad/s³ makes them differ by up to jerk dt² / 6, about 1e-3 rad/s; twice that for the wrist.
SPEED_DIFFERENCE = 5e-3


def plan(model_folder, capsys, *target):
    assert main(["plan", "--model", str(model_folder), "--target", *target]) == 0
    return capsys.readouterr().out


def angles(text, name):
    return float(re.search(rf"{name} = (-?[\d.]+) deg", text).group(1))


def test_a_plan_names_action_landing_duration_and_joint_speeds(model_folder, capsys):
    text = plan(model_folder, capsys, "1.10", "16.7")
    assert "r = 1.100 m, theta = 16.7 deg" in text
    for word in ("theta1 =", "theta2 =", "r2 =", "psi =", "predicted", "duration", "q1", "q6"):
        assert word in text


def test_the_mirrored_target_gives_the_mirrored_action(model_folder, capsys):
    right = plan(model_folder, capsys, "1.0", "20")
    left = plan(model_folder, capsys, "1.0", "-20")
    for name in ("theta1", "theta2", "psi"):
        assert angles(left, name) == -angles(right, name)


def test_a_target_that_no_cast_reaches_is_planned_with_a_note(model_folder, capsys):
    assert "no simulated cast" in plan(model_folder, capsys, "0.05", "0")


def test_a_saved_motion_holds_positions_and_their_speeds_at_125_hz(model_folder, tmp_path, capsys):
    file = tmp_path / "motion.csv"
    plan(model_folder, capsys, "1.0", "20", "--save", str(file))
    with open(file, newline="") as lines:
        rows = list(csv.reader(lines))
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


@pytest.mark.parametrize("option", [["--cable", "cable_1"], []], ids=["named", "not named"])
def test_the_cable_may_be_named_or_not(option, model_folder, capsys):
    text = plan(model_folder, capsys, "1.0", "10", *option)
    assert "cable_1, 0.62 m" in text
