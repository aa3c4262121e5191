"""Entry point of the command line: choice of the verb, and its exit status."""

import contextlib
import difflib
import inspect
import os
import re
import signal
import sys
import threading
import typing
import warnings
from collections.abc import Iterator, Sequence
from types import FrameType
from typing import Annotated, Any, Union

import docstring_parser
import tyro

import cablecast
from cablecast.cli.aim import Aim
from cablecast.cli.calibrate import Calibrate
from cablecast.cli.camera import CameraVerb
from cablecast.cli.check import Check
from cablecast.cli.collect import Collect
from cablecast.cli.evaluate import Evaluate
from cablecast.cli.export import Export
from cablecast.cli.film import Film
from cablecast.cli.import_ import Import
from cablecast.cli.plan import PlanVerb
from cablecast.cli.repeat import Repeat
from cablecast.cli.reproduce import Reproduce
from cablecast.cli.select import Select
from cablecast.cli.simulate import Simulate
from cablecast.cli.streams import WrappedStream, drain, prepare_streams, say
from cablecast.cli.track import Track
from cablecast.cli.train import Train
from cablecast.cli.tune import Tune
from cablecast.cli.twin import Twin
from cablecast.cli.view import View
from cablecast.errors import CablecastError, UnknownNameError

EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130
EXIT_READER_CLOSED = 141

_RESUMING = {"aim", "collect", "evaluate", "repeat", "reproduce", "select", "simulate", "tune"}
"""Verbs that keep what is finished."""


class Stopped(KeyboardInterrupt):
    """Request to stop by a signal other than Ctrl-C."""

    def __init__(self, number: int):
        super().__init__(signal.Signals(number).name)
        self.number = number


_DESCRIPTION = """\
Teach a robot arm to cast the free end of a cable onto a target on a table.

The verb `cablecast aim` does it all: a few casts, a fit, and casts at your targets, each of which
teaches. The other verbs are its steps and those of the paper: collect casts on a real or virtual
robot, tune a simulator to them, simulate many more, train a model on those, plan a motion for a
target, evaluate on the robot. `cablecast reproduce` repeats every experiment of the paper.
"""

VERBS: dict[str, type] = {
    "check": Check,
    "aim": Aim,
    "collect": Collect,
    "import": Import,
    "tune": Tune,
    "repeat": Repeat,
    "select": Select,
    "simulate": Simulate,
    "train": Train,
    "plan": PlanVerb,
    "evaluate": Evaluate,
    "track": Track,
    "camera": CameraVerb,
    "calibrate": Calibrate,
    "export": Export,
    "view": View,
    "film": Film,
    "twin": Twin,
    "reproduce": Reproduce,
}
"""Verbs of the command line, in the order in which data flows."""


def _commands(chosen: str) -> Any:
    """Return the type of all verbs, with the first lines alone of those that are not chosen."""
    options = []
    for name, kind in VERBS.items():
        text = inspect.getdoc(kind) or ""
        if name == chosen:
            kind = _with_joined_lines(kind)
            # tyro keeps a line break before a digit.
            description = re.sub(r"(?<!\n)\n(?!\n)", " ", text)
        else:
            description = text.split("\n\n")[0]
        options.append(Annotated[kind, tyro.conf.subcommand(name, description=description)])
    return Union[tuple(options)]  # noqa: UP007


