"""Inextensibility: every segment keeps its length, by one tridiagonal solve per step (SHAKE).

Along segment s acts a tension tau[s] d[s], with d the edge at the START of the step and tau the
tension over the length, times dt^2 [kg]. With D = x*[s+1] - x*[s] the edge that the unconstrained
step leads to and w the inverse masses, one Newton iteration on |D|^2 = l^2 reads

    (w[s] + w[s+1]) (D[s].d[s]) tau[s] - w[s] (D[s].d[s-1]) tau[s-1]
        - w[s+1] (D[s].d[s+1]) tau[s+1] = (|D[s]|^2 - l^2) / 2.

The solve starts without the tension of the previous step, which a jerk would make worse than none.
One iteration is enough while edges turn little; it is repeated where more than LENGTH_TOLERANCE is
left. (Ryckaert, Ciccotti and Berendsen 1977; gradients at the start of the step are what makes the
scheme second order.)
"""

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false

import functools
from types import SimpleNamespace

import warp as wp

from cablecast.engines.warp_.lanes import lane_functions
from cablecast.engines.warp_.world import world_structs

LENGTH_TOLERANCE = 2e-4
"""Relative error of a squared segment length that is left to the next step: lengths are kept to one
part in ten thousand."""

MAX_ITERATIONS = 12
"""Bound on the Newton iterations. Two or three are enough, or the motion is far too fast for the
step."""

COMPLIANCE = 1e-6
"""Relative addition to the diagonal of the system. It yields where there is no solution: a cable
drawn straight between two held ends is as long as it can be, whatever its tension."""


