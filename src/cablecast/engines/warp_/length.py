"""Inextensibility: every segment keeps its length, by one tridiagonal solve per step (SHAKE).

Along edge e acts a tension tau[e] d[e], with d the edge at the START of the step. With
D = x*[e+1] - x*[e] the edge that the unconstrained step leads to and w the inverse masses, one
Newton iteration on |D|^2 = l^2 reads

    (w[e] + w[e+1]) (D[e].d[e]) tau[e] - w[e] (D[e].d[e-1]) tau[e-1]
        - w[e+1] (D[e].d[e+1]) tau[e+1] = (|D[e]|^2 - l^2) / 2,

where tau carries dt^2. The solve starts without the tension of the step before, which a jerk would
make worse than none. One iteration is enough while edges turn little; it is repeated where more
than LENGTH_TOLERANCE is left. (Ryckaert, Ciccotti and Berendsen 1977; gradients at the start of the
step are what makes the scheme second order.)
"""

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false

import functools
from types import SimpleNamespace

import warp as wp

from cablecast.engines.warp_.lanes import lane_functions
from cablecast.engines.warp_.world import world_structs

LENGTH_TOLERANCE = 2e-4
"""Error of a squared segment length, relative, that is left to the next step: lengths are kept to
one part in ten thousand."""

MAX_ITERATIONS = 12
"""Newton converges in two or three iterations, or the motion is far too fast for the step."""

COMPLIANCE = 1e-6
"""What is added to the diagonal of the system, relatively. It yields where there is no solution: a
cable drawn straight between two held ends is as long as it can be, whatever its tension."""


