"""Parts of a run: JSON files with a checksum, which exist whole or not at all."""

import dataclasses
import pathlib
from collections.abc import Callable
from typing import Any

from cablecast.errors import DamagedFileError
from cablecast.files import write_json
from cablecast.reading import read_sealed, seal

OWNER_KEY = "run"


@dataclasses.dataclass(frozen=True)
class Parts:
    """Folder of finished parts.

    Attributes:
        folder: Folder; it is created when the first part is stored.
        owner: Fingerprint of the run that the parts belong to; empty for parts that anybody reads.
        remedy: What to do about a damaged part, for errors.
    """

    folder: pathlib.Path
    owner: str = ""
    remedy: str = "Delete it, and the same command makes it again"

    def get(self, name: str) -> dict[str, Any] | None:
        """Return a part; None where it does not exist yet.

        Raises:
            DamagedFileError: It is not what was written, or belongs to another run; says how to
                resume.
            UnreadableFileError: The system refuses to read it.
        """
        file = self.file(name)
        try:
            values = read_sealed(file)
        except FileNotFoundError:
            return None
        except DamagedFileError as error:
            raise DamagedFileError(f"{error}. {self.remedy}") from None
        if values.pop(OWNER_KEY, self.owner) != self.owner:
            raise DamagedFileError(f"{file} belongs to a run of other settings. {self.remedy}")
        return values

    def put(self, name: str, values: dict[str, Any]) -> None:
        """Store a part; it exists whole or not at all."""
        owner = {OWNER_KEY: self.owner} if self.owner else {}
        write_json(self.file(name), seal({**values, **owner}))

    def get_or_make(self, name: str, make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """Return a part, made and stored first where it is missing."""
        values = self.get(name)
        if values is None:
            self.put(name, make())
            values = self.get(name)
        return values or {}

    def file(self, name: str) -> pathlib.Path:
        """Return the file of a part."""
        return self.folder / f"{name}.json"
