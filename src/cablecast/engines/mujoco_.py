"""EngineMujoco: MuJoCo's native rod behind the Engine contract, a cross-check of the fast one.

The rod is a 1-D flex with the elasticity of discrete elastic rods (Bergou et al. 2008). The model
is built so that it converges to the same continuum as `EngineWarp`:

- The cable begins at node 0 with half a cell of bending and of twist: the edge that is clamped to
  the hand is a stub behind the grip, a thousandth of a segment long.
- Nodes are bodies of the world with three slides each, so that the mass matrix is diagonal.
- The hand is a heavy body on five joints, driven by feedforward and a servo: a mocap body has no
  velocity, and the length constraints would drag behind it.
- Linear damping is joint damping. Angular damping exchanges velocity between neighbouring nodes
  through damped tendons, as in `EngineWarp`, and slows the roll of each segment.
- The table is a plane, which touches every node once.

Differences from `EngineWarp` (tests/engines/test_third_opinion.py, docs/other_engines.md):

- The bending moment grows with the angle phi at a node as 2 tan(phi / 2) / cos(phi / 2)^2, not as
  phi. Both are right in the limit of short segments.
- MuJoCo's sliding friction points not quite against the velocity but partly against the other
  forces on the node, the more so the larger the friction, whatever step and softness.
- Lengths and contacts are stiff springs, and friction acts on the cable's surface, not its axis.

To suppress rolling use `rolling=False`, not a twist stiffness thousands of times that of bending:
with the latter the implicit step adds inertia to the bending as well.
"""

import contextlib
import dataclasses
import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import PARAMS, Cable, CableParams
from cablecast.engines.base import (
    GRAVITY,
    REFERENCE_SEGMENT_COUNT,
    CableState,
    Rollout,
    one_cable,
    plan_rollout,
)
from cablecast.errors import MissingExtraError, check_count, check_number
from cablecast.files import core_count
from cablecast.motion.grip_path import GripPath
from cablecast.workspace import Workspace

HAND_DOF_COUNT = 5
_STUB = 1e-3
"""Length of the clamped stub behind the grip, in segments."""

# The hand outweighs what the cable pulls by far; the servo only removes the drift of integration.
HAND_MASS = 100.0
"""Mass of the hand [kg]."""
SERVO_OMEGA = 400.0
"""Natural frequency of the servo that drives the hand [rad/s]."""
_SERVO = f'kp="{HAND_MASS * SERVO_OMEGA**2}" kv="{2.0 * HAND_MASS * SERVO_OMEGA}"'

# The solver measures its progress against the mean inertia, which the hand dominates.
_TOLERANCE = 1e-13
# A contact much stiffer than the step throws a sliding node up by centimetres: within one step it
# gives the node a normal velocity of friction x sliding speed x 2 dt / time constant.
_CONTACT_TIME = 4e-3
_SOLIMP = "0.9999 0.9999 0.001"


