"""Forces on the cable that MuJoCo's rod does not have: air, the table's face, and memory.

MuJoCo knows one friction coefficient for the whole cable. The table here is covered with foam
boards that are not all alike, worn here and there, with seams between; along the cable it is
smoother than across; at a creep it holds more than in motion, and its boards' edges stand up. The
difference is added where the cable's surface slides. A rod of MuJoCo's is straight at rest, and
elastic. A real one keeps a curl, and some of every sharp bend; and its strands rub against each
other, so that its moment depends on how it came to be bent.

One thread computes one cable, from its free end towards the grip, so that what a vertex takes from
its neighbours is at hand. Multiplications and additions are not fused: a trial's numbers are the
same on every processor, and whatever else runs.
"""

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false
# pyright: reportAttributeAccessIssue=false, reportArgumentType=false
# pyright: reportGeneralTypeIssues=false

import dataclasses
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from cablecast.cable import AIR_DENSITY, Cable
from cablecast.conventions import GRAVITY, Array
from cablecast.rigs.virtual._hidden import HiddenCable, HiddenTable
from cablecast.rigs.virtual.scene import CableMotion
from cablecast.runs.kernels import start_warp
from cablecast.workspace import Workspace

CELL = 0.005
"""Resolution of the map [m]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FrictionMap:
    """Friction of each place of the table, as a multiple of the mean.

    Attributes:
        origin: Corner of the map with the smallest x and y [m], shape [2].
        factors: Factor of each cell [-], shape [x, y].
        rises: Height that a step towards +x, and one towards +y, gains in each cell, over the width
            of a seam [m], shape [2, x, y]; [2, 1, 1] for a flat table.
        seam_width: Width of a seam [m].
    """

    origin: Array
    factors: Array
    rises: Array
    seam_width: float


def friction_map(table: HiddenTable, workspace: Workspace) -> FrictionMap:
    """Draw the face of a table, which moves and turns with it."""
    origin = np.array([-workspace.half_width, workspace.y_min])
    size = np.array([2 * workspace.half_width, workspace.y_max - workspace.y_min])
    quarter_turns = round(workspace.table_yaw_deg / 90.0) % 4
    factors, rises = _face(table, size[::-1] if quarter_turns % 2 else size)
    for _ in range(quarter_turns):
        # Turned to the right, which is against the sense of rot90: what was y ahead is x.
        factors = np.rot90(factors, -1)
        rises = np.stack([np.rot90(rises[1], -1), -np.rot90(rises[0], -1)])
    return FrictionMap(origin=origin, factors=factors, rises=rises, seam_width=table.seam_width)


def _face(table: HiddenTable, size: Array) -> tuple[Array, Array]:
    """Return factors and rises of a table of some extent [m] that is not turned."""
    rng = np.random.default_rng(table.seed)
    origin = np.array([-float(size[0]) / 2, 0.0])
    counts = [round(float(extent) / CELL) + 1 for extent in size]
    x, y = (origin[axis] + (np.arange(counts[axis]) + 0.5) * CELL for axis in (0, 1))
    worn = np.zeros((len(x), len(y)))
    # A sum of waves in random directions is a smooth random field.
    for _ in range(table.wave_count):
        wave = rng.normal(size=2) / table.wear_length
        phase = rng.uniform(0.0, 2 * np.pi)
        worn += np.cos(wave[0] * x[:, None] + wave[1] * y + phase)
    worn *= table.wear * np.sqrt(2.0 / table.wave_count)
    column, from_x = _boards(x, origin[0] + table.first_seam[0], table.board_size[0])
    row, from_y = _boards(y, table.first_seam[1], table.board_size[1])
    boards = table.board * rng.normal(size=(column.max() + 1, row.max() + 1))
    factors = np.exp(worn + boards[column[:, None], row])
    seam = np.minimum(from_x[:, None], from_y) < table.seam_width / 2
    factors[seam] *= 1.0 + table.seam
    if table.edge == 0.0:
        return factors, np.zeros((2, 1, 1))
    heights = table.edge * rng.normal(size=boards.shape)
    rises = np.zeros((2, *factors.shape))
    # On a seam the board before and the one behind differ; elsewhere the nearest cells are one.
    reach = max(1, round(table.seam_width / 2 / CELL))
    for axis, near in ((0, from_x), (1, from_y)):
        face = np.moveaxis(heights[column[:, None], row], axis, 0)
        index = np.arange(len(face))
        ahead, behind = np.minimum(index + reach, len(face) - 1), np.maximum(index - reach, 0)
        step = np.where(near[:, None] < table.seam_width / 2, face[ahead] - face[behind], 0.0)
        rises[axis] = np.moveaxis(step, 0, axis)
    return factors, rises


def _boards(places: Array, first: float, size: float) -> tuple[NDArray[np.intp], Array]:
    """Return the index of the board at each place, and the distance to its nearest seam [m]."""
    board = np.floor((places - first) / size)
    within = (places - first) - board * size
    return (board - board.min()).astype(np.intp), np.minimum(within, size - within)


wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_SLIP_SPEED = wp.constant(wp.float64(0.01))
"""Sliding speed below which the correction of the friction fades out [m/s]: at rest MuJoCo's own
contact holds the cable."""
_TOUCH = wp.constant(wp.float64(0.001))
"""Largest height above its lying place at which a vertex touches the table [m]."""
_STEEP = wp.constant(wp.float64(0.3))
"""Horizontal share of the direction below which the upper side is not well defined [-]: that of a
cable steeper than about 70 deg."""
_TENSION_MAX = wp.constant(wp.float64(5.0))
"""Largest tension that counts for the strands [N]: accelerations are rough at impacts."""
_TINY = wp.constant(wp.float64(1e-12))


@wp.struct
class LabState:
    """Where the active cables are, and how they move.

    Attributes:
        vertices: Positions up to the endpoint [m], shape [active, vertex].
        velocity: Velocities of the vertices [m/s], same shape.
        cos_roll: Cosine of the roll of each edge but the gripped one [-], shape
            [active, edge - 1].
        sin_roll: Sine of that roll [-], same shape.
        roll_rate: Rate of that roll [rad/s], same shape.
    """

    vertices: wp.array2d[wp.vec3d]
    velocity: wp.array2d[wp.vec3d]
    cos_roll: wp.array2d[wp.float64]
    sin_roll: wp.array2d[wp.float64]
    roll_rate: wp.array2d[wp.float64]


@wp.struct
class CableProperties:
    """Properties that all cables share.

    Attributes:
        radius: Radius of the cable [m].
        grain: Half the relative difference of friction along and across the cable [-].
        yield_curvature: Curvature beyond which the cable yields [1/m].
        yield_time: Time in which an excess of curvature decays [s].
        strand_share: Share of the bending stiffness that is lost where all strands slip [-].
        slip_curvature: Bend at which strands without tension slip [1/m].
        slip_tension: Tension that doubles it [N]; 0 for none.
        tip_mass: Mass of the attachment [kg].
        edge: Lengths of the edges [m], shape [edge].
        weight: Weight of each free vertex [N], shape [vertex - 2].
        drag: Drag of each edge per squared speed [N s^2/m^2], shape [edge].
        damping: Linear damping of each free vertex [N s/m], shape [vertex - 2].
        stiffness: Bending stiffness at each inner vertex [N m^2], shape [vertex - 2].
    """

    radius: wp.float64
    grain: wp.float64
    yield_curvature: wp.float64
    yield_time: wp.float64
    strand_share: wp.float64
    slip_curvature: wp.float64
    slip_tension: wp.float64
    tip_mass: wp.float64
    edge: wp.array[wp.float64]
    weight: wp.array[wp.float64]
    drag: wp.array[wp.float64]
    damping: wp.array[wp.float64]
    stiffness: wp.array[wp.float64]


@wp.struct
class TableProperties:
    """Friction of the table's face, and its steps.

    Attributes:
        friction: Mean Coulomb coefficient of the table at rest [-].
        applied: Coulomb coefficient that MuJoCo applies [-], shape [world].
        static_excess: Static friction in excess of kinetic friction [-].
        stribeck_speed: Speed at which that excess has fallen to 1 / e [m/s].
        friction_rise: Rise of friction with the sliding speed [s/m].
        origin: Corner of the map with the smallest x and y [m].
        cell: Resolution of the map [m].
        seam_width: Width of a step between boards [m].
        factors: Map of the friction [-], shape [x, y].
        rises: Steps of the table [m], shape [2, x, y].
    """

    friction: wp.float64
    applied: wp.array[wp.float64]
    static_excess: wp.float64
    stribeck_speed: wp.float64
    friction_rise: wp.float64
    origin: wp.vec2d
    cell: wp.float64
    seam_width: wp.float64
    factors: wp.array2d[wp.float64]
    rises: wp.array3d[wp.float64]


@wp.struct
class CableMemory:
    """What the cables keep from one evaluation to the next.

    Attributes:
        curl: Curvature at rest, sideways and upwards [1/m], shape [world, 2, vertex - 2].
        strands: Elastic bend at the last evaluation and slip of the strands, each sideways and
            upwards [1/m], shape [world, 4, vertex - 2].
        velocity: Velocities at the last evaluation [m/s], shape [world, vertex - 2].
    """

    curl: wp.array3d[wp.float64]
    strands: wp.array3d[wp.float64]
    velocity: wp.array2d[wp.vec3d]


@wp.func
def _dot(a: wp.vec3d, b: wp.vec3d):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@wp.func
def _direction(behind: wp.vec3d, ahead: wp.vec3d):
    edge = ahead - behind
    return edge / wp.sqrt(_dot(edge, edge))


@wp.func
def _cell(place: wp.float64, origin: wp.float64, size: wp.float64, count: int):
    """Return the index of a map's cell; beyond the rim that of the rim."""
    index = wp.floor((place - origin) / size)
    # A cable that has blown up has no place.
    if not wp.isfinite(index):
        return int(0)
    return int(wp.clamp(index, wp.float64(0.0), wp.float64(count - 1)))


