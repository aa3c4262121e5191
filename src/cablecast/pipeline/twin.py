"""Twin: the real robot's controller and camera in software, for as long as somebody wants them."""

from collections.abc import Callable

from cablecast.errors import RigError
from cablecast.rigs.ur.twin.laboratory import Fault, TwinConfig
from cablecast.rigs.ur.twin.process import TwinProcess
from cablecast.setup import Setup


def run_twin(
    setup: Setup,
    config: TwinConfig | None = None,
    faults: list[Fault] | None = None,
    started: Callable[[TwinProcess], None] | None = None,
) -> None:
    """Run a twin until it is interrupted.

    Args:
        setup: Lab file of the twin, with a robot section.
        config: Where it listens, and how it behaves.
        faults: What goes wrong, each at its moment.
        started: Called once the twin answers.

    Raises:
        InputError: A port is not free, or the set-up has no robot.
        RigError: The twin ended by itself.
    """
    with TwinProcess(setup, config) as twin:
        for fault in faults or []:
            twin.admin.fault(fault.name, fault.phase, fault.after)
        if started is not None:
            started(twin)
        twin.wait()
    raise RigError("the twin's process ended")
