"""Errors: every error that cablecast raises on purpose derives from CablecastError.

Each also derives from the matching built-in, so that `except ValueError` works too. A message is
one line that names the offending value and the bound. The command line prints it without a
traceback and exits with status 2.
"""


class CablecastError(Exception):
    """Base of every error that cablecast raises on purpose."""


class InputError(CablecastError, ValueError):
    """A value that is out of bounds, or of the wrong shape or type."""


class UnknownNameError(CablecastError, LookupError):
    """A name (cable, rig, engine, column) that does not exist."""


class UnreadableFileError(CablecastError, OSError):
    """A file that the system refuses to read: no permission, or a failing disk.

    Its content may be intact.
    """


class DamagedFileError(InputError):
    """A file whose content differs from what was written."""


class TargetError(InputError):
    """A target that no planned motion can reach, or that is not finite."""


class ActionError(InputError):
    """An action outside the ranges of its action set."""


class JointLimitError(InputError):
    """A motion that violates a joint position, velocity or acceleration limit."""


class IKError(InputError):
    """A tool pose that the arm cannot reach."""


class DatasetError(CablecastError, ValueError):
    """A dataset that is missing, incomplete, or was written with other settings."""


class CheckpointError(CablecastError, ValueError):
    """A model checkpoint that is missing, truncated, or of another kind."""


class RigError(CablecastError, RuntimeError):
    """A rig that cannot be created, or that failed during a trial."""


class CameraError(RigError):
    """A camera that cannot be opened, or that failed while it filmed."""


class MissingExtraError(CablecastError, ImportError):
    """An optional library that is needed but not installed."""

    def __init__(self, library: str, extra: str, purpose: str):
        super().__init__(
            f"{purpose} needs {library}, which is not installed: pip install 'cablecast[{extra}]'"
        )