@wp.func
def _local_friction(place: wp.vec3d, table: TableProperties):
    """Return the mean Coulomb coefficient at a place of the table [-]."""
    x = _cell(place[0], table.origin[0], table.cell, table.factors.shape[0])
    y = _cell(place[1], table.origin[1], table.cell, table.factors.shape[1])
    return table.friction * table.factors[x, y]


@wp.func
def _air(velocity: wp.vec3d, ahead: wp.vec3d, direction: wp.vec3d, drag: wp.float64):
    """Return half the drag of an edge, quadratic in its normal velocity [N]."""
    v = (velocity + ahead) / wp.float64(2.0)
    v = v - _dot(v, direction) * direction
    return -(drag * wp.sqrt(_dot(v, v))) * v / wp.float64(2.0)


@wp.func
def _slide(
    place: wp.vec3d,
    v: wp.vec3d,
    direction: wp.vec3d,
    rolling: wp.float64,
    weight: wp.float64,
    base: wp.float64,
    local: wp.float64,
    cable: CableProperties,
    table: TableProperties,
):
    """Return the difference between the friction of a place and direction and MuJoCo's [N].

    With s the sliding velocity of the cable's underside, t along and n across the cable, the table
    pulls with -weight (mu_along s_t t + mu_across s_n n) / |s|; MuJoCo does so with one
    coefficient, and this is the difference.
    """
    one = wp.float64(1.0)
    size = wp.sqrt(direction[0] * direction[0] + direction[1] * direction[1] + _TINY)
    x, y = direction[0] / size, direction[1] / size
    slip_along = v[0] * x + v[1] * y
    # Across is to the right of the cable; a positive roll carries its underside to the left.
    slip_across = v[0] * y - v[1] * x
    slip_across = slip_across - cable.radius * rolling
    speed2 = slip_along * slip_along + slip_across * slip_across
    pull = wp.float64(0.0)
    if place[2] < cable.radius + _TOUCH and place[2] > wp.float64(0.0):
        pull = weight
    pull = pull / wp.sqrt(speed2 + _SLIP_SPEED * _SLIP_SPEED)
    # MuJoCo applies static friction; it falls with the speed, and rises again.
    scale = base / table.friction
    if table.static_excess > wp.float64(0.0):
        speed = wp.sqrt(speed2)
        fall = table.static_excess * wp.exp(-speed / table.stribeck_speed)
        now = one + fall + table.friction_rise * speed
        scale = scale * now / (one + table.static_excess)
    along = -pull * (scale * local * (one - cable.grain) - base) * slip_along
    across = -pull * (scale * local * (one + cable.grain) - base) * slip_across
    return wp.vec3d(along * x + across * y, along * y - across * x, wp.float64(0.0))