def rod_model(
    cable: Cable,
    segment_count: int,
    dt: float,
    gravity: float,
    *,
    held: bool,
    values: bool = False,
) -> str:
    """Return the model as XML, with the cable straight along y from the origin.

    Stiffness, masses, friction and damping are those of the cable where `values` is set, which then
    lies on the table; otherwise placeholders of 1 that the engine replaces for each world. Linear
    damping, which MJCF refuses the nodes of a flex, is 0. `held` is true where the far end is
    driven along a path, too.
    """
    count = segment_count
    length = cable.length / count
    second_moment = math.pi * cable.radius**4 / 4
    bend = twist = viscosity = roll_inertia = 1.0
    mass, roll_damping = np.ones(count + 1), 0.0
    friction, height = "1 0.001 0.001", 0.0
    if values:
        params = cable.params
        segment_mass = float(params.mass) / count
        mass = np.full(count + 1, segment_mass)
        mass[-1] = 0.5 * segment_mass + float(params.endpoint_mass)
        bend, twist = float(params.bend_stiffness), float(params.twist_stiffness)
        roll_inertia = max(0.5 * segment_mass * cable.radius**2, _ROLL_INERTIA_MIN)
        roll_damping = float(params.angular_damping) * roll_inertia
        diffusivity = float(params.angular_damping) * (cable.length / REFERENCE_SEGMENT_COUNT) ** 2
        viscosity = diffusivity / 12 * segment_mass / length**2
        arms = (params.friction, params.spinning_friction, params.rolling_friction)
        friction = " ".join(f"{max(float(arm), 1e-5):.9g}" for arm in arms)
        height = cable.radius
    hand_joints = ("slide 1 0 0", "slide 0 1 0", "slide 0 0 1", "hinge 0 0 -1", "hinge 1 0 0")
    joints, servos, bodies, rolls, tendons = [], [], [], [], []
    for index, joint in enumerate(hand_joints):
        kind, axis = joint.split(" ", 1)
        joints.append(f'<joint name="hand_{index}" type="{kind}" axis="{axis}"/>')
        servos.append(f'<position joint="hand_{index}" {_SERVO}/>')
    for node in range(1, count + 1):
        driven = held and node == count
        slides = "".join(
            f'<joint name="node_{node}_{c}" type="slide" axis="{axis}"/>'
            for c, axis in enumerate(("1 0 0", "0 1 0", "0 0 1"))
        )
        bodies.append(
            f'<body name="node_{node}" pos="0 {node * length:.17g} {height:.17g}" '
            f'gravcomp="{int(driven)}">'
            f'<inertial pos="0 0 0" mass="{mass[node]:.9g}" diaginertia="1e-9 1e-9 1e-9"/>'
            f"{slides}</body>"
        )
        # MuJoCo finds the roll joint of each edge by these names.
        name = "cable_twist" if node == count else f"cable_twist_{node}"
        rolls.append(
            f'<body name="{name}"><inertial pos="0 0 0" mass="1e-9" '
            f'diaginertia="{roll_inertia:.9g} {roll_inertia:.9g} {roll_inertia:.9g}"/>'
            f'<joint name="{name}" type="hinge" axis="0 1 0" damping="{roll_damping:.9g}"/></body>'
        )
        for c in range(3):
            before = f"hand_{c}" if node == 1 else f"node_{node - 1}_{c}"
            tendons.append(
                f'<fixed damping="{viscosity:.9g}"><joint joint="{before}" coef="-1"/>'
                f'<joint joint="node_{node}_{c}" coef="1"/></fixed>'
            )
            if driven:
                servos.append(f'<position joint="node_{node}_{c}" {_SERVO}/>')
    names = " ".join(["hand", "hand", *(f"node_{node}" for node in range(1, count + 1))])
    vertices = f"0 {-_STUB * length:.17g} 0 " + "0 0 0 " * (count + 1)
    elements = " ".join(f"{edge} {edge + 1}" for edge in range(count + 1))
    contact_time = max(_CONTACT_TIME, dt)
    return f"""<mujoco model="cablecast cable">
<option integrator="discrete" timestep="{dt:.17g}" cone="elliptic" iterations="100"
        tolerance="{_TOLERANCE}" ls_tolerance="1e-6" gravity="0 0 {-gravity:.17g}">
  <flag autoreset="disable"/>
</option>
<worldbody>
  <geom name="table" type="plane" size="0 0 1"/>
  <body name="hand" pos="0 0 {height:.17g}" gravcomp="1">
    <inertial pos="0 0 0" mass="{HAND_MASS}"
              diaginertia="{HAND_MASS} {HAND_MASS} {HAND_MASS}"/>{"".join(joints)}
  </body>
  {"".join(bodies)}
  {"".join(rolls)}
</worldbody>
<deformable>
  <flex name="cable" dim="1" radius="{cable.radius:.17g}" body="{names}" vertex="{vertices}"
        element="{elements}">
    <contact condim="6" friction="{friction}" priority="1" solref="{contact_time:.17g} 1"
             solimp="{_SOLIMP}" selfcollide="none"/>
    <elasticity young="{bend / second_moment:.17g}"
                shear="{0.5 * twist / second_moment:.17g}" damping="0"/>
  </flex>
</deformable>
<equality><flex flex="cable" solref="{dt:.17g} 1" solimp="{_SOLIMP}"/></equality>
<tendon>{"".join(tendons)}</tendon>
<actuator>{"".join(servos)}</actuator>
</mujoco>"""


DEFAULT_SEGMENT_COUNT = 20
DEFAULT_DT = 1e-3

GROUP_SIZE = 128
"""Number of worlds in memory at once."""

_STEPS_PER_CALL = 200
_ROLL_INERTIA_MIN = 1e-11
_ROLL_INERTIA_HELD = 1.0

# Layout of MuJoCo 4's flex_bending: the number of records, then for each inner vertex ten values,
# of which these are the stiffness of bending and of twist over the sum of the edges' lengths.
_RECORD, _RECORD_BEND, _RECORD_TWIST = 10, 4, 8

