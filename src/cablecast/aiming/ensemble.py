"""EnsembleLandings: the same casts in simulators of different physics, and the spread of landings.

All simulators follow the casts that they were fitted to. One, at full resolution, is the best
guess. Where they disagree, physics matters that those casts do not determine, so their spread says
how far off the best guess may be (docs/aim.md).
"""

import concurrent.futures
import contextlib
import dataclasses
import functools
import io
import pathlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cablecast.engines import make_engine
from cablecast.engines.base import Engine, engine_settings
from cablecast.engines.dynamics import Dynamics
from cablecast.errors import InputError
from cablecast.files import core_count, write_bytes
from cablecast.motion.action import ACTION_SIZE
from cablecast.motion.casting import cast_grip_paths
from cablecast.runs.folder import fingerprint
from cablecast.setup import Setup
from cablecast.task import LANDING, Task
from cablecast.tuning.ensemble import ParamUpdate
from cablecast.tuning.space import ParamPosterior
from cablecast.tuning.tracks import MeasuredTracks
from cablecast.tuning.tuned import Tuned

OWN_MISS, SPREAD_FACTOR = 0.02, 1.5
"""A landing misses by about the spread of the ensemble times a factor, and by a part of its own
[cable lengths]. Set by 90 candidates of all paces, whose landings were spread over the table, in
laboratory 0 of the virtual rig with cable 1; the calm ones landed 1.5 % from where they were
expected in the median, the wild ones by more than twice the spread."""

USUAL_DISTANCES, FACTORS = (0.012, 0.021), (0.05, 3.0)
"""Mean distances from a fit to its tracks between which these two hold [cable lengths]: those of
fits in the virtual rig, where the distance tells no more. Beyond, misses grow and shrink with its
square, between the least and the largest factor. With the square, because wrong physics errs by
more elsewhere than along the tracks that were fitted. Larger misses widen the regions that are
stated, and do not change the choice of a cast: with them corrections stop half-way, and second
tries miss by more (docs/notes.md)."""

TRUSTED_COUNT = 5
"""Casts from which on a close fit means small misses elsewhere: a fit finds so many numbers that it
follows two casts closely, whatever they are."""

# Relative change of the friction, to less and to more.
_FRICTION_STEP = 0.08
# Largest distance between landings that counts: farther apart they tell nothing [cable lengths].
_APART_MAX = 1.0
# Between samples the free end moves by some centimetres where it turns at the back [s].
_SAMPLE_DT = 0.05


