"""ArrayRows: records whose fields are arrays with one row for each of the same things."""

import dataclasses
from collections.abc import Sequence
from typing import Self

import numpy as np


@dataclasses.dataclass(frozen=True, kw_only=True)
class ArrayRows:
    """Base of records of arrays that are selected and joined together."""

    def __len__(self) -> int:
        return len(getattr(self, dataclasses.fields(self)[0].name))

    def __getitem__(self, rows) -> Self:
        """Return the rows that a slice, a mask or an array of indices selects."""
        return type(self)(
            **{field.name: getattr(self, field.name)[rows] for field in dataclasses.fields(self)}
        )

    @classmethod
    def join(cls, parts: Sequence[Self]) -> Self:
        """Return several as one."""
        return cls(
            **{
                field.name: np.concatenate([getattr(part, field.name) for part in parts])
                for field in dataclasses.fields(cls)
            }
        )
