"""MaterialSpace: ranges and prior of the material that is fitted beside the ten parameters.

Of the ten, `angular_damping` stands for all bending losses: a rate at which segments stop turning.
A material loses energy where it bends instead (`Material.damping_time`), and a cable that was wound
on a reel keeps a curl (`rest_curvature`), which makes casts to the left and to the right differ. A
sharp bend that lasts stays in it (`yield_curvature`). The air drags on it, it may rub differently
along and across itself, and its attachment acts as a body that may be longer or shorter than it is
(`attachment_arm`). The fit searches these values together with the ten, each about what is usual:
casts that say nothing of a value leave it there.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import Attachment, Cable
from cablecast.errors import InputError
from cablecast.material import ROD_ARM, Material
from cablecast.tuning.prior import ParamPrior
from cablecast.tuning.search_space import from_unit, to_unit

YIELD_TIME = 0.4
"""Time in which a bend beyond the yield curvature stays in the cable [s]."""


@dataclasses.dataclass(frozen=True)
class _Belief:
    """Range of one value, and what is believed of it.

    Attributes:
        low: Least value.
        high: Largest value.
        usual: Most likely value.
        deviation: Standard deviation; a factor where the scale is logarithmic.
        logarithmic: True for a logarithmic scale.
    """

    low: float
    high: float
    usual: float
    deviation: float
    logarithmic: bool = True

    def to_unit(self, value: float) -> float:
        """Return the place of a value in the range, 0 at its low end and 1 at its high one."""
        return float(to_unit(value, self.low, self.high, self.logarithmic))

    def from_unit(self, unit: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the values at places in the range."""
        return from_unit(unit, self.low, self.high, self.logarithmic)

    @property
    def unit_deviation(self) -> float:
        """Standard deviation as a share of the range."""
        if self.logarithmic:
            return float(np.log(self.deviation) / np.log(self.high / self.low))
        return self.deviation / (self.high - self.low)


def _beliefs(cable: Cable) -> dict[str, _Belief]:
    """Return what is believed of the values of a material.

    Ropes lose their energy within some hundredths of a second. A smooth cylinder has a drag
    coefficient of 1 to 1.2. A rope that was bent about a finger keeps the bend. A curl turns the
    whole cable by so many radians.
    """
    curl, length = 1.0 / cable.length, ROD_ARM * cable.attachment_length
    beliefs = {
        "damping_time": _Belief(1e-3, 0.1, 8e-3, 2.0),
        "rest_curvature": _Belief(-1.5 * curl, 1.5 * curl, 0.0, 0.3 * curl, False),
        "drag_coefficient": _Belief(0.2, 6.0, 1.1, 1.3),
        "friction_ratio": _Belief(0.5, 2.0, 1.0, 1.15),
        "yield_curvature": _Belief(4.0, 250.0, 40.0, 2.5),
    }
    if cable.attachment is not Attachment.NONE and length > 0.0:
        beliefs["attachment_arm"] = _Belief(length / 3.0, length * 3.0, length, 1.5)
    return beliefs


FITTED = (
    "damping_time",
    "rest_curvature",
    "drag_coefficient",
    "friction_ratio",
    "yield_curvature",
    "attachment_arm",
)
"""Names of the values of a material that a fit can find."""


class MaterialSpace:
    """Box of values of a material, mapped to the unit cube for the search.

    A value that the cable's file gives is kept, and so is the arm of a cable without attachment.

    Args:
        cable: Cable with its material.
        names: Values to find, some of `FITTED`.

    Attributes:
        own: Material in the cable's file.
        names: Values that are searched; possibly none.

    Raises:
        InputError: A name is unknown.
    """

    def __init__(self, cable: Cable, names: Sequence[str]):
        check_names(names)
        self.own = cable.material
        plain, beliefs = Material(), _beliefs(cable)
        self._beliefs = {
            name: beliefs[name]
            for name in names
            if name in beliefs and np.all(getattr(self.own, name) == getattr(plain, name))
        }
        self.names = tuple(self._beliefs)

    def __len__(self) -> int:
        return len(self.names)

    def joined(self, prior: ParamPrior) -> ParamPrior:
        """Return what is believed of parameters and material, in this order.

        Args:
            prior: Prior of the ten parameters.
        """
        usual = [belief.to_unit(belief.usual) for belief in self._beliefs.values()]
        deviations = [belief.unit_deviation for belief in self._beliefs.values()]
        return ParamPrior(
            mean=np.append(prior.mean, usual), deviation=np.append(prior.deviation, deviations)
        )

    def to_material(self, unit: NDArray[np.float64]) -> Material:
        """Return the material of points in the unit cube, one value per point.

        Args:
            unit: Unit coordinates of the values, shape [point, value] or [value].
        """
        columns = np.moveaxis(unit, -1, 0)
        values = {
            name: belief.from_unit(column)
            for (name, belief), column in zip(self._beliefs.items(), columns, strict=True)
        }
        if "yield_curvature" in values:
            values["yield_time"] = np.full_like(values["yield_curvature"], YIELD_TIME)
        return dataclasses.replace(
            self.own, **{name: float(v) if np.ndim(v) == 0 else v for name, v in values.items()}
        )


def check_names(names: Sequence[str]) -> None:
    """Raise an error for a name that is none of `FITTED`.

    Raises:
        InputError: A name is unknown.
    """
    if unknown := sorted(set(names) - set(FITTED)):
        raise InputError(f"materials = {unknown[0]!r} is none of {', '.join(FITTED)}")
