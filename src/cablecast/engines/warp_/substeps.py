"""Substeps: how many shorter steps a world takes in place of one, so that it follows its bending.

Leapfrog bears a wave of frequency w as long as (w dt)^2 < 4. With the filter of bending.py a wave
feels w^2 / (1 + (w dt)^2 / 12), so that a straight cable is stable up to (w dt)^2 = 6. On a curved
cable what the filter takes from the force is no longer what the tension, the table and the grippers
expect of it, and the moment of a fold grows faster than that of a straight rod. So no world takes a
step with (w dt)^2 above `MOST_FILTERED`; worlds that would, because they are stiff, light or finely
divided, take the smallest number of `COUNTS` shorter steps that suffices.
"""

import numpy as np
from numpy.typing import NDArray

MOST_FILTERED = 2.4
"""Largest (w dt)^2 of a step, at which half of what leapfrog bears is left for folds and tension.
`python -m benchmarks stability` scans the search space for worlds whose energy grows all the
same."""

COUNTS = tuple(sorted({base * 2**power for base in (1, 3) for power in range(12)} - {3 * 2**11}))
"""Numbers of substeps: 1, 2, 3, 4, 6, 8, 12 and so on, so that a batch falls into few parts."""


def fastest_wave(
    bend_stiffness: NDArray[np.float64],
    segment_mass: NDArray[np.float64],
    segment_length: NDArray[np.float64] | float,
) -> NDArray[np.float64]:
    """Return w^2 of the fastest bending wave [1/s²], a bound for any shape of the chain.

    It bends each node against its neighbours: no row of the stiffness matrix sums up to more than
    16 EI / l^3 (Gershgorin).

    Args:
        bend_stiffness: EI [N·m²], shape [world].
        segment_mass: Mass of a segment [kg], shape [world].
        segment_length: Length of a segment [m], one or shape [world].
    """
    return 16.0 * bend_stiffness / (segment_length**3 * segment_mass)


def substep_counts(fastest: NDArray[np.float64], dt: float) -> NDArray[np.int_]:
    """Return the number of substeps of each world, one of `COUNTS`.

    Args:
        fastest: w^2 of the fastest bending wave [1/s²], shape [world].
        dt: Step [s].
    """
    needed = np.sqrt(fastest * dt**2 / MOST_FILTERED)
    index = np.searchsorted(COUNTS, needed * (1.0 - 1e-9))
    return np.array(COUNTS)[np.minimum(index, len(COUNTS) - 1)]
