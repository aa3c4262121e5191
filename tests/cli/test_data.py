"""`import` and `export` on the command line."""

import json

from cablecast.cli import main


def test_a_table_becomes_a_dataset_and_a_dataset_a_lerobot_data_set(tmp_path, capsys, monkeypatch):
    joints = ",".join(f"q{k}_rad" for k in range(1, 7))
    rows = [f"cast,time_s,x_m,y_m,{joints}"]
    rows += [
        f"a,{k / 20:.2f},0.1,{1.0 + 0.001 * k:.3f},0,-1,1.5,-2,-1.5,{k / 100}" for k in range(40)
    ]
    (tmp_path / "table.csv").write_text("\n".join(rows) + "\n")
    casts, out = tmp_path / "casts", tmp_path / "lerobot"
    assert main(["import", str(tmp_path / "table.csv"), "--out", str(casts)]) == 0
    assert "1 cast of cable_1 is in" in capsys.readouterr().out
    # The same command again finds its work done.
    assert main(["import", str(tmp_path / "table.csv"), "--out", str(casts)]) == 0
    assert main(["export", str(casts), "--fps", "20", "--out", str(out)]) == 0
    info = json.loads((out / "meta/info.json").read_text())
    assert (info["total_frames"], info["fps"], info["robot_type"]) == (40, 20, "ur5")
    assert main(["export", str(casts), "--out", str(out)]) == 2
    assert "not empty" in capsys.readouterr().err
    assert main(["import", str(tmp_path / "none.csv"), "--out", str(casts)]) == 2
    # A folder without a name of its own is exported beside itself.
    monkeypatch.chdir(casts)
    assert main(["export", "."]) == 0
    assert (tmp_path / "casts-lerobot/meta/info.json").is_file()
    # A folder may have the name of the word that stands for a cable.
    monkeypatch.chdir(tmp_path)
    casts.rename("cable")
    assert main(["export", "./cable"]) == 0
    assert (tmp_path / "cable-lerobot/meta/info.json").is_file()


def test_a_folder_of_aim_is_named_by_its_part(tmp_path, capsys):
    for part in ("calibration", "tune", "dataset", "model"):
        (tmp_path / "aim" / part).mkdir(parents=True)
    folder = str(tmp_path / "aim")
    for words, what, part in (
        (["export", folder], "its data set", "calibration"),
        (["export", "cable", "--params", folder], "its fit", "tune"),
        (["tune", "--dataset", folder], "its casts", "calibration"),
        (["train", "--dataset", folder], "its dataset", "dataset"),
        (["plan", "--model", folder, "--target", "1", "0"], "its model", "model"),
        (["evaluate", "--model", folder], "its model", "model"),
    ):
        assert main(words) == 2
        said = capsys.readouterr().err
        assert f"is a folder of `cablecast aim`: {what} is in {tmp_path / 'aim' / part}" in said
