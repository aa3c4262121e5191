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
    def eliminate_tensions(model: Model, state: State, scratch: Scratch, group: int, lead: real):
        """Forward elimination from the grip to the free end.

        Args:
            lead: How far into the step the edges are along which tensions act [s].
        """
        last = model.node_count - 1
        dt = model.dt
        squared_length = lane(model.segment_length * model.segment_length)
        position = state.position[group]
        velocity = state.velocity[group]
        inverse_mass = model.inverse_mass[group]
        solution = scratch.moment[group]
        x = position[0]
        v = velocity[0]
        p_here = x + v * dt
        x_here = x + v * lead
        x = position[1]
        v = velocity[1]
        p_after = x + v * dt
        x_after = x + v * lead
        d_before = vec3()
        d = x_after - x_here
        w = inverse_mass[0]
        upper = lane()
        rhs = lane()
        for e in range(last):
            predicted = p_after - p_here
            p_here = p_after
            w_after = inverse_mass[e + 1]
            # Nothing lies beyond the last edge.
            n = wp.min(e + 2, last)
            x = position[n]
            v = velocity[n]
            p_after = x + v * dt
            x_next = x + v * lead
            d_after = x_next - x_after
            x_after = x_next
            below = -mul(w, dot(predicted, d_before))
            above = -mul(w_after, dot(predicted, d_after))
            diagonal = mul(w + w_after, dot(predicted, d)) * real(slack)
            error = (dot(predicted, predicted) - squared_length) * real(0.5)
            pivot = f.div(lane(real(1.0)), diagonal - mul(below, upper))
            rhs = mul(error - mul(below, rhs), pivot)
            upper = mul(above, pivot)
            solution[e] = wp.matrix_from_rows(upper, rhs, rhs)
            d_before = d
            d = d_after
            w = w_after

    @wp.func
    def apply_tensions(
        model: Model,
        state: State,
        scratch: Scratch,
        group: int,
        lead: real,
        share: lane,
        keep: real,
    ):
        """Back substitution from the free end, and what the change of tension does to the nodes.

        Args:
            lead: As above.
            share: 1, or 0 for worlds that need no further change.
            keep: 0 in the first iteration, which replaces the tension of the step before; then 1.

        Returns:
            The largest error of a squared segment length that remains, relative.
        """
        last = model.node_count - 1
        dt = model.dt
        rate = real(1.0) / dt
        relative = real(1.0) / (model.segment_length * model.segment_length)
        squared_length = lane(model.segment_length * model.segment_length)
        position = state.position[group]
        velocity = state.velocity[group]
        tension = state.tension[group]
        inverse_mass = model.inverse_mass[group]
        solution = scratch.moment[group]
        change = lane()
        pull_after = vec3()
        worst = lane()
        x = position[last]
        v = velocity[last]
        p_after = vec3()
        for back in range(last):
            i = last - back
            x_before = position[i - 1]
            v_before = velocity[i - 1]
            row = solution[i - 1]
            change = row[1] - mul(row[0], change)
            applied = mul(share, change)
            pull = scale(applied, (x - x_before) + (v - v_before) * lead)
            turned = v + scale(inverse_mass[i], pull_after - pull) * rate
            velocity[i] = turned
            tension[i - 1] = applied + tension[i - 1] * keep
            p_here = x + turned * dt
            edge = p_after - p_here
            # There is no edge after the last node.
            error = absolute(dot(edge, edge) - squared_length) * real(wp.min(back, 1))
            worst = wp.max(worst, error)
            p_after = p_here
            pull_after = pull
            x = x_before
            v = v_before
        edge = p_after - (x + v * dt)
        worst = wp.max(worst, absolute(dot(edge, edge) - squared_length))
        return worst * relative

    @wp.func
    def lay_out(model: Model, state: State, scratch: Scratch, group: int, failed: lane):
        """Lay the segments out from the grip on, each towards where its end would go if free.

        This is what remains to be done where Newton's method does not converge: a weight that
        reaches the end of a thread a thousand times lighter. Lengths hold, and no energy is made.
        """
        dt = model.dt
        rate = real(1.0) / dt
        end = state.position[group, 0] + state.velocity[group, 0] * dt
        for i in range(1, model.node_count - model.far_is_held):
            x = state.position[group, i]
            edge = x + scratch.force[group, i] * dt - end
            size = f.root(dot(edge, edge) + lane(real(1.0e-20)))
            end = end + scale(f.div(lane(model.segment_length), size), edge)
            v = state.velocity[group, i]
            # A product would keep what is not finite.
            tension = state.tension[group, i - 1]
            for k in range(count):
                if failed[k] > real(0.0):
                    tension[k] = real(0.0)
                    for c in range(3):
                        v[c, k] = (end[c, k] - x[c, k]) * rate
            state.tension[group, i - 1] = tension
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
        lead = real(0.0)
        keep = real(0.0)
        while iteration < max_iterations:
            eliminate_tensions(model, state, scratch, group, lead)
            worst = apply_tensions(model, state, scratch, group, lead, share, keep)
            # A jerk that one iteration cannot take up acts along the edges as they have turned.
            lead = model.dt
            keep = real(1.0)
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
