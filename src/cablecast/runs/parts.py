"""Parts of a run: JSON files with a checksum, which exist whole or not at all."""

import dataclasses
import pathlib
from collections.abc import Callable
from typing import Any

from cablecast.errors import DamagedFileError
from cablecast.files import write_json
from cablecast.reading import read_sealed, seal


@dataclasses.dataclass(frozen=True)
class Parts:
    """Folder of finished parts.

    Attributes:
        folder: Folder; it is created when the first part is stored.
    """

    folder: pathlib.Path

    def get(self, name: str) -> dict[str, Any] | None:
        """Return a part; None where it does not exist yet.

        Raises:
            DamagedFileError: It is not what was written; says how to resume.
            UnreadableFileError: The system refuses to read it.
        """
        file = self.file(name)
        try:
            return read_sealed(file)
        except FileNotFoundError:
            return None
        except DamagedFileError as error:
            raise DamagedFileError(
                f"{error}. Delete it, and the same command makes it again"
            ) from None

    def put(self, name: str, values: dict[str, Any]) -> None:
        """Store a part; it exists whole or not at all."""
        write_json(self.file(name), seal(values))

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
