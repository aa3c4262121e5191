"""Landings of casts in simulators of different physics, and how far off they may be.

All simulators follow the casts that they were fitted to. One, at full resolution, is the best
guess. Where they disagree, physics matters that those casts do not determine, so their spread says
how far off the best guess may be (docs/aim.md).
"""

import dataclasses
import io
import pathlib
import warnings
import zipfile
import zlib

import numpy as np
from numpy.typing import NDArray

from cablecast.files import write_bytes
from cablecast.setup import Setup
from cablecast.task import LANDING, Task

OWN_MISS, SPREAD_FACTOR = 0.02, 1.5
"""A landing misses by about the spread of the ensemble times a factor, and by a part of its own
[cable lengths]. Set by 90 candidates of all paces, whose landings were spread over the table, in
laboratory 0 of the virtual rig with cable 1; the calm ones landed 1.5 % from where they were
expected in the median, the wild ones by more than twice the spread."""

TYPICAL_DISTANCES, FACTORS = (0.012, 0.021), (0.05, 3.0)
"""Mean distances from a fit to its tracks between which these two hold [cable lengths]: those of
fits in the virtual rig, where the distance tells no more. Beyond, misses grow and shrink with its
square, between the least and the largest factor. With the square, because wrong physics errs by
more elsewhere than along the tracks that were fitted. Larger misses widen the regions that are
stated, and do not change the choice of a cast: with them corrections stop half-way, and second
tries miss by more (docs/notes.md)."""

TRUSTED_COUNT = 5
"""Casts from which on a close fit means small misses elsewhere: a fit finds so many numbers that it
follows two casts closely, whatever they are."""

FRICTION_STEP = 0.08
"""Relative change of the friction, to less and to more."""

SLIPPERY, SLIDES_OFF = 0.7, 0.4
"""Friction over that of the fit with which a cable that hangs over a side may slide off the table,
and the chance that it does so then. Real friction differs from place to place and falls with speed,
and what hangs pulls the more the more hangs. With a cord of 1.1 m on a table 1 m wide, 4 of 9 casts
that slid off with 0.7 of the friction did so in the virtual rig, and none of the others."""

APART_MAX = 1.0
"""Largest distance between landings that counts [cable lengths]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class LandingEstimate:
    """Landings of casts in an ensemble, and how far off they may be.

    Attributes:
        landing_xy: Landing in the best simulator [m], NaN where there is none, shape [action, 2];
            for another task its outcome over `Task.units`, shape [action, k].
        frictions: Shift of the landing per relative change of the friction [cable lengths], shape
            [action].
        spreads: Standard deviation of the landings along each axis [cable lengths], shape [action].
        leaving: Chance that the free end passes an edge of the table [-], shape [action]: the share
            of the simulators in which it does, and where it would slide off a slippery table at
            least `SLIDES_OFF`.
        factor: Size of misses over the typical one [-], 1 at most.
    """

    landing_xy: NDArray[np.float64]
    frictions: NDArray[np.float64]
    spreads: NDArray[np.float64]
    leaving: NDArray[np.float64]
    factor: float = 1.0

    @property
    def sizes(self) -> NDArray[np.float64]:
        """Size of the misses that these tell, along each axis [cable lengths], shape [action]."""
        return self.factor * miss_sizes(self.spreads)


def miss_sizes(spreads: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the size of misses along each axis, from spreads along each [cable lengths]."""
    return np.hypot(OWN_MISS, SPREAD_FACTOR * spreads)


def miss_factor(distance: float, track_count: int) -> float:
    """Return the size of misses over the typical one [-] of a fit.

    `distance` is the mean distance from the fit to its tracks [cable lengths].
    """
    ratio = distance / float(np.clip(distance, *TYPICAL_DISTANCES))
    least, most = FACTORS
    return float(np.clip(ratio**2, least if track_count >= TRUSTED_COUNT else 1.0, most))


