"""Dynamics: physics of the cable and servo of the arm, as `tune` finds them."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import CableParams
from cablecast.engines.base import Engine, Rollout
from cablecast.motion.grip_path import GripPath
from cablecast.motion.servo import ServoModel
from cablecast.setup import Setup


@dataclasses.dataclass(frozen=True, kw_only=True)
class Dynamics:
    """Physics of a cable, and servo of the arm that casts it.

    Attributes:
        params: Physics of the cable, shared by all casts or one value per cast.
        servo: Servo of the arm; it follows its set points exactly if None.
    """

    params: CableParams
    servo: ServoModel | None = None

    @classmethod
    def of(cls, value: "Dynamics | CableParams | None", setup: Setup) -> "Dynamics":
        """Return the dynamics of a set-up; None stands for its cable's own parameters."""
        if isinstance(value, Dynamics):
            return value
        return cls(params=setup.cable.params if value is None else value)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "Dynamics":
        """Return the dynamics that `to_dict` described; other keys are left alone.

        Raises:
            KeyError: There are no parameters.
            InputError: A value is out of bounds.
        """
        servo = values.get("servo")
        return cls(
            params=CableParams.from_dict(values["params"]),
            servo=None if servo is None else ServoModel.from_dict(servo),
        )

    @classmethod
    def stack(cls, dynamics: "Sequence[Dynamics]") -> "Dynamics":
        """Return the dynamics of some casts, each of one cable, as one, without servo.

        Raises:
            InputError: One of several has parameters for each cast already.
        """
        return cls(params=CableParams.stack([one.params for one in dynamics]))

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, without a servo that is None; one cable's only."""
        values: dict[str, Any] = {"params": self.params.to_dict()}
        return values if self.servo is None else values | {"servo": self.servo.to_dict()}

    def with_params(self, params: CableParams | None) -> "Dynamics":
        """Return the dynamics with other parameters; as they are if None."""
        return self if params is None else dataclasses.replace(self, params=params)

    def rows(self, rows: NDArray[np.bool_] | NDArray[np.int_] | slice) -> "Dynamics":
        """Return the dynamics of some casts."""
        return dataclasses.replace(self, params=self.params.rows(rows))

    def without_curl(self) -> "Dynamics":
        """Return the dynamics of a straight cable, whose casts to both sides are mirror images."""
        return self._with_curl(0.0)

    def mirrored(self) -> "Dynamics":
        """Return the dynamics of the mirror image of a cable, which curls to the other side."""
        return self._with_curl(-1.0)

    def _with_curl(self, factor: float) -> "Dynamics":
        """Return the dynamics of a cable whose curl is multiplied; one without a curl as it is."""
        if not np.any(self.params.rest_curvature):
            return self
        # Not -0, which is another number in a file.
        curvature = factor * self.params.rest_curvature + 0.0
        return self.with_params(dataclasses.replace(self.params, rest_curvature=curvature))

    def follow(self, commanded: GripPath, setup: Setup) -> GripPath:
        """Return the paths that the gripper takes along commanded paths."""
        return commanded if self.servo is None else self.servo.apply(commanded, setup.arm)

    def rollout(self, engine: Engine, setup: Setup, commanded: GripPath, **options: Any) -> Rollout:
        """Simulate casts along commanded paths of the gripper.

        Options are those of `Engine.rollout` after the path.
        """
        cable = setup.cable.with_params(self.params)
        path = self.follow(commanded, setup)
        return engine.rollout(cable, path, edges=setup.workspace, **options)
