"""PolarLandings: where polar casts are expected to land, from a simulator and from real ones.

A polar cast swings the cable out in the same way at every target and pulls it slowly along the
table, so that equal casts end within some thousandths of its length, and all err alike: short by as
much as the cable is not laid out straight, and to one side the more, the more the pull turns it.
What the simulator does not have of this is modelled as a Gaussian process over the cast's
parameters, for the error along the cable and across it. So some casts correct the others, and the
next is aimed as far the other way.
"""

import contextlib
import dataclasses
import functools
from collections.abc import Sequence

import numpy as np

from cablecast.aiming.polar_errors import PolarErrors, scaled
from cablecast.cast import Cast
from cablecast.conventions import Array, polar_to_xy
from cablecast.engines.base import Engine
from cablecast.engines.dynamics import Dynamics
from cablecast.errors import CablecastError, InputError
from cablecast.motion.polar import PolarCast, PullReach, cast_paces
from cablecast.motion.trajectory import plan_trajectory
from cablecast.setup import Setup
from cablecast.task import LANDING, Expectation, Landing, MissLaw, Task
from cablecast.tuning.tuned import Tuned

ASIDE = 0.75
"""Azimuth of the two pilots aside over the largest azimuth [-]."""

LAID_OUT = 0.08
"""Distance of the free end from that of a straight cable, along it, up to which a swing has laid it
out [cable lengths]."""

KNOWN = 0.06
"""Distance from where they are expected up to which the landings of casts at a pace are known
[cable lengths]; else another pace is tried."""

UNTRIED = 0.15
"""The same of a pace that was not tried, after casts at targets at another one: 20 s of a pilot
are not spent on every doubt."""

ASTRAY = 0.2
"""Distance along the cable from where it is expected beyond which an end says nothing of other
casts, as that of a cable in a heap [cable lengths]. No cast like it is made again. A straight cable
that lies far aside is corrected."""

