"""The entry point: which verb, and what a failure looks like."""

import os
import signal
import sys
import threading
from collections.abc import Sequence
from types import FrameType
from typing import Annotated

import tyro

import cablecast
from cablecast.cli.collect import Collect
from cablecast.cli.demo import Demo
from cablecast.cli.evaluate import Evaluate
from cablecast.cli.plan import PlanVerb
from cablecast.cli.repeat import Repeat
from cablecast.cli.reproduce import Reproduce
from cablecast.cli.select import Select
from cablecast.cli.simulate import Simulate
from cablecast.cli.track import Track
from cablecast.cli.train import Train
from cablecast.cli.tune import Tune
from cablecast.errors import CablecastError

EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130

_STOP_SIGNALS = ("SIGTERM", "SIGHUP")


class Stopped(KeyboardInterrupt):
    """The process was told to stop by a signal other than Ctrl-C.

    Args:
        number: Number of the signal.
    """

    def __init__(self, number: int):
        super().__init__(signal.Signals(number).name)
        self.number = number


_DESCRIPTION = """\
Teach a robot arm to throw the free end of a cable onto a target on a table.

The verbs follow one another: collect casts on a robot (real or virtual), tune a simulator to them,
simulate many more, train a model on those, plan a motion for a target, evaluate on the robot.
`cablecast demo` does all of it for one cable in minutes, `cablecast reproduce` every experiment of
the paper.
"""

_Command = (
    Annotated[Collect, tyro.conf.subcommand("collect")]
    | Annotated[Tune, tyro.conf.subcommand("tune")]
    | Annotated[Repeat, tyro.conf.subcommand("repeat")]
    | Annotated[Select, tyro.conf.subcommand("select")]
    | Annotated[Simulate, tyro.conf.subcommand("simulate")]
    | Annotated[Train, tyro.conf.subcommand("train")]
    | Annotated[PlanVerb, tyro.conf.subcommand("plan")]
    | Annotated[Evaluate, tyro.conf.subcommand("evaluate")]
    | Annotated[Track, tyro.conf.subcommand("track")]
    | Annotated[Demo, tyro.conf.subcommand("demo")]
    | Annotated[Reproduce, tyro.conf.subcommand("reproduce")]
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a verb.

    Args:
        arguments: What follows `cablecast` on the command line.

    Returns:
        0 if all went well, 2 for bad input, 3 for a plan that misses by too much, 128 and the
        number of the signal where it was stopped (130 for Ctrl-C).
    """
    _stop_on_signals()
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    if arguments == ["--version"]:
        print(f"cablecast {cablecast.__version__}")
        return 0
    try:
        command = tyro.cli(
            _Command,
            prog="cablecast",
            description=_DESCRIPTION,
            args=arguments or ["--help"],
            config=(
                tyro.conf.OmitArgPrefixes,
                tyro.conf.DisallowNone,
                tyro.conf.FlagCreatePairsOff,
            ),
        )
        status = command.run()
        sys.stdout.flush()
        return status or 0
    except CablecastError as error:
        # One line, whatever a library put into the message.
        print(f"cablecast: {' '.join(str(error).split())}", file=sys.stderr)
        return EXIT_BAD_INPUT
    except Stopped as stopped:
        print(f"cablecast: stopped by {stopped}", file=sys.stderr)
        return 128 + stopped.number
    except KeyboardInterrupt:
        print("cablecast: interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        # The reader, `head` for example, has seen enough. Python would complain again at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        # A folder that cannot be written, a full disk: nothing that a traceback would explain.
        print(f"cablecast: {' '.join(str(error).split())}", file=sys.stderr)
        return EXIT_BAD_INPUT


def _stop_on_signals() -> None:
    """Let a kill or a closed terminal end the work as Ctrl-C does, so that a rig is closed."""
    if threading.current_thread() is not threading.main_thread():
        return

    def stop(number: int, frame: FrameType | None) -> None:
        del frame
        raise Stopped(number)

    for name in _STOP_SIGNALS:
        # nohup and the like ignore a signal on purpose.
        if hasattr(signal, name) and signal.getsignal(getattr(signal, name)) == signal.SIG_DFL:
            signal.signal(getattr(signal, name), stop)