@functools.cache
def length_functions(precision: str, lane_count: int) -> SimpleNamespace:
    """Build the Warp functions of the length solve."""
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
    real, lane, vec3 = f.real, f.lane, f.vec3
    dot, scale, absolute, mul, node_mass = f.dot, f.scale, f.absolute, f.mul, f.reciprocal
    Model, State, Scratch = s.Model, s.State, s.Scratch
    count = wp.constant(lane_count)
    tolerance = wp.constant(LENGTH_TOLERANCE)
    max_iterations = wp.constant(MAX_ITERATIONS)
    yielding = wp.constant(1.0 + COMPLIANCE)

    @wp.func
    def hold_lengths(model: Model, state: State, scratch: Scratch, group: int, active: lane):
        """Change velocities so that every segment has its length at the end of the step.

        Newton iterations go on until every length is right. Where the tip whips, an edge may turn
        by a third of a radian in one step, and what one iteration leaves would come back as a jolt
        in the next step. Where they fail, segments are laid out one by one.

        Args:
            state: Positions at the start of the step; velocities and tensions, which are updated.
            scratch: Holds the eliminated system.
        """
        unsolved = active
        error = lane()
        iteration = int(0)
        any_unsolved = int(0)
        edge_dt = real(0.0)
        keep = real(0.0)
        while iteration < max_iterations:
            eliminate_tensions(model, state, scratch, group, edge_dt)
            error = apply_tensions(model, state, scratch, group, edge_dt, unsolved, keep)
            # A jerk that one iteration cannot take up acts along the edges as they have turned.
            edge_dt = model.dt
            keep = real(1.0)
            iteration += 1
            unsolved = keep_beyond(unsolved, error)
            any_unsolved = int(wp.max(unsolved))
            if any_unsolved == 0:
                iteration = max_iterations
        if any_unsolved == 1:
            lay_out_segments(model, state, scratch, group, unsolved)

    @wp.func
    def keep_beyond(unsolved: lane, error: lane):
        """Return `unsolved`, but 0 for worlds whose error is within the tolerance."""
        result = lane()
        for k in range(count):
            # Not a number is not right either.
            result[k] = wp.where(error[k] <= real(tolerance), real(0.0), unsolved[k])
        return result

    @wp.func
    def eliminate_tensions(model: Model, state: State, scratch: Scratch, group: int, edge_dt: real):
        """Eliminate the tridiagonal system from the grip to the free end.

        Args:
            state: Positions at the start of the step, and predicted velocities.
            scratch: Receives the upper diagonal and the right side.
            edge_dt: Time into the step at which tensions act along the edges [s]: 0 or dt.
        """
        last = model.node_count - 1
        dt = model.dt
        squared_lengths = model.squared_length[group]
        position = state.position[group]
        velocity = state.velocity[group]
        inverse_mass = model.inverse_mass[group]
        solution = scratch.elimination[group]
        # Of the nodes of the segment: where they end the step, and where tensions see them.
        x = position[0]
        v = velocity[0]
        end = x + v * dt
        seen = x + v * edge_dt
        x = position[1]
        v = velocity[1]
        end_after = x + v * dt
        seen_after = x + v * edge_dt
        d_before = vec3()
        d = seen_after - seen
        w = inverse_mass[0]
        upper = lane()
        right_side = lane()
        segment = int(0)
        while segment < last:
            predicted = end_after - end
            end = end_after
            w_after = inverse_mass[segment + 1]
            # Nothing lies beyond the last segment.
            node = wp.min(segment + 2, last)
            x = position[node]
            v = velocity[node]
            end_after = x + v * dt
            seen_next = x + v * edge_dt
            d_after = seen_next - seen_after
            seen_after = seen_next
            below = -mul(w, dot(predicted, d_before))
            above = -mul(w_after, dot(predicted, d_after))
            diagonal = mul(w + w_after, dot(predicted, d)) * real(yielding)
            squared_length = squared_lengths[segment]
            error = (dot(predicted, predicted) - squared_length) * real(0.5)
            inverse_pivot = f.div(lane(real(1.0)), diagonal - mul(below, upper))
            right_side = mul(error - mul(below, right_side), inverse_pivot)
            upper = mul(above, inverse_pivot)
            solution[segment] = wp.matrix_from_rows(upper, right_side, right_side)
            d_before = d
            d = d_after
            w = w_after
            segment += 1

    @wp.func
    def apply_tensions(
        model: Model,
        state: State,
        scratch: Scratch,
        group: int,
        edge_dt: real,
        unsolved: lane,
        keep: real,
    ):
        """Substitute back from the free end, and apply the tensions to the nodes.

        Args:
            state: Positions at the start of the step; velocities and tensions, which are updated.
            scratch: Holds the eliminated system.
            edge_dt: Time into the step at which tensions act along the edges [s]: 0 or dt.
            unsolved: 1, or 0 for worlds that need no further change.
            keep: 0 in the first iteration, which replaces the tension of the previous step; then 1.

        Returns:
            The largest relative error of a squared segment length that remains [-].
        """
        last = model.node_count - 1
        dt = model.dt
        inverse_dt = real(1.0) / dt
        squared_lengths = model.squared_length[group]
        position = state.position[group]
        velocity = state.velocity[group]
        tension = state.tension[group]
        inverse_mass = model.inverse_mass[group]
        solution = scratch.elimination[group]
        one = lane(real(1.0))
        ratio = model.last_ratio[group]
        tau = lane()
        pull_after = vec3()
        largest = lane()
        # There is no segment after the last node, and that before it has a length of its own.
        weight = lane()
        weight_before = mul(ratio, ratio)
        x = position[last]
        v = velocity[last]
        end_after = vec3()
        node = int(last)
        while node > 0:
            x_before = position[node - 1]
            v_before = velocity[node - 1]
            row = solution[node - 1]
            tau = row[1] - mul(row[0], tau)
            applied = mul(unsolved, tau)
            pull = scale(applied, (x - x_before) + (v - v_before) * edge_dt)
            pulled = v + scale(inverse_mass[node], pull_after - pull) * inverse_dt
            velocity[node] = pulled
            tension[node - 1] = applied + tension[node - 1] * keep
            end = x + pulled * dt
            edge = end_after - end
            squared_length = squared_lengths[wp.min(node, last - 1)]
            error = absolute(dot(edge, edge) - squared_length)
            largest = f.larger(largest, mul(error, weight))
            weight = weight_before
            weight_before = one
            end_after = end
            pull_after = pull
            x = x_before
            v = v_before
            node -= 1
        edge = end_after - (x + v * dt)
        error = absolute(dot(edge, edge) - squared_lengths[0])
        largest = f.larger(largest, mul(error, weight))
        return mul(largest, model.inverse_square[group])

    @wp.func
    def lay_out_segments(model: Model, state: State, scratch: Scratch, group: int, failed: lane):
        """Lay the segments out from the grip on, each towards where its end would go if free.

        This remains to be done where Newton's method does not converge, as for a weight that
        reaches the end of a thread a thousand times lighter. Lengths hold, and no energy is made.

        Args:
            state: Positions at the start of the step; velocities, tensions and work, which are
                updated.
            scratch: Predicted velocities without tensions.
            failed: 1 for worlds to lay out, else 0.
        """
        dt = model.dt
        inverse_dt = real(1.0) / dt
        end = state.position[group, 0] + state.velocity[group, 0] * dt
        impulse = vec3()
        node = int(1)
        while node < model.node_count - model.far_is_held:
            x = state.position[group, node]
            edge = x + scratch.velocity[group, node] * dt - end
            size = f.root(dot(edge, edge) + lane(real(1.0e-20)))
            end = end + scale(f.div(f.root(model.squared_length[group, node - 1]), size), edge)
            v = state.velocity[group, node]
            # What the segments pass on to each other cancels out; the rest comes from the gripper.
            change = (end - x) * inverse_dt - scratch.velocity[group, node]
            impulse += scale(node_mass(model.inverse_mass[group, node]), change)
            # A product with 0 would keep what is not finite.
            tension = state.tension[group, node - 1]
            for k in range(count):
                if failed[k] > real(0.0):
                    tension[k] = real(0.0)
                    for c in range(3):
                        v[c, k] = (end[c, k] - x[c, k]) * inverse_dt
            state.tension[group, node - 1] = tension
            state.velocity[group, node] = v
            node += 1
        work = state.work[group]
        gained = dot(impulse, state.velocity[group, 0])
        for k in range(count):
            if failed[k] > real(0.0):
                work[k] = work[k] + gained[k]
        state.work[group] = work

    return SimpleNamespace(hold_lengths=hold_lengths)