def _with_joined_lines(kind: type) -> type:
    """Return a verb whose options are described without line breaks, which tyro would keep.

    A text in the type of an option comes before that of a docstring.
    """
    texts = {
        entry.arg_name: " ".join((entry.description or "").split())
        for base in reversed(kind.__mro__[:-1])
        for entry in docstring_parser.parse_from_object(base).params
    }
    hints = typing.get_type_hints(kind, include_extras=True)
    joined = {
        name: Annotated[hints[name], tyro.conf.arg(help=text)]
        for name, text in texts.items()
        if not any(getattr(one, "help", None) for one in getattr(hints[name], "__metadata__", ()))
    }
    return type(kind.__name__, (kind,), {"__annotations__": joined, "__doc__": kind.__doc__})


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the verb of the words after `cablecast`, and return the exit status.

    It is 0 if all went well, 2 for bad input, 3 for a result that falls short, 128 and the number
    of the signal where it was stopped (130 for Ctrl-C, 141 where the reader has closed).
    """
    _stop_on_signals()
    prepare_streams()
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    try:
        with _plain_warnings():
            status = _run(arguments)
        sys.stdout.flush()
        return status
    except CablecastError as error:
        return _refuse(_with_notes(error))
    except Stopped as stopped:
        say(f"cablecast: stopped by {_with_notes(stopped)}{_again(arguments)}")
        return 128 + stopped.number
    except KeyboardInterrupt:
        say(f"cablecast: interrupted{_again(arguments)}")
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        # The reader, `head` for example, has seen enough.
        drain(sys.stdout)
        drain(sys.stderr)
        return EXIT_READER_CLOSED
    except OSError as error:
        # A folder that cannot be written, a full disk: nothing that a traceback would explain.
        drain(sys.stdout)
        return _refuse(_os_error_text(error))
    except UnicodeEncodeError as error:
        return _refuse(
            f"{error.object[:80]!r} cannot be written in the encoding {error.encoding} of this "
            "system: set LC_ALL=C.UTF-8"
        )
    except MemoryError:
        return _refuse("there is not enough memory: ask for less at once")


def _run(arguments: list[str]) -> int:
    """Run the verb of a command line, and return its exit status."""
    if arguments == ["--version"]:
        print(f"cablecast {cablecast.__version__}")
        return 0
    chosen = arguments[0] if arguments else ""
    if chosen not in VERBS and chosen[:1] not in ("", "-"):
        near = difflib.get_close_matches(chosen, VERBS, n=1)
        meant = f"did you mean {near[0]}? The verbs are" if near else "the verbs are"
        raise UnknownNameError(f"unknown verb {chosen[:40]!r}: {meant} {', '.join(VERBS)}")
    try:
        with contextlib.redirect_stdout(WrappedStream(sys.stdout)):
            command = tyro.cli(
                _commands(chosen),
                prog="cablecast",
                description=_DESCRIPTION,
                args=arguments or ["--help"],
                config=(
                    tyro.conf.OmitArgPrefixes,
                    tyro.conf.DisallowNone,
                    tyro.conf.FlagCreatePairsOff,
                ),
            )
    except SystemExit:
        # Help that cannot be written is an error like any other.
        sys.stdout.flush()
        raise
    return command.run() or 0


def _again(arguments: list[str]) -> str:
    """Return what the same command does after a stop."""
    verb = arguments[0] if arguments else ""
    if verb in _RESUMING:
        return ". The same command goes on from what is kept"
    if verb == "train":
        return ". The same command trains anew; the casts are kept"
    if verb == "calibrate":
        return ". The same command goes on from points that were typed"
    return "" if verb in ("twin", "view") else ". Nothing is kept; the same command starts anew"


def _refuse(text: str) -> int:
    """Say why in one line, whatever a library put into the message."""
    say(f"cablecast: {' '.join(text.split())}")
    return EXIT_BAD_INPUT


@contextlib.contextmanager
def _plain_warnings() -> Iterator[None]:
    """Show a warning of ours as a line of its own, and one of a library as Python does."""
    before = warnings.formatwarning

    def text(message: Warning | str, category: type[Warning], *place: Any) -> str:
        if category is UserWarning:
            return f"cablecast: note: {' '.join(str(message).split())}\n"
        return before(message, category, *place)

    warnings.formatwarning = text
    try:
        yield
    finally:
        warnings.formatwarning = before


def _with_notes(error: BaseException) -> str:
    """Return an error with its notes, such as a rig that could not be closed either."""
    return "; ".join([str(error), *getattr(error, "__notes__", [])])


def _os_error_text(error: OSError) -> str:
    """Return what the system refused, and for which file."""
    reason = error.strerror or str(error) or type(error).__name__
    if error.filename:
        text = f"{error.filename}: {reason}"
        cache = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
        cache = os.environ.get("WARP_CACHE_PATH") or cache
        # Or a folder above it that is not there, such as HOME.
        if str(error.filename).startswith(cache) or cache.startswith(f"{error.filename}/"):
            text += (
                ". The simulator keeps its compiled kernels there: set WARP_CACHE_PATH to a folder "
                "that can be written"
            )
        elif isinstance(error, (PermissionError, NotADirectoryError)):
            text += ". Give another folder, to which you may write (--out)"
        return text
    return f"standard output or a file cannot be written: {reason}"


def _stop_on_signals() -> None:
    """Let SIGTERM and SIGHUP end the work as Ctrl-C does, so that the rig is closed."""
    if threading.current_thread() is not threading.main_thread():
        return

    def stop(number: int, frame: FrameType | None) -> None:
        del frame
        raise Stopped(number)

    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        # Windows has no SIGHUP; nohup and the like ignore a signal on purpose.
        if number is not None and signal.getsignal(number) == signal.SIG_DFL:
            signal.signal(number, stop)