_BROKEN_DISTANCE = 1e3
"""Distance of a node from the base [m] beyond which its world has blown up."""


class EngineMujoco:
    """MuJoCo's discrete elastic rod, with all worlds on a pool of threads.

    The result of a world depends neither on its neighbours nor on the number of threads.

    Args:
        segment_count: Number of segments, at least 2.
        dt: Step [s].
        thread_count: CPU threads; by default all cores that this process may use.
        gravity: Acceleration of free fall [m/s²].
        rolling: True where segments may roll about their axis; otherwise they only slide.

    Raises:
        InputError: A count or step out of bounds.
        MissingExtraError: MuJoCo is not installed.
    """

    def __init__(
        self,
        segment_count: int = DEFAULT_SEGMENT_COUNT,
        dt: float = DEFAULT_DT,
        thread_count: int | None = None,
        gravity: float = GRAVITY,
        *,
        rolling: bool = True,
    ):
        segment_count = check_count("segment_count", segment_count, 2, 500)
        dt = check_number("dt", dt, 1e-6, 1e-2, "s")
        if thread_count is not None:
            check_count("thread_count", thread_count, 1, 1024)
        try:
            import mujoco.batch  # noqa: F401
        except ModuleNotFoundError:
            raise MissingExtraError("mujoco", "mujoco", "EngineMujoco") from None
        self.segment_count = segment_count
        self.dt = dt
        self.gravity = gravity
        self.rolling = rolling
        self.thread_count = thread_count or core_count()
        self._models: dict[tuple, Any] = {}

    def spec(self) -> tuple[type, dict[str, Any]]:
        """Return the class and the arguments that make this engine anew in another process."""
        names = ("segment_count", "dt", "gravity", "rolling")
        return type(self), {name: getattr(self, name) for name in names} | {"thread_count": 1}

    def rollout(
        self,
        cable: Cable | Sequence[Cable],
        grip_path: GripPath,
        initial_state: CableState | None = None,
        duration: float | None = None,
        sample_dt: float = 0.1,
        *,
        far_path: GripPath | None = None,
        edges: Workspace | None = None,
        record_nodes: bool = False,
    ) -> Rollout:
        """Simulate a batch; see `Engine.rollout`."""
        cable = one_cable(cable)
        plan = plan_rollout(self, cable, grip_path, initial_state, duration, sample_dt, far_path)
        model = self._model(cable, held=far_path is not None)
        values = np.broadcast_to(cable.params.to_array(), (plan.world_count, len(PARAMS)))
        nodes = np.full((plan.world_count, plan.sample_count, self.segment_count + 1, 3), np.nan)
        final = CableState.at_rest(np.full_like(nodes[:, 0], np.nan))
        for start in range(0, plan.world_count, GROUP_SIZE):
            worlds = np.arange(start, min(start + GROUP_SIZE, plan.world_count))
            rows = {
                field.name: _rows(getattr(plan.initial_state, field.name), worlds)
                for field in dataclasses.fields(CableState)
            }
            group = _Group(self, model, cable, CableParams.from_array(values[worlds]))
            group.start(
                CableState(**rows),
                _path_rows(grip_path, worlds),
                None if far_path is None else _path_rows(far_path, worlds),
            )
            with quiet():
                nodes[worlds] = group.run(plan.sample_count, plan.steps_per_sample)
            state = group.state()
            for field in dataclasses.fields(CableState):
                getattr(final, field.name)[worlds] = getattr(state, field.name)
        finite = np.asarray(np.isfinite(nodes).all(axis=(1, 2, 3)))
        return Rollout(
            times=np.arange(plan.sample_count, dtype=np.float64)
            * (plan.steps_per_sample * self.dt),
            endpoint_xyz=nodes[:, :, -1].copy(),
            final_state=final,
            finite=finite,
            nodes=nodes if record_nodes else None,
        )

    def _model(self, cable: Cable, held: bool) -> Any:
        """Return the compiled model of a geometry; parameters are set per world later."""
        key = (cable.length, cable.radius, held)
        if key not in self._models:
            from mujoco import MjModel  # pyright: ignore[reportAttributeAccessIssue]

            xml = rod_model(cable, self.segment_count, self.dt, self.gravity, held=held)
            self._models[key] = MjModel.from_xml_string(xml)
        return self._models[key]


