"""The whip of another author's benchmark, rebuilt in MuJoCo from its published facts.

Nah, Krotov, Russo, Sternad and Hogan, "Dynamic primitives facilitate manipulating a whip" (BioRob
2020), "Manipulating a whip in 3D via dynamic primitives" (IROS 2021), and the models and constants
of their repository. An arm of two links with four joints is pulled by springs and dampers towards a
posture that moves once, with the least jerk, from one posture to another; the whip's weight and the
arm's are compensated for where they are held. A whip of point masses hangs from its end. Nothing
touches anything.
"""

import dataclasses
from typing import Any

import numpy as np

from cablecast.conventions import Array

TARGETS = (
    (1.995, 0.0, 0.0),
    (1.411, 1.411, 0.0),
    (0.9975, 0.9975, 1.41),
    (2.385, 0.0, 0.0),
    (1.686, 1.686, 0.0),
    (1.1925, 1.1925, 1.686),
)
"""Targets of the published models [m]."""
LINKS = (
    (0.294, 0.129, 1.595, (0.011917, 0.011937, 0.001325)),
    (0.291, 0.112, 0.869, (0.004765, 0.004855, 0.000472)),
)
"""Length and distance to the centre of mass [m], mass [kg] and inertia [kg·m²] of each link."""
AXES = ((0.0, -1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0))
"""Axes of the joints of a hanging arm, three in the shoulder and one in the elbow."""
STIFFNESS = np.array(
    [[17.4, 6.85, -7.75, 8.4], [6.85, 33.0, 3.7, 0.0], [-7.75, 3.7, 27.7, 0.0], [8.4, 0, 0, 23.2]]
)
"""Stiffness that pulls the arm to its posture [N·m/rad]."""
DAMPING_TIME = 0.05
"""Damping over stiffness [s]."""
LOW = np.pi * np.array([-0.5, -0.5, -0.5, 0.0, 0.1, -0.5, -0.5, 0.0, 0.4 / np.pi])
HIGH = np.pi * np.array([-0.1, 0.5, 0.5, 0.9, 1.0, 0.5, 0.5, 0.9, 1.5 / np.pi])
"""Range of a move: posture at its start and at its end [rad], and its duration [s]."""
RUN = 2.0
"""Duration of a run over that of its move, as in the published search [-]."""
DT = 1e-4
"""Step of the published simulation [s]."""
SPECK = 1e-6
"""Mass of a body that carries a force [kg]."""
SAMPLE_DT = 0.01
"""Time between samples of a path that is seen [s]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Whip:
    """A whip of point masses.

    Attributes:
        length: Length [m].
        mass: Mass [kg].
        bend_stiffness: Stiffness of a joint times the length of a link [N·m²].
        damping_time: Damping of a joint over its stiffness [s].
        node_count: Number of links.
    """

    length: float = 1.8
    mass: float = 0.3
    bend_stiffness: float = 0.242 * 0.072
    damping_time: float = 0.092 / 0.242
    node_count: int = 25


def moves(units: Array) -> Array:
    """Return the numbers of moves, in the units of `LOW` and `HIGH`, shape [move, 9]."""
    return LOW + np.clip(units, 0.0, 1.0) * (HIGH - LOW)


def postures(units: Array, times: Array) -> tuple[Array, Array]:
    """Return the postures that pull the arm [rad], and their rates [rad/s], [move, step, joint].

    Args:
        units: Moves in unit coordinates, shape [move, 9].
        times: Times since the start [s], shape [step].
    """
    values = moves(units)
    start, end, duration = values[:, None, :4], values[:, None, 4:8], values[:, None, 8:]
    s = np.clip(times[:, None] / duration, 0.0, 1.0)
    q = start + (end - start) * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    qd = (end - start) / duration * 30.0 * s**2 * (1.0 - s) ** 2
    return q, qd


def durations(units: Array) -> Array:
    """Return the duration of runs of moves [s], shape [move]."""
    return RUN * moves(units)[:, 8]


def hand(q: Array) -> Array:
    """Return the arm's end [m], shape [posture, 3], in postures [rad], shape [posture, 4]."""
    from scipy.spatial.transform import Rotation

    turn, place = Rotation.identity(), np.zeros(3)
    for (length, *_), joints in zip(LINKS, ((0, 1, 2), (3,)), strict=True):
        for joint in joints:
            turn = turn * Rotation.from_rotvec(q[:, joint : joint + 1] * AXES[joint])
        place = place + turn.apply([0.0, 0.0, -length])
    return place


