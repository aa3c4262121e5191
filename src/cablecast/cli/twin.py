"""`cablecast twin`: the arm's controller in software, to try the robot code without a robot."""

import dataclasses
import pathlib
from typing import TYPE_CHECKING, Annotated

from cablecast.cli.options import argument, load_lab, picked
from cablecast.errors import InputError, RigError

if TYPE_CHECKING:
    from cablecast.rigs.ur.twin.laboratory import Fault

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
    program_size_max: Annotated[int, argument("BYTES")] = 100_000
    """Longest program that the controller takes."""
    generation: Annotated[str, argument("GENERATION", "by the arm's model")] = ""
    """Controller of the arm: cb3, e-series or polyscope-x."""
    fault: Annotated[tuple[str, ...], argument("NAME[:PHASE[:SECONDS]]", "none")] = ()
    """Faults to make, such as protective_stop:cast:0.3 for 0.3 s after the start of a cast."""

    def run(self) -> None:
        """Run until interrupted."""
        from cablecast.rigs.ur.twin.laboratory import TwinConfig
        from cablecast.rigs.ur.twin.process import TwinProcess

        setup = load_lab(self.setup, self.cable, None)
        options = picked(self, "address", "rate", "seed", "segment_count")
        options |= picked(self, "program_size_max", "generation")
        config = TwinConfig(**options, patience=PATIENCE)
        generation = config.generation_of(setup.arm.model)
        faults = [_fault(text) for text in self.fault]
        with TwinProcess(setup, config) as twin:
            for fault in faults:
                twin.admin.fault(fault.name, fault.phase, fault.after)
            camera = f", its camera on {twin.camera_url}" * bool(twin.camera_url)
            print(
                f"A twin of a {setup.arm.model} ({generation}) listens on {self.address}{camera}. "
                "Stop it with Ctrl-C.",
                flush=True,
            )
            twin.wait()
        raise RigError("the twin's process ended")


def _fault(text: str) -> "Fault":
    """Return the fault of NAME[:PHASE[:SECONDS]]."""
    from cablecast.rigs.ur.twin.laboratory import Fault

    name, _, rest = text.partition(":")
    phase, _, after = rest.partition(":")
    try:
        seconds = float(after or 0.0)
    except ValueError:
        raise InputError(f"--fault {text[:60]!r} must be NAME[:PHASE[:SECONDS]]") from None
    return Fault(name, phase or "now", seconds)