@wp.func
def _edge(
    place: wp.vec3d,
    v: wp.vec3d,
    weight: wp.float64,
    cable: CableProperties,
    table: TableProperties,
):
    """Return the force of a step between two boards on a vertex that passes over it [N].

    The weight is lifted over the width of a seam. A round cable of radius r that meets a step of
    height h loses the part sin² = 2 h / r of its speed towards it, all where it goes up.
    """
    x = _cell(place[0], table.origin[0], table.cell, table.rises.shape[1])
    y = _cell(place[1], table.origin[1], table.cell, table.rises.shape[2])
    force = wp.vec3d()
    if place[2] < cable.radius + _TOUCH and place[2] > wp.float64(0.0):
        for axis in range(2):
            rise = table.rises[axis, x, y]
            push = -weight * rise / table.seam_width
            if rise * v[axis] > wp.float64(0.0):
                share = wp.min(wp.float64(2.0) * wp.abs(rise) / cable.radius, wp.float64(1.0))
                mass = weight / wp.float64(GRAVITY)
                push = push - mass * wp.abs(v[axis]) * v[axis] * share / table.seam_width
            force[axis] = push
    return force


@wp.func
def _moment(
    behind: wp.vec3d,
    ahead: wp.vec3d,
    cos: wp.float64,
    sin: wp.float64,
    cell: wp.float64,
    elapsed: wp.float64,
    tension: wp.float64,
    cable: CableProperties,
    memory: CableMemory,
    world: int,
    vertex: int,
):
    """Return the moment EI kappa_0 of the curl at a vertex [N m], after letting it creep.

    The elastic moment is EI (kappa - kappa_0); MuJoCo applies EI kappa. As a material with a yield
    stress and a viscosity, d kappa_0 / dt = (excess of |kappa - kappa_0|) / time.
    The directions of the edges behind and ahead, the cosine and sine of the roll of the latter,
    and the length [m] that belongs to the vertex are given.
    """
    one = wp.float64(1.0)
    bent = wp.max(one + _dot(ahead, behind), wp.float64(0.1))
    curvature = wp.cross(behind, ahead) * (wp.float64(2.0) / (bent * cell))
    # The cable's upper and right-hand side, turned by its roll.
    t = ahead + behind
    t = t / wp.sqrt(_dot(t, t) + _TINY)
    above = -t[2] * t
    above = wp.vec3d(above[0], above[1], above[2] + one)
    above = above / wp.max(wp.sqrt(_dot(above, above)), _STEEP)
    right = wp.cross(t, above)
    up = cos * above + sin * right
    side = cos * right - sin * above
    # A curl to the side turns the cable about its upward side, one upwards about the other.
    sideways = _dot(curvature, up) - memory.curl[world, 0, vertex]
    upwards = _dot(curvature, side) - memory.curl[world, 1, vertex]
    size = wp.sqrt(sideways * sideways + upwards * upwards)
    excess = wp.max(size - cable.yield_curvature, wp.float64(0.0))
    share = wp.min(elapsed / cable.yield_time, one) * excess / wp.max(size, wp.float64(1e-9))
    memory.curl[world, 0, vertex] = memory.curl[world, 0, vertex] + sideways * share
    memory.curl[world, 1, vertex] = memory.curl[world, 1, vertex] + upwards * share
    rest_sideways = wp.float64(memory.curl[world, 0, vertex])
    rest_upwards = wp.float64(memory.curl[world, 1, vertex])
    if cable.strand_share > wp.float64(0.0):
        # The bend at the last evaluation, then what has slipped since the start.
        by_sideways = sideways - memory.strands[world, 0, vertex]
        by_upwards = upwards - memory.strands[world, 1, vertex]
        memory.strands[world, 0, vertex] = sideways
        memory.strands[world, 1, vertex] = upwards
        turn = wp.sqrt(by_sideways * by_sideways + by_upwards * by_upwards)
        limit = cable.slip_curvature
        if cable.slip_tension > wp.float64(0.0):
            limit = limit * (one + tension / cable.slip_tension)
        # Dahl's law: the bend that strands carry grows with the curvature and saturates at a limit.
        part = wp.min(turn / limit, one)
        slip = wp.float64(memory.strands[world, 2, vertex])
        slip_up = wp.float64(memory.strands[world, 3, vertex])
        slip = slip + (sideways - slip) * part
        slip_up = slip_up + (upwards - slip_up) * part
        memory.strands[world, 2, vertex] = slip
        memory.strands[world, 3, vertex] = slip_up
        rest_sideways = rest_sideways + cable.strand_share * slip
        rest_upwards = rest_upwards + cable.strand_share * slip_up
    moment = rest_sideways * up + rest_upwards * side
    return cable.stiffness[vertex] * moment


