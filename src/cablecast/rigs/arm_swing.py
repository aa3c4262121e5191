"""RigSwingArm: a real arm with a stick, from which a cable hangs, and a camera beside its swing."""

from typing import Any, Protocol

import numpy as np

from cablecast.cast import EndpointTrack
from cablecast.conventions import Array
from cablecast.errors import CameraError, StoppedError
from cablecast.motion.joint_move import JointMoves
from cablecast.rigs.arm import APPROACH_SPEED, RigArm
from cablecast.rigs.driver import RigPhase
from cablecast.rigs.path import JointCurve, straight_move
from cablecast.rigs.swings import check_swing
from cablecast.setup import Setup
from cablecast.vision.trials import TrialCamera, TrialTiming, require_camera

STILL, STILL_TIME, HANG_TIME_MAX = 0.004, 0.8, 60.0
"""Way of the tip within some time [m, s] below which a cable hangs at rest, and longest time that a
person waits for it [s]."""


class SwingCamera(Protocol):
    """A camera, or two, that see a tip in the air; as `TrialCamera`, but in space.

    Attributes:
        description: Kind and settings of the camera, as plain values for a dataset card.
    """

    description: dict[str, Any]

    def check(self, after: float | None = None) -> None:
        """Check that frames arrive and are fresh; see `TrialCamera`."""
        ...

    def start(self) -> None:
        """Start to film: the swing starts after this returns."""
        ...

    def stop(self, timing: TrialTiming) -> EndpointTrack:
        """End the film, and return the tip's track with its heights, until the cable touches."""
        ...

    def cancel(self) -> None:
        """Drop the film of a swing that was aborted; harmless where none runs."""
        ...

    def locate(self, after: float | None = None) -> Array | None:
        """Return where the tip is now [m], shape [3]; None where it is not seen."""
        ...

    def close(self) -> None:
        """Let go of the device; it may be called twice."""
        ...


class RigSwingArm(RigArm):
    """A real arm that swings a cable, behind the Rig contract.

    Every motion is checked before it is played (`check_swing`): limits, the arm against itself and
    the floor, the box of the robot section, and whether the cable could leave the box that the lab
    file says to be clear of people. It is watched while it runs, and the arm is stopped whenever
    one does not end well.

    Args:
        setup: Lab file with robot and strike sections, and an arm that was measured.
        camera: Camera that sees the swing; that of the lab file if None.
        driver: Name of the driver that the robot must be of; any if None.

    Raises:
        InputError: A section is missing, or the arm may not be driven; see `make_driver`.
        CameraError: The lab file has no camera beside the swings, or it cannot be opened.
        MissingExtraError: OpenCV is not installed.
    """

    def __init__(self, setup: Setup, camera: SwingCamera | None = None, driver: str | None = None):
        self.moves = JointMoves.of(setup)
        super().__init__(setup, camera, driver)
        self.description |= {"strike": setup.to_settings()["strike"]}

    def _open_camera(self) -> TrialCamera:
        if require_camera(self.setup).wall is None:
            raise CameraError(
                "a swing is seen by a camera beside its plane, with tags on a wall behind it: name "
                "source, tags, wall and side in the section `camera` (docs/strike.md)"
            )
        return super()._open_camera()

    def reset(self) -> None:
        """Bring the arm to the start, and wait until the cable hangs at rest.

        Raises:
            RigError: The arm may not move.
            StoppedError: The cable does not come to rest.
            JointLimitError: The straight way to the start is none that may be played.
        """
        self._begin_reset()
        self.driver.ready()
        self.camera.check(self.driver.latest().time)
        start = np.array(self.moves.start)
        way = straight_move(self._at_rest(), start, APPROACH_SPEED)
        self._check(way, "the way to the start")
        self._play("cablecast_approach", way, RigPhase.RESET)
        self._wait_until_still()
        self.driver.set_phase(RigPhase.IDLE)
        self._is_reset = True

    def _wait_until_still(self) -> None:
        began, before = self.driver.latest().time, None
        while self.driver.latest().time < began + HANG_TIME_MAX:
            self._wait(STILL_TIME)
            now = self.camera.locate(self.driver.latest().time)
            if now is not None and before is not None and np.linalg.norm(now - before) < STILL:
                return
            before = now
        seen = "is not seen" if before is None else "still sways"
        raise StoppedError(
            f"the cable {seen} after {HANG_TIME_MAX:g} s at the start: look whether its marker is "
            "in sight, and whether it hangs freely"
        )

    def _check(self, curve: JointCurve, what: str) -> None:
        check_swing(curve, self.setup, what)

    def _after(self, curve: JointCurve) -> float:
        return max(self.setup.strike_section.watch_time - curve.duration, 0.5)

    def _has_lost_cable(self) -> bool:
        """Return False: a cable is tied to a stick, and a camera that loses it says so."""
        return False


def make_arm(setup: Setup, camera: TrialCamera | None = None, driver: str | None = None) -> RigArm:
    """Return the rig of a real arm: one that swings where the set-up has a strike section."""
    return (RigArm if setup.strike is None else RigSwingArm)(setup, camera, driver)
