"""Bad input: one line, status 2, no traceback, no cast or long work, and nothing overwritten."""

import dataclasses
import sys

import numpy as np
import pytest
import yaml
from tests.data.killed import contents

from cablecast.arm.ur import ArmUR
from cablecast.cable import load_cable
from cablecast.cli import main
from cablecast.cli.options import load_lab
from cablecast.pipeline.check import LabCheck
from cablecast.setup import Setup, load_setup, save_setup

HUGE = ("1000000000", "10000000000000000000000")


def refused(arguments, capsys) -> str:
    """Run the command line, check that it refuses in one line, and return the line."""
    try:
        status = main([str(argument) for argument in arguments])
    except SystemExit as error:
        status = error.code
    captured = capsys.readouterr()
    assert status == 2, captured.out + captured.err
    assert "Traceback" not in captured.err
    lines = [line for line in captured.err.splitlines() if line.startswith("cablecast: ")]
    # What the parser of the command line refuses it explains in a box of its own.
    assert len(lines) == 1 or "full helptext" in captured.err
    return lines[0] if lines else " ".join(captured.err.split())


def rows(verb, *tables):
    """Return one case per option and value, with the word that the refusal must hold."""
    return [
        pytest.param((verb, option, *value.split()), word, id=f"{verb} {option} {value[:12]}")
        for option, values, word in tables
        for value in values
    ]


@pytest.fixture
def needs(lab, model_folder, dataset_folder, casts_folder):
    """Return the options without which each verb does not start; all others need a rig."""
    return {
        "evaluate": ["--model", model_folder, *lab.rig],
        "train": ["--dataset", dataset_folder],
        "tune": ["--dataset", casts_folder],
        "track": ["file"],
        "simulate": [],
        "select": [],
        "aim": ["--paper-targets", *lab.rig],
    }


BAD_VALUES = [
    *rows(
        "simulate",
        ("--seed", ("-1", "4294967296"), "seed = "),
        ("--count", ("0", "-1", *HUGE), "count = "),
        ("--dt", ("nan", "inf", "0", "-1"), "dt = "),
        ("--r0", ("nan", "inf", "1e308"), "r0 = "),
        ("--v-max", ("nan", "-inf", "0"), "v_max = "),
        ("--segment-count", ("1", *HUGE), "segment_count = "),
    ),
    *rows(
        "select",
        ("--scatter-max", ("nan", "inf", "0"), "scatter_max_pct = "),
        ("--grid", ("0", *HUGE), "grid = "),
        ("--grid-psi", ("-1", *HUGE), "grid_psi = "),
    ),
    *rows(
        "plan",
        ("--target", ("nan 0", "1 inf", "-1 0", "1e308 0"), ""),
        ("--target 1 0 --miss-max", ("nan", "-1"), "miss_max = "),
    ),
    *rows(
        "track",
        ("file --view-deg", ("nan", "0", "180"), "view_deg = "),
        ("file --marker", ("nan 1", "0.01 inf"), "marker"),
        ("file --begin", ("inf 0", "0 nan"), "begin"),
        ("file --start", ("nan", "-1", "1e9"), "start = "),
    ),
]


@pytest.mark.parametrize(("words", "word"), BAD_VALUES)
def test_a_number_out_of_its_bounds_is_refused_by_name(words, word, lab, capsys, model_folder):
    arguments = " ".join(words).split()
    if words[0] == "plan":
        arguments += ["--model", str(model_folder)]
    assert word in refused(arguments, capsys)
    assert not (lab.path / "runs").exists()


@pytest.mark.parametrize("verb", ["train", "tune"])
def test_a_number_of_a_verb_that_reads_casts_is_refused_by_name(verb, lab, needs, capsys):
    tables = {
        "train": [("seed", "-1"), ("epochs", HUGE[0]), ("candidate-count", HUGE[1])],
        "tune": [
            *[("seed", "-1"), ("population-size", HUGE[0]), ("generations", HUGE[0])],
            *[("generations", "0"), ("validation-count", HUGE[1]), ("dt", "nan")],
        ],
    }
    for name, value in tables[verb]:
        line = refused([verb, *needs[verb], f"--{name}", value], capsys)
        assert name.replace("-", "_") in line
    assert not (lab.path / "runs").exists()