@wp.kernel
def sum_forces(
    worlds: wp.array[wp.int32],
    elapsed: wp.float64,
    state: LabState,
    cable: CableProperties,
    table: TableProperties,
    memory: CableMemory,
    force: wp.array2d[wp.vec3d],
):
    """Sum the forces on the vertices after the gripped two of each active cable.

    Args:
        worlds: Index of each active cable in the batch, shape [active].
        elapsed: Time since the last evaluation [s], in which the cable yields.
        state: Where the active cables are, and how they move.
        cable: Properties of the cables.
        table: Friction and steps of the table.
        memory: What the cables keep from one evaluation to the next.
        force: Forces to fill [N], shape [active, vertex - 2].
    """
    row = wp.tid()
    world = worlds[row]
    count = force.shape[1]
    ahead, half_ahead = wp.vec3d(), wp.vec3d()
    moment_ahead, push_ahead = wp.vec3d(), wp.vec3d()
    here = _direction(state.vertices[row, count], state.vertices[row, count + 1])
    # What the outer part of the cable takes to be moved as it is: the edge pulls it with that.
    taken = wp.vec3d()
    for back in range(count):
        free = count - 1 - back
        is_last = back == 0
        place = state.vertices[row, free + 2]
        v = state.velocity[row, free + 2]
        behind = _direction(state.vertices[row, free], state.vertices[row, free + 1])
        half = _air(state.velocity[row, free + 1], v, here, cable.drag[free + 1])
        total = half - cable.damping[free] * v
        along = here
        rolling = state.roll_rate[row, free]
        weight = cable.weight[free]
        if not is_last:
            total = total + half_ahead
            along = here + ahead
            rolling = (rolling + state.roll_rate[row, free + 1]) / wp.float64(2.0)
        local = _local_friction(place, table)
        base = table.applied[world]
        total = total + _slide(place, v, along, rolling, weight, base, local, cable, table)
        if table.rises.shape[1] > 1:
            total = total + _edge(place, v, weight, cable, table)
        tension = wp.float64(0.0)
        if cable.slip_tension > wp.float64(0.0):
            mass = weight / wp.float64(GRAVITY)
            if is_last:
                mass = mass + cable.tip_mass
            rate = (v - memory.velocity[world, free]) / wp.max(elapsed, wp.float64(1e-6))
            memory.velocity[world, free] = v
            load = mass * rate
            if place[2] < cable.radius + _TOUCH:
                speed = wp.sqrt(_dot(v, v) + _SLIP_SPEED * _SLIP_SPEED)
                load = load + (mass * wp.float64(GRAVITY) * local / speed) * v
            else:
                load = load + wp.vec3d(wp.float64(0.0), wp.float64(0.0), mass * wp.float64(GRAVITY))
            taken = taken + load
            tension = wp.clamp(-_dot(taken, here), wp.float64(0.0), _TENSION_MAX)
        cell = (cable.edge[free + 1] + cable.edge[free]) / wp.float64(2.0)
        cos, sin = state.cos_roll[row, free], state.sin_roll[row, free]
        moment = _moment(behind, here, cos, sin, cell, elapsed, tension, cable, memory, world, free)
        # Each moment turns the edge behind its vertex, and the edge before it the other way.
        torque = moment
        if not is_last:
            torque = moment - moment_ahead
        push = wp.cross(torque, here) / cable.edge[free + 1]
        turned = push
        if not is_last:
            turned = push - push_ahead
        force[row, free] = total + turned
        half_ahead = half
        moment_ahead = moment
        push_ahead = push
        ahead = here
        here = behind


