"""The table: contact and the three frictions in turn, or nothing where there is no table."""

# Annotations of kernels are values that Warp reads, not types that pyright knows.
# pyright: reportInvalidTypeForm=false, reportIndexIssue=false, reportOperatorIssue=false

import functools
from types import SimpleNamespace

import warp as wp

from cablecast.engines.warp_.contact import contact_functions
from cablecast.engines.warp_.features import Features
from cablecast.engines.warp_.rolling import rolling_functions
from cablecast.engines.warp_.sliding import sliding_functions
from cablecast.engines.warp_.spinning import spinning_functions
from cablecast.engines.warp_.world import world_structs


@functools.cache
def table_functions(precision: str, lane_count: int, features: Features) -> SimpleNamespace:
    """Build the Warp function that turns predicted velocities into those beside the table.

    Args:
        precision: "single" or "double".
        lane_count: Number of worlds side by side.
        features: Features that the kernel plays.
    """
    s = world_structs(precision, lane_count)
    contact = contact_functions(precision, lane_count)
    spinning = spinning_functions(precision, lane_count)
    sliding = sliding_functions(precision, lane_count, features.surface)
    rolling = rolling_functions(precision, lane_count)
    Model, State, Scratch = s.Model, s.State, s.Scratch

    @wp.func
    def meet_table(model: Model, state: State, scratch: Scratch, group: int):
        """Give nodes and segments the velocities and spins that the table leaves them.

        Args:
            model: Constants of the batch.
            state: Receives velocities, and what the table holds.
            scratch: Predicted velocities and spins, which are updated.
            group: Group of worlds.
        """
        contact.press_nodes(model, state, scratch, group)
        spinning.resist_turning(model, state, scratch, group)
        sliding.slide_nodes(model, state, scratch, group)
        rolling.finish_rolls(model, state, scratch, group)

    @wp.func
    def meet_nothing(model: Model, state: State, scratch: Scratch, group: int):
        """Give nodes their predicted velocities, in place of `meet_table`."""
        node = int(1)
        while node < model.node_count:
            state.velocity[group, node] = scratch.velocity[group, node]
            node += 1

    return SimpleNamespace(meet_table=meet_table if features.table else meet_nothing)
