"""Exported chains and rods of MuJoCo: they load, hold still, and obey the laws that they state."""

import dataclasses

import numpy as np
import pytest

from cablecast.cable import AIR_DENSITY, CABLE_NAMES, load_cable
from cablecast.conventions import GRAVITY
from cablecast.engines.mujoco_ import EngineMujoco, _Group
from cablecast.exports.facts import CableModel
from cablecast.exports.mujoco_ import FLEX_DT, chain_xml, flex_xml

mujoco = pytest.importorskip("mujoco")

COUNT = 12
STILL = 1e-3
"""Speed up to which a cable holds still [m/s, rad/s]; the table gives a little under it."""
ROUNDING = 1e-5
"""Relative error of numbers that files round to six digits."""
VIRTUAL_MASS = 1e-3
"""Relative share of what MuJoCo adds for the air that moves with a capsule."""
SHORT = 0.02
"""Relative error of a cantilever of twelve segments that bends by a few degrees."""


def modelled(name="cable_1", count=COUNT, **params):
    cable = load_cable(name)
    return CableModel(cable=cable.with_params(**params), segment_count=count)


def loaded(xml):
    model = mujoco.MjModel.from_xml_string(xml)
    return model, mujoco.MjData(model)


@pytest.mark.parametrize("write", [chain_xml, flex_xml])
@pytest.mark.parametrize("name", CABLE_NAMES)
def test_an_exported_cable_loads_and_holds_still(name, write):
    model, data = loaded(write(modelled(name)))
    mujoco.mj_step(model, data, 200)
    assert np.abs(data.qvel).max() < STILL


def test_a_chain_bends_twists_and_curls_as_its_length_does():
    exported = modelled(rest_curvature=0.5)
    cable, half = exported.cable, 0.5 * exported.segment_length
    model, _ = loaded(chain_xml(exported))

    def of(kind, values):
        return np.array([values[model.joint(f"{kind}_{i}").id] for i in range(COUNT)])

    # Half a segment at the free end bends nowhere.
    bent = cable.length - half
    for kind, stiffness in (
        ("side", cable.params.bend_stiffness),
        ("lift", cable.params.bend_stiffness),
        ("twist", cable.params.twist_stiffness),
    ):
        compliance = np.sum(1.0 / of(kind, model.jnt_stiffness))
        assert compliance == pytest.approx(bent / stiffness, rel=ROUNDING)
    places = [model.joint(f"side_{i}").qposadr[0] for i in range(COUNT)]
    assert model.qpos_spring[places].sum() == pytest.approx(0.5 * bent, rel=ROUNDING)


def test_a_chain_hangs_from_a_clamp_as_a_heavy_beam():
    # At this stiffness w L^4 / (8 EI) is a thirtieth of the length.
    stiffness = 30 / 8 * 0.05 * GRAVITY * 0.62**2
    exported = modelled(
        count=24, bend_stiffness=min(stiffness, 0.1), endpoint_mass=0.0, damping_time=0.1
    )
    value = float(exported.cable.params.bend_stiffness)
    exported = dataclasses.replace(
        exported, cable=exported.cable.with_params(mass=value * 8 / (30 * GRAVITY * 0.62**2))
    )
    model, data = loaded(chain_xml(exported))
    model.geom("table").contype[0] = model.geom("table").conaffinity[0] = 0
    data.mocap_pos[0, 2] = data.qpos[2] = 1.0
    mujoco.mj_step(model, data, 1500)
    assert data.qpos[2] - data.site("tip").xpos[2] == pytest.approx(0.62 / 30, rel=2 * SHORT)


def test_the_air_slows_a_chain_by_its_drag_and_its_linear_damping():
    exported = modelled(drag_coefficient=1.3, linear_damping=0.4, endpoint_mass=0.0)
    cable, (model, data) = exported.cable, loaded(chain_xml(exported))
    # The air drags on the hand, too, which is a box as large as its inertia says.
    model.body("grip").mass[:], model.body("grip").inertia[:] = 1e-6, 1e-15
    data.qpos[2] = 1.0
    data.qvel[0] = 2.0
    mujoco.mj_forward(model, data)
    drag = 0.5 * AIR_DENSITY * 1.3 * cable.diameter * cable.length * 2.0**2
    expected = -(drag + 0.4 * cable.params.mass * 2.0)
    assert data.qfrc_passive[0] == pytest.approx(expected, rel=VIRTUAL_MASS)


def test_the_grain_of_the_friction_lies_along_the_chain():
    exported = modelled(friction_ratio=1.5, spinning_friction=2e-3)
    model, data = loaded(chain_xml(exported))
    mujoco.mj_step(model, data)
    friction = exported.cable.params.friction
    for contact in data.contact:
        assert np.abs(contact.frame[3:6]) == pytest.approx([0.0, 1.0, 0.0], abs=1e-6)
        assert contact.friction[:3] == pytest.approx([1.5 * friction, friction, 2e-3], rel=ROUNDING)


def test_a_sharp_bend_stays_in_a_chain_that_yields():
    angles = []
    for limit in (0.0, 10.0):
        exported = modelled(
            bend_stiffness=0.05, yield_curvature=limit, yield_time=0.05, damping_time=0.05
        )
        model, data = loaded(chain_xml(exported))
        model.opt.gravity[:] = 0.0
        # Twice the yield curvature at each joint, held by nothing.
        for index in range(COUNT):
            data.qpos[model.joint(f"side_{index}").qposadr] = 20.0 * exported.segment_length
        mujoco.mj_step(model, data, 1000)
        places = [
            model.joint(f"{kind}_{i}").qposadr[0]
            for i in range(COUNT)
            for kind in (("side", "side_yield") if limit else ("side",))
        ]
        angles.append(data.qpos[places].sum())
    assert abs(angles[0]) < 0.5
    assert angles[1] > 3.0 * abs(angles[0])


def test_the_flex_has_the_values_of_the_engine():
    exported = modelled()
    engine = EngineMujoco(COUNT, FLEX_DT, thread_count=1)
    cable = exported.cable
    group = _Group(engine, engine._model(cable, held=False), cable, cable.params)
    model, _ = loaded(flex_xml(exported))
    for name in ("body_mass", "tendon_damping", "flex_friction", "flex_bending"):
        theirs = np.ravel(group.batch.expand(name)[0])
        assert np.ravel(getattr(model, name)) == pytest.approx(theirs, rel=1e-4, abs=1e-12), name
