"""Features: what a kernel plays beside the plain cable, each compiled in only where asked for."""

import dataclasses


@dataclasses.dataclass(frozen=True, kw_only=True)
class Features:
    """Choices that are made when a kernel is compiled, so that what is off costs nothing.

    Attributes:
        table: True where the cable meets a table.
        remembers: True for a material that remembers bends.
        drags: True where the air resists with the square of the speed.
        grained: True where friction differs along and across the cable.
    """

    table: bool = True
    remembers: bool = False
    drags: bool = False
    grained: bool = False
