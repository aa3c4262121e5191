"""The error family: every error that cablecast raises on purpose derives from CablecastError.

Each also derives from the built-in that fits, so that `except ValueError` works too. Messages are
one line that names the offending value and the bound. The command line prints them without a
traceback and exits with status 2.
"""


class CablecastError(Exception):
    """Root of every error that cablecast raises on purpose."""


class InputError(CablecastError, ValueError):
    """A value lies outside its bound, or has the wrong shape or kind."""


class UnknownNameError(CablecastError, LookupError):
    """A name (cable, rig, engine, column) is not one of those that exist."""


class UnreadableFileError(CablecastError, OSError):
    """A file that the system refuses to read: no permission, or a failing disk. Nothing is wrong
    with its content as far as is known."""


class DamagedFileError(InputError):
    """A file whose content is not what was written."""


class TargetError(InputError):
    """A target that no planned motion can reach, or that is not finite."""


class ActionError(InputError):
    """An action outside the ranges of its action set."""


class JointLimitError(InputError):
    """A motion that would break a joint position, velocity or acceleration limit."""


class IKError(InputError):
    """A tool pose that the arm cannot reach."""


class DatasetError(CablecastError, ValueError):
    """A dataset that is missing, incomplete, or was written with other settings."""


class CheckpointError(CablecastError, ValueError):
    """A model checkpoint that is missing, truncated, or of another kind."""


class RigError(CablecastError, RuntimeError):
    """A rig that cannot be made, or that failed during a trial."""


class MissingExtraError(CablecastError, ImportError):
    """An optional library is needed that is not installed."""

    def __init__(self, library: str, extra: str, purpose: str):
        super().__init__(
            f"{purpose} needs {library}, which is not installed: pip install 'cablecast[{extra}]'"
        )