@dataclasses.dataclass(frozen=True, kw_only=True)
class LandingEstimate:
    """Landings of casts in an ensemble, and how far off they may be.

    Attributes:
        landing_xy: Landing in the best simulator [m], NaN where there is none, shape [action, 2];
            for another task its outcome over `Task.units`, shape [action, k].
        frictions: Shift of the landing per relative change of the friction [cable lengths], shape
            [action].
        spreads: Standard deviation of the landings along each axis [cable lengths], shape [action].
        leaving: Share of the simulators in which the free end passes an edge of the table [-],
            shape [action].
        factor: Size of misses over the usual one [-], 1 at most.
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
    """Return the usual size of misses along each axis, from spreads along each [cable lengths]."""
    return np.hypot(OWN_MISS, SPREAD_FACTOR * spreads)


def miss_factor(distance: float, track_count: int) -> float:
    """Return the size of misses over the usual one [-] of a fit.

    `distance` is the mean distance from the fit to its tracks [cable lengths].
    """
    ratio = distance / float(np.clip(distance, *USUAL_DISTANCES))
    least, most = FACTORS
    return float(np.clip(ratio**2, least if track_count >= TRUSTED_COUNT else 1.0, most))


class EnsembleLandings:
    """Casts in several simulators, seen as if all were to the right; simulated ones are kept.

    A cast to the left is the mirror image of one to the right with a cable that curls to the other
    side.

    Args:
        setup: Cable, workspace, arm and motion settings.
        members: Physics of each simulator whose spread tells of misses; all have
            the servo of the first one.
        engine: Engine that simulates them.
        best: Simulator whose landings are expected.
        fine_engine: Engine that simulates it.
        posterior: Uncertainty of the parameters, and the distance that the fit left; None for
            simulators that are not updated, and follow the cable as well as usual.
        task: Task whose outcomes stand for the landings.
    """

    def __init__(
        self,
        setup: Setup,
        members: Sequence[Dynamics],
        engine: Engine,
        best: Dynamics,
        fine_engine: Engine,
        posterior: ParamPosterior | None = None,
        task: Task = LANDING,
    ):
        self.setup, self.task = setup, task
        self.members = tuple(members)
        self.engine = engine
        self.best, self.fine_engine = best, fine_engine
        self.posterior = posterior
        self._known: dict[bytes, NDArray[np.float64]] = {}
        self._kept_count = 0

    @classmethod
    def of(cls, tuned: Tuned, task: Task = LANDING) -> "EnsembleLandings":
        """Return the simulators of a fit that has an ensemble.

        Raises:
            InputError: The fit has none.
        """
        fitted = tuned.ensemble
        if fitted is None:
            raise InputError("this fit has no ensemble: fit the cable with `tune`")
        return cls(
            tuned.setup,
            [dataclasses.replace(member, servo=tuned.dynamics.servo) for member in fitted.members],
            make_engine("warp", fitted.segment_count, fitted.dt),
            tuned.dynamics,
            make_engine("warp", fitted.fine_segment_count, fitted.fine_dt),
            tuned.posterior,
            task,
        )

    def tracks(
        self,
        actions: NDArray[np.float64],
        side: NDArray[np.float64] | None = None,
        members: Sequence[Dynamics] = (),
        engine: Engine | None = None,
    ) -> NDArray[np.float64]:
        """Return how the free end moves in each simulator [m], shape [member, action, sample, 2].

        Args:
            actions: Actions to the right, shape [action, 5].
            side: +1, or -1 for those that are cast to the left, shape [action]; all to the right
                where None.
            members: Simulators; those of the ensemble where empty.
            engine: Engine that simulates them; that of the members where None.

        Returns:
            Positions every `_SAMPLE_DT`, the landing last; NaN where a simulation broke off.
        """
        side = np.ones(len(actions)) if side is None else side
        members = members or self.members
        paths = members[0].follow(cast_grip_paths(actions, self.setup), self.setup)
        count = len(members)
        # One batch: neighbouring worlds follow the same motion, and rest at about the same time.
        left = [member.mirrored() for member in members]
        rows = np.arange(count) + np.where(side < 0, count, 0)[:, None]
        worlds = Dynamics.stack([*members, *left]).rows(rows.ravel())
        paths = paths[np.repeat(np.arange(len(actions)), count)]
        rollout = worlds.rollout(engine or self.engine, self.setup, paths, sample_dt=_SAMPLE_DT)
        xy = rollout.endpoint_xy
        return np.swapaxes(xy.reshape(len(actions), count, *xy.shape[1:]), 0, 1)

    def updated(self, tracks: MeasuredTracks) -> "EnsembleLandings":
        """Return the simulators after one step each towards casts that they were not fitted to.

        Simulators without a posterior stay as they are.
        """
        if not self._updates or not tracks.compared.any():
            return self
        # A few casts do not fill the cores, so the simulators run side by side.
        with concurrent.futures.ThreadPoolExecutor(core_count()) as pool:
            params = list(pool.map(lambda update: update.params_after(tracks), self._updates))
        best, *members = [
            one.with_params(found)
            for one, found in zip((self.best, *self.members), params, strict=True)
        ]
        return EnsembleLandings(
            self.setup, members, self.engine, best, self.fine_engine, self.posterior, self.task
        )

    @functools.cached_property
    def _updates(self) -> list[ParamUpdate]:
        """Update of each simulator's parameters, the best first; none without a posterior."""
        if self.posterior is None:
            return []
        cable, posterior = self.setup.cable, self.posterior
        engines = [self.fine_engine, *(self.engine for _ in self.members)]
        return [
            ParamUpdate(engine, cable, posterior, one.params)
            for engine, one in zip(engines, (self.best, *self.members), strict=True)
        ]

    def evaluate(
        self, actions: NDArray[np.float64], side: NDArray[np.float64] | None = None
    ) -> LandingEstimate:
        """Simulate casts, as `tracks`, or look up those that were simulated before."""
        side = np.ones(len(actions)) if side is None else side
        keys = [row.tobytes() for row in np.column_stack([actions, side])]
        row_of = {key: row for row, key in enumerate(keys) if key not in self._known}
        if row_of:
            new = list(row_of.values())
            count = len(self.members)
            played = (*self.members, *self._other_frictions)
            # A few casts do not fill the cores, so both resolutions run side by side.
            with concurrent.futures.ThreadPoolExecutor(1) as pool:
                best = pool.submit(
                    self.tracks, actions[new], side[new], (self.best,), self.fine_engine
                )
                tracks = self.tracks(actions[new], side[new], played)
            units = self.task.units(self.setup)
            found = estimate_landings(
                tracks[:count],
                self.setup,
                landing_xy=self.task.outcome(best.result()[0]) / units,
                friction_xy=self.task.outcome(tracks[count:]) / units,
                task=self.task,
            )
            rows = np.column_stack(
                [found.landing_xy, found.frictions, found.spreads, found.leaving]
            )
            self._known.update(zip(row_of, rows, strict=True))
        size = len(self.task.coordinates) + 3
        rows = np.array([self._known[key] for key in keys]).reshape(-1, size)
        return LandingEstimate(
            landing_xy=rows[:, :-3],
            frictions=rows[:, -3],
            spreads=rows[:, -2],
            leaving=rows[:, -1],
            factor=min(1.0, self.factor),
        )

    @functools.cached_property
    def fingerprint(self) -> str:
        """Short name of all that decides the landings."""
        resolutions = [engine_settings(engine) for engine in (self.engine, self.fine_engine)]
        physics = [one.to_dict() for one in (self.best, *self.members)]
        steps = [_FRICTION_STEP, _APART_MAX, _SAMPLE_DT, self.task.name]
        return fingerprint([self.setup.to_settings(), physics, resolutions, steps])

    def keep(self, file: pathlib.Path) -> None:
        """Write what was simulated so far to a file, if it is not there yet."""
        if len(self._known) == self._kept_count:
            return
        buffer = io.BytesIO()
        keys = np.frombuffer(b"".join(self._known)).reshape(-1, ACTION_SIZE + 1)
        np.savez(buffer, simulators=self.fingerprint, keys=keys, rows=[*self._known.values()])
        write_bytes(file, buffer.getvalue())
        self._kept_count = len(self._known)

    def recall(self, file: pathlib.Path) -> None:
        """Read what `keep` wrote, unless it is damaged or of other simulators."""
        # Whatever is wrong with the file, what it held can be simulated again.
        with contextlib.suppress(Exception), np.load(file, allow_pickle=False) as kept:
            if str(kept["simulators"]) == self.fingerprint:
                keys, rows = kept["keys"], kept["rows"]
                self._known = {key.tobytes(): row for key, row in zip(keys, rows, strict=True)}
        self._kept_count = len(self._known)

    @property
    def factor(self) -> float:
        """Size of misses over the usual one [-], from how closely the fit follows its casts."""
        if self.posterior is None:
            return 1.0
        return miss_factor(self.posterior.distance, self.posterior.track_count)

    @functools.cached_property
    def _other_frictions(self) -> tuple[Dynamics, Dynamics]:
        """The first simulator with less and with more friction."""
        first = self.members[0]
        friction = np.asarray(first.params.lateral_friction)
        less, more = (
            dataclasses.replace(first.params, lateral_friction=friction * np.exp(step))
            for step in (-_FRICTION_STEP, _FRICTION_STEP)
        )
        return first.with_params(less), first.with_params(more)


