"""Features: what a kernel plays beside the plain cable, each compiled in only where asked for."""

import dataclasses


@dataclasses.dataclass(frozen=True, kw_only=True)
class Features:
    """Choices that are made when a kernel is compiled, so that what is off costs nothing.

    A kernel takes ten seconds to compile, so there are few: one that remembers bends plays the
    surface, too, which costs it 2 %.

    Attributes:
        table: True where the cable meets a table.
        remembers: True for a material that remembers bends.
        surface: True where the air resists with the square of the speed, and friction differs along
            and across the cable.
    """

    table: bool = True
    remembers: bool = False
    surface: bool = False