# Everything that can be known before a rig is connected, with the option at fault.
BEFORE_THE_RIG = [
    *rows(
        "collect",
        ("--seed", ("-1",), "seed = "),
        ("--count", ("0", *HUGE), "count = "),
        ("--time-limit", ("nan", "inf", "0", "-1"), "time_limit = "),
        ("--r0", ("nan",), "r0 = "),
        ("--v-max", ("inf",), "v_max = "),
        ("--out", ("file",), "is a file"),
        ("--out", ("file/below",), "file/below"),
        ("--out", ("foreign",), "thesis.tex"),
        ("--purpose", ("other",), "purpose"),
    ),
    *rows(
        "repeat",
        ("--seed", ("-1",), "seed = "),
        ("--repeats", ("1", *HUGE), "repeats = "),
        ("--action-count", ("0", *HUGE), "action_count = "),
        ("--time-limit", ("nan",), "time_limit = "),
        ("--r0", ("nan",), "r0 = "),
        ("--combinations", ("",), "combinations"),
        ("--actions", ("nowhere.csv",), "nowhere.csv"),
        ("--out", ("file",), "is a file"),
        ("--out", ("foreign",), "thesis.tex"),
    ),
    *rows(
        "evaluate",
        ("--seed", ("-1",), "seed = "),
        ("--repeats", ("0", *HUGE), "repeats = "),
        ("--time-limit", ("nan",), "time_limit = "),
        ("--device", ("cuda",), "cuda"),
        ("--device", ("tpu",), "device"),
        ("--out", ("file",), "is a file"),
        ("--out", ("foreign",), "thesis.tex"),
    ),
    *rows(
        "aim",
        ("--seed", ("-1",), "seed = "),
        ("--calibration-count", ("1", *HUGE), "calibration_count"),
        ("--simulated-count", ("1", *HUGE), "simulated_count = "),
        ("--epochs", ("0", *HUGE), "epochs = "),
        ("--candidate-count", ("0", *HUGE), "candidate_count = "),
        ("--device", ("cuda",), "cuda"),
        ("--params", ("nowhere.json",), "nowhere.json"),
        ("--out", ("file",), "is a file"),
        ("--out", ("file/below",), "file/below"),
        ("--out", ("foreign",), "thesis.tex"),
    ),
]


@pytest.mark.parametrize(("words", "word"), BEFORE_THE_RIG)
def test_what_can_be_known_is_refused_before_the_rig_is_connected(words, word, lab, needs, capsys):
    if "cuda" in words and _has_cuda():
        pytest.skip("a CUDA device is here")
    assert word in refused([*words, *needs.get(words[0], lab.rig)], capsys)
    assert lab.events == []
    assert not (lab.path / "runs").exists()
    assert [file.name for file in (lab.path / "foreign").iterdir()] == ["thesis.tex"]


def _has_cuda() -> bool:
    import torch

    return torch.cuda.is_available()


@pytest.mark.parametrize(
    ("verb", "module", "extra"),
    [
        ("repeat", "matplotlib", "report"),
        ("evaluate", "matplotlib", "report"),
        ("evaluate", "jinja2", "report"),
        ("aim", "torch", "learn"),
        ("aim", "safetensors", "learn"),
        ("aim", "jinja2", "report"),
        ("tune", "matplotlib", "report"),
        ("select", "shapely", "report"),
        ("train", "torch", "learn"),
        ("reproduce", "shapely", "report"),
        ("track", "cv2", "camera"),
    ],
)
def test_a_missing_extra_is_named_before_the_rig_is_connected(
    verb, module, extra, lab, needs, capsys, monkeypatch
):
    monkeypatch.setitem(sys.modules, module, None)
    assert f"cablecast[{extra}]" in refused([verb, *needs.get(verb, lab.rig)], capsys)
    assert lab.events == []
    assert not (lab.path / "runs").exists()


@pytest.mark.parametrize("verb", ["simulate", "select", "tune", "train", "reproduce"])
def test_a_device_that_is_not_here_is_refused_before_any_work(verb, lab, needs, capsys):
    if _has_cuda():
        pytest.skip("a CUDA device is here")
    arguments = [*needs.get(verb, lab.rig), "--device", "cuda"]
    assert "cuda" in refused([verb, *arguments], capsys)
    assert lab.events == []
    assert not (lab.path / "runs").exists()


# A table that holds cable 1 but not cable 3, and one on which a target of the paper lies beside it.
SMALL_TABLES = [
    ("reproduce", "{table_depth: 1.26, reset_y: 0.6}", "y = 0.6 to 1.27 m"),
    ("reproduce", "{table_width: 1.0, table_depth: 1.5}", "is off the table"),
    ("aim --paper-targets", "{table_width: 1.0, table_depth: 1.5}", "is off the table"),
]


