"""House style of all figures: colours for colour-blind readers, and one map of the table."""

import base64
import contextlib
import io
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

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

PAGE_WIDTH = 9.2
"""Width of a figure that fills a page [inch]."""

BASE_RADIUS = 0.075
"""Disc that stands for the robot's base [m]."""

_GRID_STEP = 0.5  # Lines on the table, and ticks [m].
_TITLE_HEIGHT = 0.25  # Room for the title of a panel [inch].
_ASPECT_MAX = 1.0  # A table deeper than wide gets white at its sides, not a page-long panel.

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
    # A name may hold dollar signs.
    "text.parse_math": False,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    # Fixed, so that one evaluation always gives the same bytes.
    "svg.hashsalt": "cablecast",
    "svg.fonttype": "path",
}


@contextlib.contextmanager
def styled() -> Iterator[None]:
    """Create axes and artists in the house style; a context, or a decorator of a function."""
    try:
        import matplotlib as mpl
    except ImportError:
        raise MissingExtraError("matplotlib", "report", "drawing figures") from None
    with mpl.rc_context(_RC):  # pyright: ignore[reportArgumentType]
        yield


@styled()
def new_figure(width: float, height: float) -> "Figure":
    """Return an empty figure [inch]; it needs no display and touches no global state."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


@styled()
def png_bytes(figure: "Figure", dpi: int = 200) -> bytes:
    """Return a figure as a PNG file of a resolution [pixel/inch]."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi, metadata={"Software": None})
    return buffer.getvalue()


def compact_png(figure: "Figure", dpi: int) -> bytes:
    """Return a PNG file with a palette of 64 colours, a third as large as that of `png_bytes`."""
    # matplotlib depends on Pillow.
    from PIL import Image

    image = Image.open(io.BytesIO(png_bytes(figure, dpi))).convert("RGB").quantize(64)
    buffer = io.BytesIO()
    image.save(buffer, format="png", optimize=True)
    return buffer.getvalue()


@styled()
def svg_uri(figure: "Figure") -> str:
    """Return a figure as an SVG data URI, for a page that refers to no other file."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    return "data:image/svg+xml;base64," + base64.b64encode(buffer.getvalue()).decode()


class MapView(NamedTuple):
    """Part of the plane of the table that a map shows [m]."""

    x_min: float
    x_max: float
    y_min: float
    y_max: float

    def height(self, width: float) -> float:
        """Return the height of a panel of a width that it fills, with its title [inch]."""
        aspect = (self.y_max - self.y_min) / (self.x_max - self.x_min)
        return width * min(aspect, _ASPECT_MAX) + _TITLE_HEIGHT


def workspace_view(
    workspace: "Workspace",
    *,
    margin: float = 0.05,
    radius: float = 0.0,
    left: float | None = None,
    right: float | None = None,
) -> MapView:
    """Return the view that shows the whole table and the base, with white around them [m].

    It reaches at least `radius` straight ahead [m]; `left` and `right` replace the table's x [m].
    """
    half_width = max(workspace.half_width, BASE_RADIUS) + margin
    return MapView(
        -half_width if left is None else left,
        half_width if right is None else right,
        min(workspace.y_min, -BASE_RADIUS) - margin,
        max(workspace.y_max, radius) + margin,
    )


def draw_workspace(
    axes: "Axes", workspace: "Workspace", view: MapView, *, grid: bool = True, ticks: bool = True
) -> None:
    """Draw the table and the robot's base from above, to scale, and fix the limits of the axes."""
    from matplotlib.patches import Circle, Rectangle

    half_width, y_min, y_max = workspace.half_width, workspace.y_min, workspace.y_max
    axes.add_patch(
        Rectangle(
            (-half_width, y_min),
            2 * half_width,
            y_max - y_min,
            facecolor=TABLE,
            edgecolor=MUTED,
            linewidth=1.0,
            zorder=0,
        )
    )
    x_lines = multiples(_GRID_STEP, -half_width, half_width)
    y_lines = multiples(_GRID_STEP, y_min, y_max)
    if grid:
        line: dict[str, Any] = {"colors": FAINT, "linewidth": 0.6, "zorder": 0.5}
        # Not over the edges, which are darker.
        axes.vlines(x_lines[np.abs(x_lines) < half_width], y_min, y_max, **line)
        inner = y_lines[(y_lines > y_min) & (y_lines < y_max)]
        axes.hlines(inner, -half_width, half_width, **line)
    axes.add_patch(Circle((0.0, 0.0), BASE_RADIUS, facecolor=INK, edgecolor="none", zorder=6))
    axes.set_aspect("equal")
    for side in axes.spines.values():
        side.set_visible(False)
    axes.set_xticks(x_lines if ticks else [])
    axes.set_yticks(y_lines if ticks else [])
    if ticks:
        axes.tick_params(length=0)
        axes.set_xlabel("x, to the robot's right [m]")
        axes.set_ylabel("y, away from the robot [m]")
    axes.set_xlim(view.x_min, view.x_max)
    axes.set_ylim(view.y_min, view.y_max)


