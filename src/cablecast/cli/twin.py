"""`cablecast twin`: the arm's controller in software, to try the robot code without a robot."""

import dataclasses
import pathlib
from typing import Annotated

from cablecast.cli.options import argument
from cablecast.errors import InputError

PATIENCE = 2.0
"""Longest time for which the clock waits for a client that is silent in a motion [s]: a computer
that is busy with the simulation must not look like a network that is lost."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Twin:
    """Run a UR controller and a laboratory in software, for --rig ur to connect to.

    It speaks RTDE, the dashboard and the program port on the loopback address of this computer
    only. It runs until Ctrl-C and is ready within a minute.
    """

    setup: Annotated[pathlib.Path, argument("FILE")]
    """Lab file of the twin, with a robot section: examples/twin.yaml is one."""
    cable: Annotated[str | None, argument("CABLE", "that of --setup")] = None
    """Cable in the gripper."""
    address: str = "127.0.0.1"
    """Loopback address to listen on."""
    rate: float = 1.0
    """Largest speed of the twin's clock; it runs slower where this computer cannot keep up."""
    segment_count: Annotated[int, argument("INT")] = 30
    """Segments of the simulated cable."""
    seed: int = 0
    """Seed of what differs from trial to trial."""
    fault: Annotated[tuple[str, ...], argument("NAME[:PHASE[:SECONDS]]")] = ()
    """Faults to make, such as protective_stop:cast:0.3 for 0.3 s after a cast begins."""

    def run(self) -> None:
        """Run until interrupted."""
        from cablecast.cli.options import load_lab
        from cablecast.pipeline.twin import run_twin
        from cablecast.rigs.ur.twin.laboratory import TwinConfig

        setup = load_lab(self.setup, self.cable)
        config = TwinConfig(
            address=self.address,
            rate=self.rate,
            seed=self.seed,
            segment_count=self.segment_count,
            patience=PATIENCE,
        )
        faults = [_fault(text) for text in self.fault]
        model = setup.arm.model

        def started(twin: object) -> None:
            print(
                f"A twin of a {model} listens on {self.address}. Stop it with Ctrl-C.", flush=True
            )

        run_twin(setup, config, faults, started)


def _fault(text: str):
    """Return the fault of NAME[:PHASE[:SECONDS]]."""
    from cablecast.rigs.ur.twin.laboratory import Fault

    name, _, rest = text.partition(":")
    phase, _, after = rest.partition(":")
    try:
        return Fault(name, phase or "now", float(after or 0.0))
    except ValueError as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"--fault {text[:60]!r} must be NAME[:PHASE[:SECONDS]]") from None