def estimate_landings(
    tracks: NDArray[np.float64],
    setup: Setup,
    *,
    landing_xy: NDArray[np.float64],
    friction_xy: NDArray[np.float64],
    task: Task = LANDING,
) -> LandingEstimate:
    """Return landings and spread from tracks in several simulators.

    Args:
        tracks: Positions of the free end [m], shape [member, action, sample, 2]; NaN where a
            simulation broke off.
        setup: Gives the table and the cable.
        landing_xy: Landings that are expected [m], shape [action, k].
        friction_xy: Landings with `_FRICTION_STEP` less and more friction [m], [2, action, k].
        task: Task whose outcomes stand for the landings.
    """
    length = setup.cable.length
    landings = task.outcome(tracks) / task.units(setup) / length
    there: NDArray[np.bool_] = np.all(np.isfinite(landings), axis=2)
    count = there.sum(axis=0)[:, None]
    summed = np.where(there[..., None], landings, 0.0).sum(axis=0)
    mean = np.where(count > 0, summed / np.maximum(count, 1), np.nan)
    spread = np.sqrt(np.mean(_distances(landings, mean) ** 2, axis=0) / landings.shape[-1])
    frictions = _distances(friction_xy[1] / length, friction_xy[0] / length) / (
        2.0 * _FRICTION_STEP
    )
    passed = np.any(setup.workspace.edge_distance(tracks) < 0.0, axis=2)
    return LandingEstimate(
        landing_xy=landing_xy, frictions=frictions, spreads=spread, leaving=passed.mean(axis=0)
    )


def _distances(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return distances of landings, `_APART_MAX` at most, and where a simulation broke off."""
    distance = np.linalg.norm(first - second, axis=-1)
    return np.where(np.isfinite(distance), np.minimum(distance, _APART_MAX), _APART_MAX)