@functools.cache
def length_functions(precision: str, lane_count: int) -> SimpleNamespace:
    """Warp functions of the length stage."""
    f = lane_functions(precision, lane_count)
    s = world_structs(precision, lane_count)
    real, lane, vec3 = f.real, f.lane, f.vec3
    dot, scale, absolute, mul = f.dot, f.scale, f.absolute, f.mul
    Model, State, Scratch = s.Model, s.State, s.Scratch
    count = wp.constant(lane_count)
    tolerance = wp.constant(LENGTH_TOLERANCE)
    max_iterations = wp.constant(MAX_ITERATIONS)
    slack = wp.constant(1.0 + COMPLIANCE)

    @wp.func
    def eliminate_tensions(
        model: Model, directions: wp.array(dtype=vec3), scratch: Scratch, group: int
    ):
        """Forward elimination from the grip to the free end."""
        last = model.node_count - 1
        squared_length = lane(model.segment_length * model.segment_length)
        prediction = scratch.predicted[group]
        inverse_mass = model.inverse_mass[group]
        uppers = scratch.upper[group]
        sides = scratch.rhs[group]
        x_here = directions[0]
        x_after = directions[1]
        p_here = prediction[0]
        d_before = vec3()
        d = x_after - x_here
        w = inverse_mass[0]
        upper = lane()
        rhs = lane()
        for e in range(last):
            p_after = prediction[e + 1]
            predicted = p_after - p_here
            w_after = inverse_mass[e + 1]
            # Nothing lies beyond the last edge.
            x_next = directions[wp.min(e + 2, last)]
            d_after = x_next - x_after
            x_after = x_next
            below = -mul(w, dot(predicted, d_before))
            above = -mul(w_after, dot(predicted, d_after))
            diagonal = mul(w + w_after, dot(predicted, d)) * real(slack)
            error = (dot(predicted, predicted) - squared_length) * real(0.5)
            pivot = f.div(lane(real(1.0)), diagonal - mul(below, upper))
            rhs = mul(error - mul(below, rhs), pivot)
            upper = mul(above, pivot)
            uppers[e] = upper
            sides[e] = rhs
            p_here = p_after
            d_before = d
            d = d_after
            w = w_after

    @wp.func
    def apply_tensions(
        model: Model,
        directions: wp.array(dtype=vec3),
        state: State,
        scratch: Scratch,
        group: int,
        share: lane,
        keep: real,
    ):
        """Back substitution from the free end, and what the change of tension does to the nodes.

        Args:
            share: 1, or 0 for worlds that need no further change.
            keep: 0 in the first iteration, which replaces the tension of the step before; then 1.

        Returns:
            The largest error of a squared segment length that remains, relative.
        """
        last = model.node_count - 1
        rate = real(1.0) / model.dt
        relative = real(1.0) / (model.segment_length * model.segment_length)
        squared_length = lane(model.segment_length * model.segment_length)
        prediction = scratch.predicted[group]
        inverse_mass = model.inverse_mass[group]
        uppers = scratch.upper[group]
        sides = scratch.rhs[group]
        velocity = state.velocity[group]
        tension = state.tension[group]
        change = lane()
        pull_after = vec3()
        worst = lane()
        x_here = directions[last]
        p_after = vec3()
        for back in range(last):
            i = last - back
            x_before = directions[i - 1]
            change = sides[i - 1] - mul(uppers[i - 1], change)
            pull = scale(mul(share, change), x_here - x_before)
            shift = scale(inverse_mass[i], pull_after - pull)
            p_here = prediction[i] + shift
            prediction[i] = p_here
            velocity[i] = velocity[i] + shift * rate
            tension[i - 1] = mul(share, change) + tension[i - 1] * keep
            edge = p_after - p_here
            # There is no edge after the last node.
            error = absolute(dot(edge, edge) - squared_length) * real(wp.min(back, 1))
            worst = wp.max(worst, error)
            p_after = p_here
            pull_after = pull
            x_here = x_before
        edge = p_after - prediction[0]
        worst = wp.max(worst, absolute(dot(edge, edge) - squared_length))
        return worst * relative

    @wp.func
    def lay_out(model: Model, state: State, scratch: Scratch, group: int, failed: lane):
        """Lay the segments out from the grip on, each towards where its end would go if free.

        This is what remains to be done where Newton's method does not converge: a weight that
        reaches the end of a thread a thousand times lighter. Lengths hold, and no energy is made.
        """
        rate = real(1.0) / model.dt
        end = scratch.predicted[group, 0]
        for i in range(1, model.node_count - model.far_is_held):
            edge = scratch.force[group, i] - end
            size = f.root(dot(edge, edge) + lane(real(1.0e-20)))
            end = end + scale(f.div(lane(model.segment_length), size), edge)
            p = scratch.predicted[group, i]
            x = state.position[group, i]
            v = state.velocity[group, i]
            # A product would keep what is not finite.
            tension = state.tension[group, i - 1]
            for k in range(count):
                if failed[k] > real(0.0):
                    tension[k] = real(0.0)
                    for c in range(3):
                        p[c, k] = end[c, k]
                        v[c, k] = (end[c, k] - x[c, k]) * rate
            state.tension[group, i - 1] = tension
            scratch.predicted[group, i] = p
            state.velocity[group, i] = v

    @wp.func
    def hold_lengths(model: Model, state: State, scratch: Scratch, group: int, active: lane):
        """Newton iterations until every length is right, and another way where they fail.

        Where the tip whips, an edge may turn by a third of a radian in one step, and what one
        iteration leaves would come back as a kick in the next step.
        """
        share = active
        worst = lane()
        iteration = int(0)
        again = int(0)
        while iteration < max_iterations:
            # A jerk that one iteration cannot take up acts along the edges as they have turned.
            if iteration == 0:
                eliminate_tensions(model, state.position[group], scratch, group)
                worst = apply_tensions(
                    model, state.position[group], state, scratch, group, share, real(0.0)
                )
            else:
                eliminate_tensions(model, scratch.predicted[group], scratch, group)
                worst = apply_tensions(
                    model, scratch.predicted[group], state, scratch, group, share, real(1.0)
                )
            iteration += 1
            again = 0
            for k in range(count):
                # A value that is not a number is not right either.
                if share[k] > real(0.0) and not (worst[k] <= real(tolerance)):
                    again = 1
                else:
                    share[k] = real(0.0)
            if again == 0:
                iteration = max_iterations
        if again == 1:
            lay_out(model, state, scratch, group, share)

    return SimpleNamespace(hold_lengths=hold_lengths)
