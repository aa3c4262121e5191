"""The attachment as a body: a rigid last segment that the cable's end clamps.

A rod of length a and mass m that continues the cable moves like two point masses: m / 4 at the
cable's end and 3 m / 4 at 2 a / 3 beyond it. They have its mass, its centre of mass and its moment
of inertia. So the chain has one more segment, whose length, the arm, is its own. It is stretched to
the length l of the others wherever bends are measured; with s = l / arm the bend at its joint is
x[i-1] - (1 + s) x[i] + s x[i+1]. Only the cable bends there, along half a cell, so that the joint
is twice as stiff as a node within the cable.
"""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import CableParams
from cablecast.engines.base import CableState

TIP_SHARE = 0.75
"""Share of the attachment's mass at the end of the arm."""

JOINT_CELLS = 2.0
"""Stiffness of the joint over that of a node within the cable."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class EndSegment:
    """Last segment of a chain that is an attachment.

    Attributes:
        arm: Length of the segment [m], shape [world].
        ratio: Length of the other segments over it [-], shape [world].
        joint_mass: Part of its mass at the cable's end [kg], shape [world].
        tip_mass: Part of its mass at the end of the arm [kg], shape [world].
    """

    arm: NDArray[np.float64]
    ratio: NDArray[np.float64]
    joint_mass: NDArray[np.float64]
    tip_mass: NDArray[np.float64]

    @classmethod
    def of(cls, segment_length: NDArray[np.float64] | float, params: CableParams) -> "EndSegment":
        """Return the attachments of some worlds; one that is no body has an endless arm.

        Args:
            segment_length: Length of the other segments [m], one or shape [world].
            params: Physics with the arms and the masses.
        """
        arm = np.atleast_1d(np.asarray(params.attachment_arm, dtype=float))
        arm = np.where(arm > 0.0, arm, np.inf)
        mass = np.atleast_1d(np.asarray(params.endpoint_mass, dtype=float))
        return cls(
            arm=arm,
            ratio=segment_length / arm,
            joint_mass=(1.0 - TIP_SHARE) * mass,
            tip_mass=TIP_SHARE * mass,
        )

    def appended(self, state: CableState) -> CableState:
        """Return a state with the attachment, in line with the cable's last segment."""
        ratio = (1.0 / self.ratio)[:, None]
        rows = max(state.world_count, len(ratio))

        def with_tip(values: NDArray[np.float64]) -> NDArray[np.float64]:
            values = np.broadcast_to(values, (rows, *values.shape[1:]))
            tip = values[:, -1] + ratio * (values[:, -1] - values[:, -2])
            return np.concatenate([values, tip[:, None]], axis=1)

        def with_last(values: NDArray[np.float64]) -> NDArray[np.float64]:
            values = np.broadcast_to(values, (rows, *values.shape[1:]))
            return np.concatenate([values, values[:, -1:]], axis=1)

        return CableState(
            positions=with_tip(state.positions),
            velocities=with_tip(state.velocities),
            roll=with_last(state.roll),
            roll_rate=with_last(state.roll_rate),
        )


def has_end(params: CableParams) -> NDArray[np.bool_]:
    """Return whether the attachment is a body, one or shape [world]: it has an arm and a mass."""
    arm = np.atleast_1d(np.asarray(params.attachment_arm, dtype=float))
    return (arm > 0.0) & (np.atleast_1d(np.asarray(params.endpoint_mass, dtype=float)) > 0.0)


def fastest_at_end(
    bend_stiffness: NDArray[np.float64],
    segment_mass: NDArray[np.float64],
    segment_length: NDArray[np.float64],
    end: EndSegment,
) -> NDArray[np.float64]:
    """Return w^2 of the fastest wave at an attachment [1/s²], as `substeps.fastest_wave`.

    It is the largest sum of a row of the stiffness matrix over the mass of its node (Gershgorin).

    Args:
        bend_stiffness: EI [N·m²], one or shape [world].
        segment_mass: Mass of a segment [kg], one or shape [world].
        segment_length: Length of a segment [m], one or shape [world].
        end: Attachments.
    """
    s = end.ratio
    with np.errstate(divide="ignore", invalid="ignore"):
        tip = 2.0 * JOINT_CELLS * s * (1.0 + s) / end.tip_mass
        joint = end.joint_mass + 0.5 * segment_mass
        clamp = (2.0 * JOINT_CELLS * (1.0 + s) ** 2 + 4.0) / joint
        # The node before it feels the joint beside the nodes of the cable.
        before = (2.0 * JOINT_CELLS * (1.0 + s) + 12.0) / segment_mass
    fastest = np.maximum(np.maximum(tip, clamp), before)
    return bend_stiffness * fastest / segment_length**3