def multiples(step: float, low: float, high: float) -> np.ndarray:
    """Return the multiples of a step within a range."""
    first, last = np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9)
    return step * np.arange(first, last + 1)


def workspace_panels(
    workspace: "Workspace",
    view: MapView,
    count: int = 1,
    *,
    columns: int = 1,
    width: float = PAGE_WIDTH,
    below: float = 0.0,
    beside: float = 0.0,
    grid: bool = True,
    ticks: bool = True,
) -> tuple["Figure", list["Axes"]]:
    """Return a figure with `count` maps of the table, and the axes of each.

    Its width is in inches, as is the room below the maps, e.g. for a legend, and next to them, e.g.
    for a colour bar.
    """
    rows = -(-max(count, 1) // columns)
    figure = new_figure(width, rows * view.height((width - beside) / columns) + below)
    panels = figure.subplots(rows, columns, squeeze=False).ravel().tolist()
    for axes in panels[:count]:
        draw_workspace(axes, workspace, view, grid=grid, ticks=ticks)
    for axes in panels[count:]:
        axes.remove()
    return figure, panels[:count]


def draw_half_circle(axes: "Axes", radius: float, *, closed: bool = False, **line: Any) -> None:
    """Draw the half circle of a radius [m] in front of the base; with its diameter if closed."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, 181)
    xy = radius * np.stack([np.sin(angle), np.cos(angle)], axis=1)
    if closed:
        xy = np.concatenate([xy, xy[:1]])
    axes.plot(*xy.T, **({"color": MUTED, "linewidth": 0.9, "zorder": 1} | line))


def annotate(
    axes: "Axes", text: str, xy: ArrayLike, offset: tuple[float, float], **style: Any
) -> None:
    """Write text near a point [m], at an offset from it [1/72 inch].

    The style is in matplotlib's words; `halo` is the width of a white rim.
    """
    from matplotlib.patheffects import withStroke

    if halo := style.pop("halo", 0.0):
        style["path_effects"] = [withStroke(linewidth=halo, foreground="white")]
    point = np.asarray(xy, dtype=float)
    axes.annotate(text, (point[0], point[1]), xytext=offset, textcoords="offset points", **style)


def draw_grid(axes: "Axes", axis: Literal["x", "y", "both"] = "both") -> None:
    """Draw the lines of a grid across an axis, behind what is drawn."""
    axes.grid(axis=axis, color=FAINT, linewidth=0.6)
    axes.set_axisbelow(True)


def log_scale(axes: "Axes", axis: Literal["x", "y"]) -> None:
    """Give an axis a logarithmic scale with numbers at 1, 2 and 5: no text here is a formula."""
    from matplotlib.ticker import LogLocator, NullLocator

    axes.set(**{f"{axis}scale": "log"})
    drawn = axes.xaxis if axis == "x" else axes.yaxis
    drawn.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    drawn.set_major_formatter(lambda value, _: f"{value:g}")
    drawn.set_minor_locator(NullLocator())


LegendEntries = Sequence[tuple[str, str, dict[str, Any]]]
"""Label, format as of `plot`, and properties of a line or marker, of each entry of a legend."""


def legend_strip(figure: "Figure", entries: LegendEntries, columns: int = 3) -> None:
    """Draw a legend below all axes, where the figure has room."""
    handles = _handles(entries)
    # A legend of the figure, not of the axes: the layout then keeps room for it below.
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=min(columns, len(handles)),
        columnspacing=1.6,
        labelcolor=INK,
    )


def legend_panel(figure: "Figure", panels: Sequence["Axes"], entries: LegendEntries) -> bool:
    """Draw a legend in the place of the last panel, where no panel stands; return whether it is so.

    The panels are those of `workspace_panels`.
    """
    grid = panels[0].get_gridspec()
    if grid is None or len(panels) == grid.nrows * grid.ncols:
        return False
    free = figure.add_subplot(grid[-1, -1])
    free.axis("off")
    free.legend(handles=_handles(entries), loc="center", labelcolor=INK)
    return True


def _handles(entries: LegendEntries) -> list[Any]:
    from matplotlib.lines import Line2D

    handles = []
    for label, form, style in entries:
        line = {"linestyle": "-"} if form == "-" else {"linestyle": "", "marker": form}
        handles.append(Line2D([], [], label=label, **line, **style))
    return handles


def color_scale(name: str, first: float, last: float, top: float) -> Any:
    """Return a mapping from values in [0, top] to colours of a part of a matplotlib colour map.

    `first` and `last` are the places of the colours of 0 and top in it; pale ends vanish on white.
    """
    import matplotlib as mpl
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LinearSegmentedColormap, Normalize

    colors = mpl.colormaps[name](np.linspace(first, last, 64))
    return ScalarMappable(Normalize(0.0, top), LinearSegmentedColormap.from_list(name, colors))


def draw_color_bar(figure: "Figure", axes: Any, scale: Any, label: str, **options: Any) -> None:
    """Draw the bar of a colour scale next to axes; options in the words of `Figure.colorbar`."""
    bar = figure.colorbar(scale, ax=axes, **options)
    bar.set_label(label)
    bar.outline.set_visible(False)  # pyright: ignore[reportCallIssue]
