"""Everything that a user can get wrong: one line, status 2, no traceback, nothing overwritten."""

import pathlib
import shutil

import pytest
import yaml

from cablecast.arm.ur import ArmUR
from cablecast.cable import load_cable
from cablecast.cli import main
from cablecast.setup import Setup, save_setup


def refused(arguments, capsys) -> str:
    """Run the command line, check how it refuses, and return the line."""
    status = main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    lines = captured.err.splitlines()
    assert status == 2
    assert lines, "nothing was said"
    assert lines[-1].startswith("cablecast: ")
    assert sum(line.startswith("cablecast: ") for line in lines) == 1
    assert "Traceback" not in captured.err + captured.out
    return lines[-1]


def snapshot(folder: pathlib.Path):
    """Every file below a folder with its content."""
    return {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}


@pytest.mark.parametrize(
    "verb", ["simulate", "collect", "train", "plan", "evaluate", "repeat", "demo"]
)
def test_an_unknown_cable_is_refused_and_the_known_ones_are_listed(verb, capsys, in_new_folder):
    target = ["--target", "1.0", "0"] if verb == "plan" else []
    line = refused([verb, "--cable", "cable_9", *target], capsys)
    assert "'cable_9'" in line
    assert "cable_1, cable_2, cable_3" in line
    assert snapshot(in_new_folder) == {}


def test_a_target_out_of_reach_names_the_radius_and_the_bound(model_folder, capsys):
    line = refused(["plan", "--model", model_folder, "--target", "1.6", "0"], capsys)
    assert "1.600 m" in line
    assert "1.560 m" in line


def test_a_target_off_the_table_names_the_edges(model_folder, capsys):
    line = refused(["plan", "--model", model_folder, "--target", "1.5", "80"], capsys)
    assert "off the table" in line
    assert "1.375" in line


@pytest.mark.parametrize("target", [["nan", "10"], ["1.0", "inf"], ["-0.5", "10"]], ids=" ".join)
def test_a_target_that_is_no_place_is_refused(target, model_folder, capsys):
    line = refused(["plan", "--model", model_folder, "--target", *target], capsys)
    assert any(word in line for word in ("finite", "negative"))


@pytest.mark.parametrize(
    ("change", "fragments"),
    [
        ({"params": {"mass": -0.05}}, ("mass = -0.05 kg", "[0.0005, 1]")),
        ({"params": {"bend_stiffness": float("nan")}}, ("bend_stiffness = nan",)),
        ({"length": 0.0}, ("length = 0 m", "[0.05, 5]")),
        ({"attachment": "anchor"}, ("anchor", "none, hook, magnet")),
        ({"colour": "green"}, ("colour",)),
    ],
    ids=["negative mass", "NaN stiffness", "no length", "unknown attachment", "unknown key"],
)
def test_a_cable_file_with_a_bad_value_names_it(change, fragments, capsys, in_new_folder):
    values = load_cable("cable_1").to_dict()
    values |= change | {"params": values["params"] | change.get("params", {})}
    file = in_new_folder / "my.yaml"
    file.write_text(yaml.safe_dump(values))
    line = refused(["simulate", "--cable", file, "--count", "60"], capsys)
    assert all(fragment in line for fragment in fragments)
    assert list(snapshot(in_new_folder)) == [file]


def test_a_cable_file_that_is_no_yaml_is_refused(capsys, in_new_folder):
    file = in_new_folder / "my.yaml"
    file.write_text("length: [0.62\nname: x")
    assert "my.yaml" in refused(["simulate", "--cable", file], capsys)


def test_counts_and_steps_out_of_bounds_are_refused(capsys, in_new_folder):
    for option, value in (("--count", "0"), ("--v-max", "-1"), ("--dt", "0.5"), ("--r0", "nan")):
        line = refused(["simulate", option, value, "--out", "d"], capsys)
        assert value in line or str(float(value)) in line
    assert snapshot(in_new_folder) == {}


def test_a_missing_dataset_says_how_to_make_one(capsys, in_new_folder):
    assert "cablecast simulate --cable cable_2" in refused(["train", "--cable", "cable_2"], capsys)
    assert "nowhere" in refused(["train", "--dataset", "nowhere", "--out", "model"], capsys)
    assert snapshot(in_new_folder) == {}