_OF_CABLE = (
    "grain",
    "yield_curvature",
    "yield_time",
    "strand_share",
    "slip_curvature",
    "slip_tension",
)
_OF_TABLE = ("static_excess", "stribeck_speed", "friction_rise")


class LabForces:
    """Forces on the free vertices of a batch of cables.

    Args:
        cable: Geometry of the cable.
        truth: True properties of the cable.
        friction_map: Friction of each place of the table.
        arc_lengths: Distance of each vertex from the grip [m], shape [vertex].
        masses: Mass lumped at each vertex [kg], shape [vertex].
        friction: Coulomb coefficient that MuJoCo applies [-], shape [world].
        curl: Curvature of each cable at the start, sideways and upwards [1/m], shape
            [world, 2, inner vertex].
        stiffness: Bending stiffness at each inner vertex as a multiple of the mean [-], shape
            [inner vertex]; even if None.
    """

    def __init__(
        self,
        cable: Cable,
        truth: HiddenCable,
        friction_map: FrictionMap,
        arc_lengths: Array,
        masses: Array,
        friction: Array,
        curl: Array,
        stiffness: Array | None = None,
    ):
        start_warp()
        edge = np.diff(arc_lengths)
        world_count, free_count = len(friction), len(arc_lengths) - 2
        self.curl = curl
        # Arrays of Warp's that numpy sees: nothing is allocated or copied from window to window.
        self._worlds: Any = wp.zeros(world_count, dtype=wp.int32, device="cpu")
        self._force: Any = wp.zeros((world_count, free_count), dtype=wp.vec3d, device="cpu")
        state, self._views = LabState(), []
        for name, width, dtype in (
            ("vertices", free_count + 2, wp.vec3d),
            ("velocity", free_count + 2, wp.vec3d),
            ("cos_roll", free_count, wp.float64),
            ("sin_roll", free_count, wp.float64),
            ("roll_rate", free_count, wp.float64),
        ):
            array: Any = wp.zeros((world_count, width), dtype=dtype, device="cpu")
            setattr(state, name, array)
            self._views.append(array.numpy())
        self._world_view, self._force_view = self._worlds.numpy(), self._force.numpy()
        properties = CableProperties()
        properties.radius, properties.tip_mass = cable.radius, truth.endpoint_mass
        for name in _OF_CABLE:
            setattr(properties, name, getattr(truth, name))
        properties.edge = _shared(edge)
        properties.weight = _shared(GRAVITY * masses[2:])
        properties.drag = _shared(0.5 * AIR_DENSITY * truth.drag * cable.diameter * edge)
        properties.damping = _shared(truth.linear_damping * masses[2:])
        properties.stiffness = _shared(
            truth.bend_stiffness * (np.ones(free_count) if stiffness is None else stiffness)
        )
        table = TableProperties()
        table.friction = truth.friction * (1.0 + truth.static_excess)
        for name in _OF_TABLE:
            setattr(table, name, getattr(truth, name))
        table.applied = _shared(friction)
        table.origin, table.cell = wp.vec2d(*friction_map.origin), CELL
        table.seam_width = friction_map.seam_width
        table.factors, table.rises = _shared(friction_map.factors), _shared(friction_map.rises)
        strands = np.zeros((world_count, 4, free_count))
        strands[:, :2] = -curl
        memory = CableMemory()
        memory.curl, memory.strands = _shared(curl), _shared(strands)
        memory.velocity = wp.zeros((world_count, free_count), dtype=wp.vec3d, device="cpu")
        # The launch keeps addresses; these keep what lies there.
        self._kept = state, properties, table, memory
        self._launch: Any = wp.launch(
            sum_forces,
            dim=world_count,
            inputs=[self._worlds, 0.0, *self._kept, self._force],
            device="cpu",
            record_cmd=True,
        )

    def evaluate(self, motion: CableMotion, active: NDArray[np.intp], elapsed: float) -> Array:
        """Return the forces on the vertices after the gripped two.

        Args:
            motion: Positions and velocities of the active worlds.
            active: Indices of these worlds in the batch.
            elapsed: Time since the last evaluation [s], in which the cable yields.

        Returns:
            Forces [N], shape [active, vertex - 2, 3]; the next evaluation overwrites them.
        """
        count = len(active)
        self._world_view[:count] = active
        rolls = (np.cos(motion.roll), np.sin(motion.roll), motion.roll_rate)
        values = (motion.vertices, motion.velocity, *rolls)
        for view, value in zip(self._views, values, strict=True):
            view[:count] = value
        self._launch.set_dim(count)
        self._launch.set_param_by_name("elapsed", elapsed)
        self._launch.launch()
        return self._force_view[:count]


def _shared(values: Array) -> Any:
    """Return an array of Warp's that shares its memory with numpy's."""
    return wp.array(np.ascontiguousarray(values), dtype=wp.float64, device="cpu", copy=False)
