"""How all figures look: one set of colours that colour-blind readers can tell apart, one font."""

import base64
import io
from typing import TYPE_CHECKING

from cablecast.errors import MissingExtraError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from cablecast.workspace import Workspace

INK = "#1f2933"
MUTED = "#7b8794"
FAINT = "#d9dee5"
TABLE = "#f6f4ef"
# From the palette of Okabe and Ito (2008), which stays distinct under colour blindness.
BLUE = "#0072b2"
SKY = "#56b4e9"
GREEN = "#009e73"
VERMILLION = "#d55e00"
PURPLE = "#cc79a7"

# A sequential map that is as readable in grey; its pale end is cut off, which vanishes on white.
ERROR_COLORS = "plasma"
TIME_COLORS = "viridis"

_RC = {
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlecolor": INK,
    "text.color": INK,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    # Fixed, so that the same evaluation gives the same bytes.
    "svg.hashsalt": "cablecast",
    "svg.fonttype": "path",
}


def new_figure(width: float, height: float) -> "Figure":
    """An empty figure of a size in inches; needs no display and touches no global state."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise MissingExtraError("matplotlib", "report", "drawing figures") from None
    with styled():
        return Figure(figsize=(width, height), layout="constrained")


def styled():
    """A context in which axes and artists are created in the house style."""
    import matplotlib as mpl

    return mpl.rc_context(_RC)  # pyright: ignore[reportArgumentType]


def png_bytes(figure: "Figure", dpi: int = 200) -> bytes:
    """A figure as a PNG file."""
    buffer = io.BytesIO()
    with styled():
        figure.savefig(buffer, format="png", dpi=dpi, metadata={"Software": None})
    return buffer.getvalue()


def svg_uri(figure: "Figure") -> str:
    """A figure as an SVG data URI, for a page that refers to no other file."""
    buffer = io.BytesIO()
    with styled():
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    return "data:image/svg+xml;base64," + base64.b64encode(buffer.getvalue()).decode()


def draw_workspace(axes: "Axes", workspace: "Workspace", *, ticks: bool = True) -> None:
    """Draw the table with a grid of half metres and the robot's base, and scale both axes alike."""
    from matplotlib.patches import Circle, Rectangle

    half_width = workspace.table_width / 2
    axes.add_patch(
        Rectangle(
            (-half_width, 0.0),
            workspace.table_width,
            workspace.table_depth,
            facecolor=TABLE,
            edgecolor=MUTED,
            linewidth=1.0,
            zorder=0,
        )
    )
    for x in (-1.0, -0.5, 0.0, 0.5, 1.0):
        axes.plot([x, x], [0, workspace.table_depth], color=FAINT, linewidth=0.6, zorder=0.5)
    for y in (0.5, 1.0):
        axes.plot([-half_width, half_width], [y, y], color=FAINT, linewidth=0.6, zorder=0.5)
    axes.add_patch(Circle((0.0, 0.0), 0.075, facecolor=INK, edgecolor="none", zorder=6))
    axes.set_aspect("equal")
    for side in axes.spines.values():
        side.set_visible(False)
    if ticks:
        axes.set_xticks([-1.0, -0.5, 0.0, 0.5, 1.0])
        axes.set_yticks([0.0, 0.5, 1.0, 1.5])
        axes.tick_params(length=0)
        axes.set_xlabel("x, to the robot's right [m]")
        axes.set_ylabel("y, away from the robot [m]")
    else:
        axes.set_xticks([])
        axes.set_yticks([])