def _model(whip: Whip, dt: float) -> Any:
    """Return the MuJoCo model of a whip on the arm."""
    import mujoco

    spec = mujoco.MjSpec()
    spec.option.timestep = dt
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    # A run that breaks is not to start over.
    bits = mujoco.mjtDisableBit
    spec.option.disableflags = int(bits.mjDSBL_CONTACT) | int(bits.mjDSBL_AUTORESET)
    spec.compiler.degree = False
    body, place = spec.worldbody, 0.0
    axes = iter(enumerate(AXES))
    for (length, middle, mass, inertia), count in zip(LINKS, (3, 1), strict=True):
        body = body.add_body(
            pos=[0.0, 0.0, -place],
            mass=mass,
            ipos=[0.0, 0.0, -middle],
            inertia=inertia,
            gravcomp=1.0,
            explicitinertial=True,
        )
        for _ in range(count):
            number, axis = next(axes)
            body.add_joint(name=f"q{number}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis)
        place = length
    # The whip's weight is compensated for at the arm's end: a speck there floats for all of it.
    body.add_body(
        name="end",
        pos=[0.0, 0.0, -place],
        mass=SPECK,
        inertia=[SPECK**2] * 3,
        gravcomp=1.0 + whip.mass / SPECK,
        explicitinertial=True,
    )
    spacing = whip.length / whip.node_count
    stiffness = whip.bend_stiffness / spacing
    for number in range(whip.node_count):
        body = body.add_body(name=f"B{number}", pos=[0.0, 0.0, -place])
        place = spacing
        for axis in (1.0, 0.0, 0.0), (0.0, -1.0, 0.0):
            body.add_joint(
                type=mujoco.mjtJoint.mjJNT_HINGE,
                axis=axis,
                stiffness=stiffness if number else 0.0,
                damping=stiffness * whip.damping_time if number else 0.0,
            )
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            pos=[0.0, 0.0, -spacing],
            size=[0.012, 0.0, 0.0],
            mass=whip.mass / whip.node_count,
        )
    site = body.add_site(name="tip", pos=[0.0, 0.0, -spacing])
    spec.add_sensor(
        type=mujoco.mjtSensor.mjSENS_FRAMEPOS, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=site.name
    )
    # Springs that couple joints are springs of combinations of them: the eigenvectors.
    values, vectors = np.linalg.eigh(STIFFNESS)
    for number, (value, vector) in enumerate(zip(values, vectors.T, strict=True)):
        tendon = spec.add_tendon(name=f"t{number}")
        for joint, share in enumerate(vector):
            tendon.wrap_joint(f"q{joint}", share)
        actuator = spec.add_actuator(
            name=f"a{number}", trntype=mujoco.mjtTrn.mjTRN_TENDON, target=tendon.name
        )
        actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        actuator.gainprm[0] = value
        actuator.biasprm[:3] = [0.0, -value, -value * DAMPING_TIME]
    return spec.compile()


class World:
    """The arm with one whip.

    Args:
        whip: Whip.
        dt: Step [s].
    """

    def __init__(self, whip: Whip, dt: float = DT):
        import mujoco
        from mujoco import rollout

        self._mujoco, self._rollout = mujoco, rollout
        self.whip, self.dt = whip, dt
        self.model = _model(whip, dt)
        self.data = mujoco.MjData(self.model)
        self.vectors = np.linalg.eigh(STIFFNESS)[1]
        self._end = self.model.body("end").id

    def swing(self, unit: Array, duration: float | None = None) -> Array:
        """Return the tip of a move in [0, 1]⁹ at every step [m], shape [step, 3].

        Args:
            unit: Move.
            duration: Duration of the run [s]; that of the published search where None.
        """
        unit = np.asarray(unit, dtype=float)
        duration = float(durations(unit[None])[0]) if duration is None else duration
        times = self.dt * np.arange(round(duration / self.dt) + 1, dtype=float)
        q, qd = (rows[0] for rows in postures(unit[None], times))
        control = (q + DAMPING_TIME * qd) @ self.vectors
        mujoco, model, data = self._mujoco, self.model, self.data
        mujoco.mj_resetData(model, data)
        data.qpos[:4] = q[0]
        data.qpos[4:6] = self._downwards(q[0])
        state = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
        mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        _, tip = self._rollout.rollout(model, data, state[None], control[None])
        return tip[0]

    def _downwards(self, q: Array) -> Array:
        """Return the angles of the first joint of the whip with which it hangs down."""
        mujoco, data = self._mujoco, self.data
        mujoco.mj_kinematics(self.model, data)
        # The way down, seen from the end of the arm.
        down = data.xmat[self._end].reshape(3, 3).T @ [0.0, 0.0, -1.0]
        # Rx(a) R-y(b) (0, 0, -1) = (sin b, sin a cos b, -cos a cos b).
        side = np.arcsin(np.clip(down[0], -1.0, 1.0))
        return np.array([np.arctan2(down[1], -down[2]), side])
