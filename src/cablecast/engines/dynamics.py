"""Dynamics: all that a simulated cast takes beside the set-up, as `tune` finds it."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import CableParams, Material
from cablecast.engines.base import Engine, Rollout
from cablecast.motion.grip_path import GripPath
from cablecast.motion.servo import ServoModel
from cablecast.setup import Setup


@dataclasses.dataclass(frozen=True, kw_only=True)
class Dynamics:
    """Parameters and material of a cable, and servo of the arm that casts it.

    Attributes:
        params: Parameters of the cable, shared by all casts or one value per cast.
        material: Material of the cable; that of the set-up where None.
        servo: Servo of the arm; it follows its set points exactly where None.
    """

    params: CableParams
    material: Material | None = None
    servo: ServoModel | None = None

    @classmethod
    def of(cls, value: "Dynamics | CableParams | None", setup: Setup) -> "Dynamics":
        """Return the dynamics to simulate with.

        Args:
            value: Dynamics, parameters alone, or None for the cable's own.
            setup: Set-up to simulate.
        """
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
        material, servo = values.get("material"), values.get("servo")
        return cls(
            params=CableParams(**values["params"]),
            material=None if material is None else Material.from_dict(material),
            servo=None if servo is None else ServoModel.from_dict(servo),
        )

    @classmethod
    def stack(cls, dynamics: "Sequence[Dynamics]", setup: Setup) -> "Dynamics":
        """Return the dynamics of some casts as one, without servo.

        Args:
            dynamics: Dynamics of one cable for each cast.
            setup: Set-up to simulate.

        Raises:
            InputError: One of several has a material for each cast already.
        """
        values = np.stack([one.params.to_array() for one in dynamics])
        materials = [one.material or setup.cable.material for one in dynamics]
        return cls(params=CableParams.from_array(values), material=Material.stack(materials))

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, without what is None; one cable's only."""
        return {"params": self.params.to_dict()} | self.beside_params()

    def beside_params(self) -> dict[str, Any]:
        """Return plain values of material and servo, without what is None."""
        parts = {"material": self.material, "servo": self.servo}
        return {name: part.to_dict() for name, part in parts.items() if part is not None}

    def with_params(self, params: CableParams | None) -> "Dynamics":
        """Return the dynamics with other parameters; as they are where None."""
        return self if params is None else dataclasses.replace(self, params=params)

    def rows(self, rows: NDArray[np.bool_] | NDArray[np.int_] | slice) -> "Dynamics":
        """Return the dynamics of some casts."""
        material = self.material
        if material is not None and material.world_count is not None:
            material = material.rows(rows)
        return dataclasses.replace(self, params=self.params.rows(rows), material=material)

    def without_curl(self) -> "Dynamics":
        """Return the dynamics of a straight cable, whose casts to both sides are mirror images."""
        return self._with_curl(0.0)

    def mirrored(self) -> "Dynamics":
        """Return the dynamics of the mirror image of a cable, which curls to the other side."""
        return self._with_curl(-1.0)

    def _with_curl(self, factor: float) -> "Dynamics":
        """Return the dynamics of a cable whose curl is multiplied; one without a curl as it is."""
        if self.material is None or not np.any(self.material.rest_curvature):
            return self
        # Not -0, which is another number in a file.
        curvature = factor * self.material.rest_curvature + 0.0
        material = dataclasses.replace(self.material, rest_curvature=curvature)
        return dataclasses.replace(self, material=material)

    def follow(self, commanded: GripPath, setup: Setup) -> GripPath:
        """Return the paths that the gripper takes along commanded paths."""
        return commanded if self.servo is None else self.servo.apply(commanded, setup.arm)

    def rollout(self, engine: Engine, setup: Setup, commanded: GripPath, **options: Any) -> Rollout:
        """Simulate casts.

        Args:
            engine: Simulator.
            setup: Cable, workspace, arm and motion settings.
            commanded: Paths that the gripper is told to take.
            **options: Arguments of `Engine.rollout` after the path.

        Raises:
            InputError: See `Engine.rollout`.
        """
        cable = setup.cable.with_material(self.material)
        return engine.rollout(cable, self.params, self.follow(commanded, setup), **options)
