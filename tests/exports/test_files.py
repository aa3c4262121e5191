"""What the files of an exported cable say, and what a person does with them."""

import dataclasses
import re
import runpy
import xml.dom.minidom

import numpy as np
import pytest

import cablecast as cc
from cablecast.cable import PARAMS, load_cable
from cablecast.cli import main
from cablecast.engines.pybullet_ import BulletClient
from cablecast.exports import pybullet_, rods
from cablecast.exports.facts import LAWS, CableModel
from cablecast.exports.mujoco_ import chain_xml, flex_xml
from cablecast.pipeline.export import export_cable
from cablecast.runs.places import TUNE_FOLDER, cable_folder
from cablecast.tuning.space import ParamPosterior
from cablecast.tuning.tuned import Tuned, write_params

FILES = ("chain.xml", "flex.xml", "urdf", "pybullet.py", "newton.py", "elastica.py")
STILL = 1e-3
"""Distance that the end of a cable may creep in half a second [m]."""
ROUNDING = 1e-6
"""Relative error of numbers in a script."""


def texts(model):
    writers = (chain_xml, flex_xml, pybullet_.urdf, pybullet_.springs, rods.newton, rods.elastica)
    return [write(model) for write in writers]


def test_a_file_states_each_parameter_with_its_interval_unit_and_law():
    tuned = Tuned.believed(cc.Setup(cable="cable_2"))
    model = CableModel(cable=tuned.setup.cable, posterior=tuned.posterior, segment_count=10)
    low, high = model.intervals()["bend_stiffness"]
    assert low < model.value("bend_stiffness") < high
    assert tuple(LAWS) == tuple(PARAMS)
    for text in texts(model):
        assert re.search(
            r"bend_stiffness = 2e-05 \[\S+ to \S+\] N·m²: EI: moment = EI x curv", text
        )
        assert "SI units" in text
        assert "leaves out or changes" in text


def test_the_interval_of_a_value_at_the_end_of_its_range_reaches_there():
    cable = load_cable("cable_1")
    believed = ParamPosterior.before_casts(cable)
    for end in (0.0, 1.0):
        mean = believed.mean.copy()
        row = believed.space.names.index("rolling_friction")
        mean[row] = end
        posterior = dataclasses.replace(believed, mean=mean)
        low, high = CableModel(cable=cable, posterior=posterior).intervals()["rolling_friction"]
        value = float(posterior.params.rolling_friction)
        assert value == pytest.approx((low, high)[round(end)])
        assert low < high


def test_a_file_says_what_its_simulator_leaves_out():
    params = {"yield_curvature": 30.0, "drag_coefficient": 1.0, "friction_ratio": 1.2}
    model = CableModel(cable=load_cable("cable_1").with_params(**params), segment_count=10)
    chain, flex, urdf, _, newton, elastica = texts(model)
    assert "angular_damping acts on rotation in space" in chain
    assert "left out: drag_coefficient, friction_ratio, yield_curvature." in flex
    assert "drag_coefficient: left out" in urdf
    assert re.search("left out: drag_coefficient, yield_curvature, friction_ratio", newton)
    assert re.search("left out: drag_coefficient, yield_curvature, spinning_friction", elastica)


def test_the_pads_of_the_gripper_soften_the_first_joint():
    cable = load_cable("cable_1").with_params(grip_compliance=20.0, yield_curvature=30.0)
    soft, stiff = (CableModel(cable=c, segment_count=10) for c in (cable, load_cable("cable_1")))
    bend, whole = soft.springs, stiff.springs
    assert 1.0 / bend[0] == pytest.approx(1.0 / whole[0] + 20.0)
    assert bend[1:] == whole[1:]
    assert f'stiffness="{bend[0]:.6g}"' in texts(soft)[0]
    # The moment at which the cable yields is the same.
    limit = soft.value("bend_stiffness") * 30.0
    for name, value in (("bend", bend[0]), ("yield_angle", limit / bend[0])):
        first = re.search(f"'{name}': \\[([^,]+),", pybullet_.springs(soft))
        assert first is not None
        assert float(first[1]) == pytest.approx(value, rel=1e-3)