@pytest.mark.parametrize(("verb", "table", "words"), SMALL_TABLES)
def test_what_the_last_step_cannot_do_is_refused_before_the_first(verb, table, words, lab, capsys):
    (lab.path / "lab.yaml").write_text(f"workspace: {table}")
    assert words in refused([*verb.split(), *lab.rig, "--setup", "lab.yaml"], capsys)
    assert lab.events == []
    assert not (lab.path / "runs").exists()


def test_a_target_that_no_believed_cable_reaches_is_a_miss_and_no_error(lab, capsys, monkeypatch):
    nowhere = np.zeros((6, 1, 2))
    found = LabCheck(setup=Setup(), landing_xy=nowhere, leaving_xy=nowhere[0])
    monkeypatch.setattr("cablecast.pipeline.check.check", lambda *_, **__: found)
    assert main(["aim", "--target", "1.05", "10", *lab.rig]) == 3
    printed = capsys.readouterr().out
    assert "out of reach: " in printed
    assert "no target is within reach. No change that was tried reaches clearly more" in printed
    assert lab.events == []
    # A check says so, too: it counted the changes before.
    assert main(["check", "--target", "1.05", "10"]) == 0
    assert "\nNo change that was tried reaches clearly more.\n" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("rig", "words"),
    [
        ("virtual:6x", "unknown rig 'virtual:6x': one of virtual, virtual:LAB"),
        ("engine:bulet", "one of warp, mujoco, pybullet"),
        ("ur", "no robot section: --rig ur needs one"),
        ("no_such_module:make", "no module 'no_such_module'"),
        ("json:no_such_factory", "no factory 'no_such_factory'"),
        ("json:__doc__", "json"),
        ("flying", "flying"),
    ],
)
def test_a_rig_that_cannot_be_made_is_refused_before_anything_is_simulated_or_written(
    rig, words, lab, capsys, monkeypatch, model_folder
):
    def simulate(*_, **__):
        raise AssertionError("it was simulated what casts reach")

    monkeypatch.setattr("cablecast.pipeline.check.check", simulate)
    for verb in (["aim", "--target", "1.05", "10"], ["evaluate", "--model", model_folder]):
        assert words in refused([*verb, "--rig", rig], capsys)
        # This one can be called, but makes no rig.
        assert "must take (setup, seed)" in refused([*verb, "--rig", "math:sqrt"], capsys)
    assert not (lab.path / "runs").exists()


def test_a_target_out_of_reach_says_which_number_comes_first(lab, capsys):
    for target in (["105", "10"], ["10", "1.05"]):
        line = refused(["aim", "--target", *target, *lab.rig], capsys)
        assert "r must be at most 1.560 m (--target takes r first, in m, then theta in deg)" in line


def test_a_small_tolerance_is_shown_in_millimetres(lab, monkeypatch):
    nowhere = np.zeros((6, 1, 2))
    found = LabCheck(setup=Setup(), landing_xy=nowhere, leaving_xy=nowhere[0])
    monkeypatch.setattr("cablecast.pipeline.check.check", lambda *_, **__: found)
    with pytest.warns(UserWarning, match="0.2 mm: for 3 % give --within-pct 3"):
        main(["aim", "--target", "1.05", "10", "--within-pct", "0.03", *lab.rig])


def test_an_unknown_verb_names_the_one_that_is_meant(capsys):
    assert "unknown verb 'aims': did you mean aim?" in refused(["aims"], capsys)


def test_casts_that_a_mode_does_not_use_are_refused(lab, capsys):
    line = refused(["train", "--mode", "real", "--dataset", "somewhere"], capsys)
    assert "--mode real uses no simulated casts, but --dataset somewhere was given" in line


def test_simulated_casts_are_not_taken_for_real_ones(lab, capsys, dataset_folder):
    line = refused(["train", "--dataset", dataset_folder, "--real", dataset_folder], capsys)
    assert "'sim', which are not casts of a rig" in line
    assert not (lab.path / "runs").exists()


def test_a_cable_longer_than_the_table_is_refused_before_the_rig_is_connected(lab, capsys):
    values = load_cable("cable_1").to_dict() | {"name": "long", "length": 1.6}
    (lab.path / "long.yaml").write_text(yaml.safe_dump(values))
    for verb in ("collect", "repeat", "aim --paper-targets"):
        line = refused([*verb.split(), *lab.rig, "--cable", "long.yaml"], capsys)
        assert "at most 1.22 m long" in line
    assert lab.events == []


