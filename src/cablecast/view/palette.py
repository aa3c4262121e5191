"""Colours of the page and of films."""

import dataclasses

Color = tuple[int, int, int]

# The palette of Okabe and Ito, as in report/style.py, which stays distinct under colour blindness.
BLUE: Color = (0, 114, 178)
VERMILLION: Color = (213, 94, 0)
GREEN: Color = (0, 158, 115)
PURPLE: Color = (204, 121, 167)
SKY: Color = (86, 180, 233)
INK: Color = (31, 41, 51)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Paint:
    """Colours of a scene, light or dark."""

    page: Color
    table: Color
    side: Color
    line: Color
    text: Color
    arm: Color
    joint: Color
    reach: Color
    cable: Color


LIGHT = Paint(
    page=(255, 255, 255),
    table=(226, 214, 194),
    side=(176, 158, 132),
    line=(196, 182, 160),
    text=INK,
    arm=(196, 203, 212),
    joint=(94, 119, 145),
    reach=(94, 119, 145),
    cable=BLUE,
)
DARK = Paint(
    page=(26, 27, 30),
    table=(88, 80, 70),
    side=(58, 52, 45),
    line=(112, 103, 91),
    text=(230, 234, 240),
    arm=(150, 160, 172),
    joint=(70, 96, 124),
    reach=(140, 168, 196),
    cable=SKY,
)