def test_a_truncated_dataset_is_refused_and_no_model_is_written(dataset_folder, tmp_path, capsys):
    copy = tmp_path / "dataset"
    shutil.copytree(dataset_folder, copy)
    shard = next(copy.rglob("*.parquet"))
    shard.write_bytes(shard.read_bytes()[:-200])
    line = refused(["train", "--dataset", copy, "--out", tmp_path / "model"], capsys)
    assert shard.name in line
    assert not (tmp_path / "model").exists()


def test_a_missing_model_says_how_to_make_one(capsys, in_new_folder):
    for arguments in (["plan", "--target", "1.0", "0"], ["evaluate"]):
        assert "cablecast train --cable cable_1" in refused(arguments, capsys)
    line = refused(["plan", "--model", "nowhere", "--target", "1.0", "0"], capsys)
    assert "nowhere" in line


@pytest.mark.parametrize("name", ["policy.npz", "model.safetensors"])
@pytest.mark.parametrize("kept", [0.0, 0.5, 0.99])
def test_a_truncated_checkpoint_is_refused(name, kept, model_folder, tmp_path, capsys):
    copy = tmp_path / "model"
    shutil.copytree(model_folder, copy)
    content = (copy / name).read_bytes()
    (copy / name).write_bytes(content[: int(kept * len(content))])
    out = tmp_path / "out"
    assert name in refused(["evaluate", "--model", copy, "--rig", "engine", "--out", out], capsys)
    assert not out.exists()


def test_a_model_of_another_cable_is_refused(model_folder, capsys):
    arguments = ["plan", "--model", model_folder, "--cable", "cable_2", "--target", "1.0", "0"]
    line = refused(arguments, capsys)
    assert "length is 0.62 there and 0.65 here" in line


@pytest.mark.parametrize(
    "rig", ["no_such_module:make", "json:no_such_factory", "json:__doc__", "flying", "math:sqrt"]
)
def test_a_rig_that_does_not_exist_is_refused_and_leaves_no_folder(
    rig, model_folder, tmp_path, capsys
):
    out = tmp_path / "out"
    line = refused(["evaluate", "--model", model_folder, "--rig", rig, "--out", out], capsys)
    assert rig.split(":")[0] in line
    assert not out.exists()


def test_an_unavailable_device_is_refused(dataset_folder, tmp_path, capsys):
    import torch

    if torch.cuda.is_available():
        pytest.skip("a CUDA device is here")
    for verb in (["simulate", "--count", "60"], ["train", "--dataset", dataset_folder]):
        line = refused([*verb, "--device", "cuda", "--out", tmp_path / "out"], capsys)
        assert "cuda" in line
    assert snapshot(tmp_path) == {}


def test_a_dataset_of_other_settings_is_not_overwritten(dataset_folder, capsys):
    before = snapshot(dataset_folder)
    arguments = ["--count", "300", "--segment-count", "10", "--dt", "0.002", "--seed", "7"]
    line = refused(["simulate", *arguments, "--out", dataset_folder], capsys)
    assert "seed is 0 there and 7 here" in line
    assert snapshot(dataset_folder) == before


def test_a_model_of_other_settings_is_not_overwritten(dataset_folder, model_folder, capsys):
    before = snapshot(model_folder)
    arguments = ["--epochs", "6", "--candidate-count", "500", "--out", model_folder]
    line = refused(["train", "--dataset", dataset_folder, *arguments], capsys)
    assert "training.epochs is 5 there and 6 here" in line
    assert snapshot(model_folder) == before


def test_a_folder_with_other_files_is_not_written_to(dataset_folder, tmp_path, capsys):
    (tmp_path / "thesis.tex").write_text("years of work")
    for verb in (["simulate", "--count", "60"], ["train", "--dataset", dataset_folder]):
        assert "thesis.tex" in refused([*verb, "--out", tmp_path], capsys)
    assert list(snapshot(tmp_path)) == [tmp_path / "thesis.tex"]


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