class KnownLandings(dict[bytes, NDArray[np.float64]]):
    """Landings that were simulated so far: the row of a `LandingEstimate` by action and side."""

    _kept_count = 0

    def estimate(self, keys: list[bytes], k: int, factor: float) -> LandingEstimate:
        """Return what is known of some casts, with outcomes of k numbers."""
        rows = np.array([self[key] for key in keys]).reshape(-1, k + 3)
        return LandingEstimate(
            landing_xy=rows[:, :-3],
            frictions=rows[:, -3],
            spreads=rows[:, -2],
            leaving=rows[:, -1],
            factor=factor,
        )

    def add(self, keys: list[bytes], found: LandingEstimate) -> None:
        """Add casts that were simulated."""
        columns = [found.landing_xy, found.frictions, found.spreads, found.leaving]
        self.update(zip(keys, np.column_stack(columns), strict=True))

    def keep(self, file: pathlib.Path, simulators: str) -> None:
        """Write them to a file with a name for the simulators, unless it has them all."""
        if len(self) == self._kept_count:
            return
        buffer = io.BytesIO()
        keys = np.frombuffer(b"".join(self)).reshape(len(self), -1)
        np.savez(buffer, simulators=simulators, keys=keys, rows=[*self.values()])
        write_bytes(file, buffer.getvalue())
        self._kept_count = len(self)

    def recall(self, file: pathlib.Path, simulators: str) -> None:
        """Read what `keep` wrote, if it is of the same simulators.

        What a damaged file held is simulated again, and a warning says so.
        """
        if not file.exists():
            return
        try:
            with np.load(file, allow_pickle=False) as kept:
                if str(kept["simulators"]) == simulators:
                    rows = zip(kept["keys"], kept["rows"], strict=True)
                    self.update((key.tobytes(), row) for key, row in rows)
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error) as error:
            reason = " ".join(str(error).split())[:200]
            warnings.warn(
                f"{file} cannot be read, and its landings are simulated again: {reason}",
                stacklevel=2,
            )
        self._kept_count = len(self)


def estimate_landings(
    tracks: NDArray[np.float64],
    setup: Setup,
    *,
    landing_xy: NDArray[np.float64],
    friction_xy: NDArray[np.float64],
    slippery: NDArray[np.float64] | None = None,
    task: Task = LANDING,
) -> LandingEstimate:
    """Return landings and spread from tracks in several simulators.

    Args:
        tracks: Positions of the free end [m], shape [member, action, sample, 2]; NaN where a
            simulation broke off.
        setup: Gives the table and the cable.
        landing_xy: Landings that are expected [m], shape [action, k].
        friction_xy: Landings with `FRICTION_STEP` less and more friction [m], [2, action, k].
        slippery: Positions of the free end on a slippery table [m], shape [action, sample, 2]; None
            where that is not asked.
        task: Task whose outcomes stand for the landings.
    """
    length = setup.cable.length
    landings = task.outcome(tracks) / task.units(setup) / length
    there: NDArray[np.bool_] = np.all(np.isfinite(landings), axis=2)
    count = there.sum(axis=0)[:, None]
    summed = np.where(there[..., None], landings, 0.0).sum(axis=0)
    mean = np.where(count > 0, summed / np.maximum(count, 1), np.nan)
    spread = np.sqrt(np.mean(_distances(landings, mean) ** 2, axis=0) / landings.shape[-1])
    frictions = _distances(friction_xy[1] / length, friction_xy[0] / length) / (2.0 * FRICTION_STEP)
    table = setup.workspace
    leaving = np.mean(np.any(table.edge_distance(tracks) < 0.0, axis=2), axis=0)
    if slippery is not None:
        slides = np.any(table.edge_distance(slippery) < 0.0, axis=1)
        leaving = np.maximum(leaving, np.where(slides, SLIDES_OFF, 0.0))
    return LandingEstimate(
        landing_xy=landing_xy, frictions=frictions, spreads=spread, leaving=leaving
    )


def _distances(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return distances of landings, `APART_MAX` at most, and where a simulation broke off."""
    distance = np.linalg.norm(first - second, axis=-1)
    return np.where(np.isfinite(distance), np.minimum(distance, APART_MAX), APART_MAX)