def test_scripts_stand_alone():
    model = CableModel(cable=load_cable("cable_3"), segment_count=10)
    for text in (pybullet_.springs(model), rods.newton(model), rods.elastica(model)):
        assert "import cablecast" not in text
        assert "from cablecast" not in text
        names: dict = {}
        exec(compile(text, "script", "exec"), names)
        assert names["VALUES"]["segment_count"] == 10


def test_a_cable_is_exported_with_one_command(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["export", "cable", "--cable", "cable_2"]) == 2
    assert "make them with `cablecast tune`" in capsys.readouterr().err
    tuned = Tuned.believed(cc.Setup(cable="cable_2"))
    folder = cable_folder("cable_2") / TUNE_FOLDER
    folder.mkdir(parents=True)
    write_params(folder, tuned.to_dict())
    assert main(["export", "cable", "--cable", "cable_2"]) == 0
    written = [(tmp_path / line) for line in capsys.readouterr().out.split()]
    assert all(path.is_file() for path in written)
    assert tuple(path.name.removeprefix("cable_2").lstrip("_.") for path in written) == FILES
    assert main(["export", "cable", "--cable", "cable_2", "--segment-count", "1"]) == 2
    assert "segment_count" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["../up/red", '--- 4 mm "<Käbel>" & blue'])
def test_whatever_a_cable_is_called_its_files_lie_in_the_folder_and_can_be_read(name, tmp_path):
    cable = dataclasses.replace(load_cable("cable_1"), name=name)
    files = export_cable(Tuned.of(None, cc.Setup(cable=cable)), tmp_path / "models")
    assert {path.parent for path in files} == {tmp_path / "models"}
    for path in files:
        if path.suffix == ".py":
            compile(path.read_text(encoding="utf-8"), path.name, "exec")
        else:
            xml.dom.minidom.parse(str(path))


def bullet(tmp_path, cable):
    pytest.importorskip("pybullet")
    tuned = dataclasses.replace(Tuned.of(cable.params, cc.Setup(cable=cable)), posterior=None)
    export_cable(tuned, tmp_path)
    script = runpy.run_path(str(tmp_path / f"{cable.name}_pybullet.py"))
    return script["Cable"](BulletClient())


def test_a_cable_in_bullet_holds_still_on_its_table(tmp_path):
    cable = load_cable("cable_1")
    loaded = bullet(tmp_path, cable)
    loaded.add_table()
    grip = [0.0, 0.3, cable.radius, 0.0, 0.0]
    loaded.place(grip, [[0.0, 0.0, 0.0, 1.0]] * len(loaded.joints))
    for _ in range(round(0.5 / loaded.dt)):
        loaded.step(grip)
    assert loaded.end() == pytest.approx([0.0, 0.3 + cable.length, cable.radius], abs=STILL)


def test_a_bent_joint_in_bullet_feels_the_moment_of_its_length(tmp_path):
    cable = load_cable("cable_3").with_params(rest_curvature=0.4, damping_time=0.01)
    loaded, angle = bullet(tmp_path, cable), 0.1
    turns = np.tile([0.0, 0.0, np.sin(angle / 2), np.cos(angle / 2)], (len(loaded.joints), 1))
    loaded.place([0.0, 0.0, 1.0, 0.0, 0.0], turns)
    moments = loaded._torques(turns)
    length = cable.length / len(turns)
    cells = np.full(len(turns), length)
    cells[0] /= 2
    expected = -cable.params.bend_stiffness * (angle / cells - 0.4)
    assert moments[:, 2] == pytest.approx(expected, rel=ROUNDING)
    assert np.abs(moments[:, :2]).max() < ROUNDING * np.abs(expected).max()


def test_a_value_that_was_not_fitted_is_not_said_to_be():
    tuned = Tuned.believed(cc.Setup(cable="cable_2"))
    cable = tuned.setup.cable.with_params(drag_ratio=0.1)
    head = "\n".join(CableModel(cable=cable, posterior=tuned.posterior).lines("MuJoCo", ()))
    assert "drag_ratio = 0.1: " in head
    assert "fitted, too" not in head
    assert "without an interval" in head