class _Group:
    """Worlds that are stepped together; their parameters differ in some fields of the model."""

    def __init__(self, engine: EngineMujoco, model: Any, cable: Cable, params: CableParams):
        from mujoco.batch import Batch

        count = engine.segment_count
        self.engine = engine
        self.model = model
        self.world_count = params.world_count or 1
        self.segment_length = cable.length / count
        self.rest = np.zeros((count, 3))
        self.rest[:, 1] = np.arange(1, count + 1) * self.segment_length
        self.slides = slice(HAND_DOF_COUNT, HAND_DOF_COUNT + 3 * count)
        self.rolls = slice(HAND_DOF_COUNT + 3 * count, model.nv)
        threads = min(engine.thread_count, self.world_count)
        self.batch: Any = Batch(model, self.world_count, threads)
        self.qpos = self.batch.bind("qpos")
        self.qvel = self.batch.bind("qvel")
        self.plastic = self.batch.bind("plastic")
        self._set_params(cable, params)

    def _set_params(self, cable: Cable, params: CableParams) -> None:
        batch, count = self.batch, self.engine.segment_count
        held = self.model.nu > HAND_DOF_COUNT
        column = {name: values[:, None] for name, values in params.to_columns().items()}
        segment_mass = column["mass"] / count
        mass = np.repeat(segment_mass, count, axis=1)
        mass[:, -1:] = 0.5 * segment_mass + column["endpoint_mass"]
        if held:
            mass[:, -1] = HAND_MASS
        roll_inertia = np.maximum(0.5 * segment_mass * cable.radius**2, _ROLL_INERTIA_MIN)
        if not self.engine.rolling:
            roll_inertia[:] = _ROLL_INERTIA_HELD
        # Bodies are the world, the hand, the nodes, and the rolls.
        batch.expand("body_mass")[:, 2 : 2 + count] = mass
        batch.expand("body_inertia")[:, 2 + count :] = roll_inertia[:, :, None]
        damping = batch.expand("dof_damping")
        damping[:, self.slides] = np.repeat(column["linear_damping"] * mass, 3, axis=1)
        damping[:, self.rolls] = column["angular_damping"] * roll_inertia
        if held:
            damping[:, self.slides.stop - 3 : self.slides.stop] = 0.0
        diffusivity = column["angular_damping"] * (cable.length / REFERENCE_SEGMENT_COUNT) ** 2 / 12
        batch.expand("tendon_damping")[:] = diffusivity * segment_mass / self.segment_length**2
        friction = batch.expand("flex_friction").reshape(self.world_count, 3)
        friction[:, 0] = params.friction
        friction[:, 1] = params.spinning_friction
        friction[:, 2] = params.rolling_friction if self.engine.rolling else 0.0
        # The model was compiled with unit stiffness of bending and of twist.
        records = batch.expand("flex_bending")[:, 1:].reshape(self.world_count, -1, _RECORD)
        records[:, :, _RECORD_BEND] *= column["bend_stiffness"]
        twist = column["twist_stiffness"] if self.engine.rolling else 0.0
        records[:, :, _RECORD_TWIST] *= twist
        batch.expand("flex_bending")[:, 1:] = records.reshape(self.world_count, -1)
        batch.set_const()

    def start(self, state: CableState, grip_path: GripPath, far_path: GripPath | None) -> None:
        """Put the cables into a state, gripped at the start of their paths."""
        worlds = self.world_count
        self.paths = [(grip_path, slice(0, HAND_DOF_COUNT))]
        if far_path is not None:
            self.paths.append((far_path, slice(0, 3)))
        self.qpos[:, self.slides] = (state.positions[:, 1:] - self.rest).reshape(worlds, -1)
        self.qvel[:, self.slides] = state.velocities[:, 1:].reshape(worlds, -1)
        self.qpos[:, self.rolls] = state.roll
        self.qvel[:, self.rolls] = state.roll_rate
        zero = np.zeros(1)
        self.driven = np.concatenate([p.evaluate(zero)[:, 0, c] for p, c in self.paths], axis=1)
        self.speed = np.concatenate([p.evaluate(zero, 1)[:, 0, c] for p, c in self.paths], axis=1)
        self.qpos[:, :HAND_DOF_COUNT] = self.driven[:, :HAND_DOF_COUNT]
        self.qvel[:, :HAND_DOF_COUNT] = self.speed[:, :HAND_DOF_COUNT]
        self.origin = np.zeros(self.model.nu)
        if far_path is not None:
            last = slice(self.slides.stop - 3, self.slides.stop)
            self.origin[HAND_DOF_COUNT:] = self.rest[-1]
            self.qpos[:, last] = self.driven[:, HAND_DOF_COUNT:] - self.rest[-1]
            self.qvel[:, last] = self.speed[:, HAND_DOF_COUNT:]
        self.broken = ~(np.isfinite(self.qpos).all(axis=1) & np.isfinite(self.qvel).all(axis=1))

    def run(self, sample_count: int, steps_per_sample: int) -> NDArray[np.float64]:
        """Simulate, and return the cable's shapes at the sample times.

        Returns:
            Nodes [m], NaN once a world is broken, shape [world, step, node, 3].
        """
        shape = (self.world_count, sample_count, self.engine.segment_count + 1, 3)
        nodes = np.full(shape, np.nan)
        step = 0
        for sample in range(sample_count):
            if sample > 0:
                end = step + steps_per_sample
                while step < end:
                    chunk = min(_STEPS_PER_CALL, end - step)
                    self._advance(step, chunk)
                    step += chunk
            now = self._nodes()
            with np.errstate(invalid="ignore"):
                self.broken |= ~(np.abs(now).max(axis=(1, 2)) < _BROKEN_DISTANCE)
            nodes[~self.broken, sample] = now[~self.broken]
        return nodes

    def _advance(self, step: int, count: int) -> None:
        from mujoco.batch import SimulationError

        dt = self.engine.dt
        times = (step + 1 + np.arange(count)) * dt
        poses = np.concatenate([p.evaluate(times)[:, :, c] for p, c in self.paths], axis=2)
        # A semi-implicit step ends at q + dt v with the new v, so the velocity that belongs to a
        # step is the backward difference; the servo learns of it, and of the acceleration, through
        # its position target.
        velocity = np.diff(poses, axis=1, prepend=self.driven[:, None]) / dt
        acceleration = np.diff(velocity, axis=1, prepend=self.speed[:, None]) / dt
        self.driven, self.speed = poses[:, -1], velocity[:, -1]
        control = poses - self.origin + 2.0 * velocity / SERVO_OMEGA
        control += acceleration / SERVO_OMEGA**2
        active = np.flatnonzero(~self.broken)
        if not len(active):
            return
        try:
            self.batch.rollout(count, control=control[active], record=(), ids=active)
        except SimulationError as error:
            self.broken[np.asarray(error.ids, dtype=int)] = True
        # A world that MuJoCo warns of has stopped.
        warned = self.batch.warning[active].reshape(len(active), -1).any(axis=1)
        self.broken[active[warned]] = True

    def _nodes(self) -> NDArray[np.float64]:
        nodes = np.empty((self.world_count, self.engine.segment_count + 1, 3))
        nodes[:, 0] = self.qpos[:, :3]
        nodes[:, 1:] = self.qpos[:, self.slides].reshape(self.world_count, -1, 3) + self.rest
        return nodes

    def state(self) -> CableState:
        """Return the present state; NaN where a world is broken.

        MuJoCo counts the roll from frames that are carried along in time, and keeps the twist
        between them; ours is counted from frames carried along the cable from the grip.
        """
        count = self.engine.segment_count
        positions = self._nodes()
        velocities = np.empty_like(positions)
        velocities[:, 0] = self.qvel[:, :3]
        velocities[:, 1:] = self.qvel[:, self.slides].reshape(self.world_count, -1, 3)
        reference = self.plastic[:, -count:]
        state = CableState(
            positions=positions,
            velocities=velocities,
            roll=self.qpos[:, self.rolls] + np.cumsum(reference, axis=1),
            roll_rate=np.array(self.qvel[:, self.rolls]),
        )
        for field in dataclasses.fields(CableState):
            getattr(state, field.name)[self.broken] = np.nan
        return state


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Keep MuJoCo from writing its warnings to a log file in the working directory.

    A world that it warns of is marked instead.
    """
    import mujoco

    library: Any = mujoco
    handler = library.get_mju_user_warning()
    library.set_mju_user_warning(lambda message: None)
    try:
        yield
    finally:
        library.set_mju_user_warning(handler)


def _rows(values: NDArray, worlds: NDArray[np.intp]) -> NDArray:
    return values[worlds] if len(values) > 1 else np.repeat(values, len(worlds), axis=0)


def _path_rows(path: GripPath, worlds: NDArray[np.intp]) -> GripPath:
    return path[worlds if len(path) > 1 else np.zeros_like(worlds)]