# Steps of the aim point towards the one that is expected on the target, and the distance from it
# at which they end [m].
_STEPS, _CLOSE = 4, 0.002
# Distance of two casts in units of `SCALES` below which they are alike.
_SAME = 0.05


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class PolarLandings:
    """Landings of polar casts.

    Attributes:
        setup: Cable, workspace, arm and motion settings.
        dynamics: Simulator whose landings are expected.
        engine: Engine that simulates it.
        reach: Places to which they bring a straight cable's end.
        casts: Polar casts that landed.
        lost: Polar casts that did not; none is made again.
    """

    setup: Setup
    dynamics: Dynamics
    engine: Engine
    reach: PullReach
    casts: tuple[Cast, ...] = ()
    lost: tuple[PolarCast, ...] = ()
    _known: dict[PolarCast, Array] = dataclasses.field(default_factory=dict, repr=False)
    # By pace, once asked for: `replace` does not hand on what other casts err by.
    _errors: dict[float, PolarErrors] = dataclasses.field(
        init=False, default_factory=dict, repr=False
    )

    @classmethod
    def of(cls, ensemble: Tuned | None, task: Task = LANDING) -> "PolarLandings | None":
        """Return the landings before any cast; None for another task, or where none is reached."""
        if ensemble is None or not isinstance(task, Landing):
            return None
        try:
            reach = PullReach.of(ensemble.setup)
        except InputError:
            return None
        return cls(
            setup=ensemble.setup,
            dynamics=ensemble.dynamics,
            engine=ensemble.member_engine,
            reach=reach,
        )

    def with_casts(self, casts: Sequence[Cast]) -> "PolarLandings":
        """Return the landings after more casts, of which only polar ones count."""
        new = [cast for cast in casts if isinstance(cast.action, PolarCast)]
        if not new:
            return self
        landed = [cast for cast in new if cast.landed]
        lost = [cast.action for cast in new if not cast.landed]
        return dataclasses.replace(self, casts=(*self.casts, *landed), lost=(*self.lost, *lost))

    @functools.cached_property
    def pace(self) -> float:
        """Pace of the casts: the first at which it is known where they land, or the best of all.

        One that folds the cable is tried after others, as the simulator tells. One that lays it now
        to one side and now to the other, which only real casts tell, is left.
        """
        doubts = []
        paces = cast_paces(self.setup)
        for pace in paces:
            doubts.append(self._doubt(pace))
            if doubts[-1] < KNOWN:
                return pace
        return paces[int(np.argmin(doubts))]

    def _doubt(self, pace: float) -> float:
        """Return how far from where they are expected casts at a pace may land [cable lengths].

        It is infinite where the arm cannot follow one straight ahead. Before the pilots of a pace
        it is what the simulator tells, unless casts at targets tell of another: an untried one is
        for pilots to try.
        """
        ahead, pilots = self.reach.ahead(pace), self._pilots(pace)
        if ahead not in pilots:
            return float("inf")
        off = [self._astray(*one) for one in self._made if one[1].pace == pace]
        if off and np.median(off) >= ASTRAY:
            return float(np.median(off))
        if len(self._at_pace(pace)) >= len(pilots):
            return self._errors_at(pace).deviation(self._between(pace))
        fold = self._folded(ahead, self._simulated_xy(ahead))
        if not fold < LAID_OUT:
            return 1.0 if np.isnan(fold) else fold
        return 0.0 if all(cast.proposal is None for cast, _ in self._made) else UNTRIED

    @property
    def pilot(self) -> PolarCast | None:
        """The next of the casts from which most is learned of the others.

        One goes straight ahead with a short pull, which shows whether a swing lays the cable out.
        Two are pulled far across from either side, since the error is that of the turning. None
        when they are made, after other casts at their pace, and where the arm cannot follow.
        """
        made, pilots = self._at_pace(self.pace), self._pilots(self.pace)
        if not set(made) <= set(pilots):
            return None
        return next((pilot for pilot in pilots if pilot not in made), None)

    def _at_pace(self, pace: float) -> list[PolarCast]:
        """Return the casts that were made at a pace, with those that did not land."""
        made = [*self.lost, *(action for _, action in self._made)]
        return [action for action in made if action.pace == pace]

    def _between(self, pace: float) -> list[PolarCast]:
        """Return two casts like those at targets, between the pilot ahead and those aside."""
        back = self.reach.back
        azimuth = 0.5 * ASIDE * back.theta_max
        radius = 0.5 * float(back.landing_radius(azimuth) + back.pulled_radius(azimuth))
        cast = PolarCast.back_to(polar_to_xy([radius, azimuth]), back, pace)
        return [cast, cast.mirrored()]

    def _pilots(self, pace: float) -> list[PolarCast]:
        """Return the pilots at a pace that the arm can follow."""
        back = self.reach.back
        azimuth, x = ASIDE * back.theta_max, 0.5 * ASIDE * self.reach.end_x_max
        aside = PolarCast(-azimuth, x, back.grip_y_min, pace)
        every = (self.reach.ahead(pace), aside, aside.mirrored())
        return [pilot for pilot in every if _is_followed(pilot, self.setup)]

    def aimed_at(self, target_xy: Array) -> PolarCast | None:
        """Return the cast that is expected nearest to a target [m], shape [2].

        None for a target beyond the reach, where the arm cannot follow, where the cable folds by
        more than in real casts, and where a cast like it was lost or went astray.
        """
        found: list[tuple[float, PolarCast]] = []
        aim_xy, most = target_xy, LAID_OUT + self._folds.get(self.pace, 0.0)
        with contextlib.suppress(CablecastError):
            for _ in range(_STEPS):
                if (cast := self.reach.cast_to(aim_xy, self.pace)) is None:
                    break
                if self._folded(cast, self._modelled(cast)[0]) > most:
                    break
                offset = target_xy - self.expectation(cast).mean
                plan_trajectory(cast, self.setup)
                found.append((float(np.linalg.norm(offset)), cast))
                if found[-1][0] < _CLOSE:
                    break
                aim_xy = aim_xy + offset
        if not found:
            return None
        best = min(found, key=lambda one: one[0])[1]
        astray = [one[1] for one in self._made if self._astray(*one) >= ASTRAY]
        wasted = [other for other in (*self.lost, *astray) if other.pace == best.pace]
        steps = [scaled(best) - scaled(other) for other in wasted]
        return None if any(np.linalg.norm(step) < _SAME for step in steps) else best

    def expectation(self, cast: PolarCast, law: MissLaw | None = None) -> Expectation:
        """Return where a cast is expected to land.

        Raises:
            CablecastError: There is no such cast.
        """
        length, axes = self.setup.cable.length, self.reach.axes(cast)
        mean, left, noise = self._errors_at(cast.pace).at(cast)
        middle, doubt = self._modelled(cast)
        along = np.array([doubt**2, 0.0])
        covariance = length**2 * axes.T @ np.diag(left + noise + along) @ axes
        return Expectation(
            mean=middle + length * mean @ axes,
            covariance=covariance,
            law=law or MissLaw(),
            scatter=length * float(np.sqrt(np.mean(noise))),
        )

    def _simulated_xy(self, cast: PolarCast) -> Array:
        """Return where a cast lands in the simulator [m], shape [2]."""
        if cast not in self._known:
            path = cast.grip_path(self.setup)
            rollout = self.dynamics.rollout(self.engine, self.setup, path)
            self._known[cast] = rollout.endpoint_xy[0, -1]
        return self._known[cast]

    def _modelled(self, cast: PolarCast) -> tuple[Array, float]:
        """Return where a cast lands before its error is known [m], [2], and a doubt [lengths].

        That is where the simulator says; or where a straight cable ends, if the simulator folds the
        cable, and real casts at the pace of this one laid it out. Which of them is right is not
        known: the doubt is half of the fold.
        """
        simulated_xy = self._simulated_xy(cast)
        folded = self._folded(cast, simulated_xy)
        if folded > LAID_OUT and self._folds.get(cast.pace, np.inf) < LAID_OUT:
            return self.reach.end_xy(cast.to_array()), 0.5 * folded
        return simulated_xy, 0.0

    @functools.cached_property
    def _made(self) -> list[tuple[Cast, PolarCast]]:
        """The casts that landed, with their motions."""
        return [(cast, cast.action) for cast in self.casts if isinstance(cast.action, PolarCast)]

    @functools.cached_property
    def _folds(self) -> dict[float, float]:
        """Median fold of the cable in the casts that were made at each pace [cable lengths]."""
        folds: dict[float, list[float]] = {}
        for cast, action in self._made:
            folds.setdefault(action.pace, []).append(self._folded(action, cast.final_xy))
        return {pace: float(np.median(own)) for pace, own in folds.items()}

    def _errors_at(self, pace: float) -> PolarErrors:
        """Return what the simulator errs by at a pace, as swings err differently.

        Casts that went astray say nothing of it.
        """
        if pace not in self._errors:
            own = [one for one in self._made if one[1].pace == pace and self._astray(*one) < ASTRAY]
            self._errors[pace] = PolarErrors(
                reach=self.reach,
                actions=tuple(action for _, action in own),
                errors=np.reshape([self._error(*one) for one in own], (-1, 2)),
            )
        return self._errors[pace]

    def _folded(self, action: PolarCast, end_xy: Array) -> float:
        """Return how far an end is from that of a straight cable, along it [cable lengths]."""
        offset = end_xy - self.reach.end_xy(action.to_array())
        return float(abs(self.reach.axes(action)[0] @ offset)) / self.setup.cable.length

    def _astray(self, cast: Cast, action: PolarCast) -> float:
        """Return how far along the cable an end is from where it was modelled [cable lengths]."""
        return abs(float(self._error(cast, action)[0]))

    def _error(self, cast: Cast, action: PolarCast) -> Array:
        """Return the error of the simulator on the axes of a cast [cable lengths], shape [2]."""
        offset = cast.final_xy - self._modelled(action)[0]
        return self.reach.axes(action) @ offset / self.setup.cable.length


@functools.lru_cache(maxsize=64)
def _is_followed(cast: PolarCast, setup: Setup) -> bool:
    """Return whether the arm can follow a cast."""
    with contextlib.suppress(CablecastError):
        plan_trajectory(cast, setup)
        return True
    return False
