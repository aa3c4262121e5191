"""Changes to a lab file that leave the rest of it alone."""

import pathlib
import re

import pytest
import yaml

from cablecast.camera.tags import default_layout
from cablecast.errors import InputError
from cablecast.setup import load_setup, update_lab_file

EXAMPLE = pathlib.Path(__file__).parents[1] / "examples" / "lab.yaml"


def test_one_value_changes_and_every_other_line_stays(tmp_path):
    file = tmp_path / "lab.yaml"
    before = EXAMPLE.read_text()
    file.write_text(before)
    update_lab_file(file, {"arm": {"base_height": 0.1795, "base_yaw_deg": 12.5}})
    after = file.read_text()
    changed = [
        (a, b) for a, b in zip(before.splitlines(), after.splitlines(), strict=True) if a != b
    ]
    assert len(changed) == 2
    assert changed[0][1].startswith("  base_height: 0.1795")
    # What the person noted beside the value is still there.
    assert changed[0][1].endswith("# height of the robot's base above the table [m]")
    setup = load_setup(file)
    assert (setup.arm.base_height, setup.arm.base_yaw_deg) == (0.1795, 12.5)


def test_a_section_that_is_not_there_is_added(tmp_path):
    file = tmp_path / "lab.yaml"
    file.write_text("# mine\ncable: cable_2\n")
    update_lab_file(file, {"camera": {"source": "0", "row_time": 1e-05}})
    assert file.read_text().startswith("# mine\ncable: cable_2\ncamera:\n")
    camera = load_setup(file).camera
    assert camera is not None
    assert camera.row_time == 1e-5


def test_a_list_replaces_the_list_that_was_there(tmp_path):
    file = tmp_path / "lab.yaml"
    file.write_text(
        "camera:\n  source: 0\n  tags:\n  - {id: 1, x: 0, y: 0}\n  - {id: 2, x: 0, y: 1}\n"
        "  - {id: 3, x: 1, y: 0}\n  - {id: 4, x: 1, y: 1}\n  rate: 30.0  # mine\n\n# the arm\n"
        "arm:\n  model: ur5e\n"
    )
    update_lab_file(file, {"camera": {"tags": default_layout().to_rows()}})
    camera = load_setup(file).camera
    assert camera is not None
    assert camera.tags == default_layout()
    assert camera.rate == 30.0
    assert "  rate: 30.0  # mine\n\n# the arm\narm:\n  model: ur5e\n" in file.read_text()


def test_a_section_on_one_line_is_written_out(tmp_path):
    file = tmp_path / "lab.yaml"
    file.write_text("camera: {source: 0, rate: 30}\narm: {model: ur5e}\n")
    update_lab_file(file, {"camera": {"exposure": 0.002}, "arm": {"base_height": 0.1}})
    assert yaml.safe_load(file.read_text()) == {
        "camera": {"source": 0, "rate": 30, "exposure": 0.002},
        "arm": {"model": "ur5e", "base_height": 0.1},
    }


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


def test_a_section_without_keys_takes_them(tmp_path):
    file = tmp_path / "lab.yaml"
    for text in ("arm:\ncable: cable_2\n", "arm: {}\ncable: cable_2", "arm: ~\ncable: cable_2"):
        file.write_text(text)
        update_lab_file(file, {"arm": {"model": "ur5e", "base_height": 0.1}})
        setup = load_setup(file)
        assert (setup.arm.model, setup.arm.base_height) == ("ur5e", 0.1)
        assert setup.cable.name == "cable_2"


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