@pytest.mark.parametrize("table", ["", "workspace: {table_depth: 1.8}\n"])
def test_the_workspace_fits_the_cable_of_the_command_line(table, tmp_path):
    cable = dataclasses.replace(load_cable("cable_1"), name="long", length=0.95)
    (tmp_path / "long.yaml").write_text(yaml.safe_dump(cable.to_dict()))
    (tmp_path / "lab.yaml").write_text(table + "cable: cable_2")
    (tmp_path / "both.yaml").write_text(table + "cable: long.yaml")
    setup = load_lab(tmp_path / "lab.yaml", str(tmp_path / "long.yaml"))
    assert setup == load_setup(tmp_path / "both.yaml")
    if not table:
        assert load_lab(None, str(tmp_path / "long.yaml")) == setup


@pytest.mark.parametrize(
    "verb", ["simulate", "collect", "train", "plan", "evaluate", "repeat", "aim"]
)
def test_an_unknown_cable_is_refused_and_the_known_ones_are_listed(verb, capsys, in_new_folder):
    target = ["--target", "1.0", "0"] if verb in ("plan", "aim") else []
    line = refused([verb, "--cable", "cable_9", *target], capsys)
    assert "'cable_9'" in line
    assert "cable_1, cable_2, cable_3" in line
    assert contents(in_new_folder) == {}


def test_a_cable_file_with_a_bad_value_names_it(capsys, in_new_folder):
    values = load_cable("cable_1").to_dict()
    values["params"]["mass"] = -0.05
    file = in_new_folder / "my.yaml"
    file.write_text(yaml.safe_dump(values))
    line = refused(["simulate", "--cable", file, "--count", "60"], capsys)
    assert "mass = -0.05 kg is outside [0.0005, 1]" in line
    assert list(contents(in_new_folder)) == ["my.yaml"]


def test_a_missing_dataset_or_model_says_how_to_make_one(capsys, in_new_folder):
    for words, said in (
        (["train", "--cable", "cable_2"], "make it with `cablecast simulate` and the same"),
        (["train", "--dataset", "nowhere", "--out", "model"], "nowhere"),
        (["plan", "--target", "1.0", "0"], "make it with `cablecast train` and the same"),
        (["evaluate"], "make it with `cablecast train` and the same"),
        (["plan", "--model", "nowhere", "--target", "1.0", "0"], "nowhere"),
    ):
        assert said in refused(words, capsys)
    assert contents(in_new_folder) == {}


def test_a_model_of_another_cable_is_refused(model_folder, capsys):
    arguments = ["plan", "--model", model_folder, "--cable", "cable_2", "--target", "1.0", "0"]
    line = refused(arguments, capsys)
    assert "length is 0.62 there and 0.65 here" in line


def test_a_dataset_or_a_model_of_other_settings_is_not_overwritten(
    dataset_folder, model_folder, capsys
):
    before = contents(dataset_folder), contents(model_folder)
    words = ["--count", "300", "--segment-count", "10", "--dt", "0.002", "--seed", "7"]
    line = refused(["simulate", *words, "--out", dataset_folder], capsys)
    assert "seed is 0 there and 7 here" in line
    words = ["--epochs", "6", "--candidate-count", "500", "--out", model_folder]
    line = refused(["train", "--dataset", dataset_folder, *words], capsys)
    assert "training.epochs is 5 there and 6 here" in line
    assert (contents(dataset_folder), contents(model_folder)) == before


def test_a_folder_with_other_files_is_not_written_to(dataset_folder, tmp_path, capsys):
    (tmp_path / "thesis.tex").write_text("years of work")
    for verb in (["simulate", "--count", "60"], ["train", "--dataset", dataset_folder]):
        assert "thesis.tex" in refused([*verb, "--out", tmp_path], capsys)
    assert list(contents(tmp_path)) == ["thesis.tex"]


def test_a_saved_motion_is_overwritten_only_on_demand(model_folder, tmp_path, capsys):
    file = tmp_path / "motion.csv"
    file.write_text("precious")
    lab = tmp_path / "lab.yaml"
    save_setup(Setup(arm=ArmUR(measured=True)), lab)
    arguments = ["plan", "--model", model_folder, "--target", "1.0", "10", "--save", file]
    arguments += ["--setup", lab, "--miss-max", "200"]
    assert "motion.csv" in refused(arguments, capsys)
    assert file.read_text() == "precious"
    assert main([*map(str, arguments), "--force"]) == 0
    assert "t,q1" in file.read_text()
