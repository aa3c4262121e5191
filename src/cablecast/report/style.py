"""Numbers and settings as text: one way of writing each, for pages, tables and the terminal.

House style of all figures: colours that colour-blind readers can tell apart, one workspace.

The environment in which the pages of reports are rendered.
"""

import base64
import io
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cablecast.errors import MissingExtraError
from cablecast.evaluation.published import PublishedRow

if TYPE_CHECKING:
    import jinja2
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from cablecast.workspace import Workspace

FIVE_NUMBERS = (
    "median_pct",
    "first_quartile_pct",
    "third_quartile_pct",
    "min_pct",
    "max_pct",
)
FIVE_HEADS = ("median", "1st quartile", "3rd quartile", "min", "max")


def pct(value: float | None, digits: int = 1) -> str:
    """Return a percentage, a dash for a missing value, "miss" for an infinite one.

    Args:
        value: Value [%]; missing where None or NaN.
        digits: Number of decimals.

    >>> pct(12.345), pct(None), pct(math.inf)
    ('12.3', '–', 'miss')
    """
    if value is None or math.isnan(value):
        return "–"
    return "miss" if math.isinf(value) else f"{value:.{digits}f}"


def share_pct(value: float | None) -> str:
    """Return a part of a whole as a percentage with its sign, a dash for a missing value.

    >>> share_pct(0.129), share_pct(None)
    ('12.9 %', '–')
    """
    return pct(value) if value is None or math.isnan(value) else f"{pct(100 * value)} %"


def five_cells(summary: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the five numbers of a summary of errors.

    JSON has no infinity: where there are errors but a number is missing, a miss decides it.

    Args:
        summary: Summary as `ErrorSummary.to_dict` and metrics.json hold it.
    """
    missing = math.inf if summary["count"] else math.nan
    values = (summary[name] for name in FIVE_NUMBERS)
    return tuple(pct(missing if value is None else value) for value in values)


def published_cells(row: PublishedRow) -> tuple[str, ...]:
    """Return the five numbers of a row of the paper, which prints whole percents."""
    return tuple(f"{getattr(row, name):.0f}" for name in FIVE_NUMBERS)


def flatten_settings(values: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """Return nested settings as lines of a table: dotted names and readable values.

    Args:
        values: Plain values, nested to any depth.
        prefix: Text before each name.

    >>> flatten_settings({"arm": {"model": "ur5"}, "seed": 0})
    [('arm.model', 'ur5'), ('seed', '0')]
    """
    lines: list[tuple[str, str]] = []
    for key, value in values.items():
        name = f"{prefix}{key}"
        if isinstance(value, Mapping):
            lines += flatten_settings(value, f"{name}.")
        elif isinstance(value, Sequence) and not isinstance(value, str):
            lines.append((name, ", ".join(_plain(item) for item in value)))
        else:
            lines.append((name, _plain(value)))
    return lines


def _plain(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


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

# Sequential maps that are as readable in grey; users cut off the pale end, which vanishes on white.
ERROR_COLORS = "plasma"
TIME_COLORS = "viridis"

PAGE_WIDTH = 9.2
"""Width of a figure that fills a page [inch]."""

_BASE_RADIUS = 0.075  # Disc that stands for the robot's base [m].
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


def new_figure(width: float, height: float) -> "Figure":
    """Return an empty figure; it needs no display and touches no global state.

    Args:
        width: Width [inch].
        height: Height [inch].

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise MissingExtraError("matplotlib", "report", "drawing figures") from None
    with styled():
        return Figure(figsize=(width, height), layout="constrained")


def styled():
    """Return a context in which axes and artists are created in the house style."""
    import matplotlib as mpl

    return mpl.rc_context(_RC)  # pyright: ignore[reportArgumentType]


def png_bytes(figure: "Figure", dpi: int = 200) -> bytes:
    """Return a figure as a PNG file.

    Args:
        figure: Figure to save.
        dpi: Resolution [pixel/inch].
    """
    buffer = io.BytesIO()
    with styled():
        figure.savefig(buffer, format="png", dpi=dpi, metadata={"Software": None})
    return buffer.getvalue()


def compact_png(figure: "Figure", dpi: int, colors: int = 64) -> bytes:
    """Return a figure as a PNG file with a palette, a third as large as `png_bytes` makes it.

    Args:
        figure: Figure to save.
        dpi: Resolution [pixel/inch].
        colors: Number of colours.
    """
    # matplotlib cannot be without it.
    from PIL import Image

    image = Image.open(io.BytesIO(png_bytes(figure, dpi))).convert("RGB").quantize(colors)
    buffer = io.BytesIO()
    image.save(buffer, format="png", optimize=True)
    return buffer.getvalue()


def svg_uri(figure: "Figure") -> str:
    """Return a figure as an SVG data URI, for a page that refers to no other file."""
    buffer = io.BytesIO()
    with styled():
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    return "data:image/svg+xml;base64," + base64.b64encode(buffer.getvalue()).decode()


def draw_workspace(
    axes: "Axes", workspace: "Workspace", *, grid: bool = True, ticks: bool = True
) -> None:
    """Draw the table and the robot's base from above, and scale both axes alike.

    Args:
        axes: Axes to draw on.
        workspace: Table to draw.
        grid: True for lines every half metre.
        ticks: True for labelled axes.
    """
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
    x_lines, y_lines = _multiples(-half_width, half_width), _multiples(y_min, y_max)
    if grid:
        line: dict[str, Any] = {"colors": FAINT, "linewidth": 0.6, "zorder": 0.5}
        # Not over the edges, which are darker.
        axes.vlines(x_lines[np.abs(x_lines) < half_width], y_min, y_max, **line)
        inner = y_lines[(y_lines > y_min) & (y_lines < y_max)]
        axes.hlines(inner, -half_width, half_width, **line)
    axes.add_patch(Circle((0.0, 0.0), _BASE_RADIUS, facecolor=INK, edgecolor="none", zorder=6))
    axes.set_aspect("equal")
    for side in axes.spines.values():
        side.set_visible(False)
    axes.set_xticks(x_lines if ticks else [])
    axes.set_yticks(y_lines if ticks else [])
    if ticks:
        axes.tick_params(length=0)
        axes.set_xlabel("x, to the robot's right [m]")
        axes.set_ylabel("y, away from the robot [m]")


def draw_half_circle(axes: "Axes", radius: float, *, closed: bool = False, **line: Any) -> None:
    """Draw the half circle about the base that lies before the robot.

    Args:
        axes: Axes to draw on.
        radius: Radius [m].
        closed: True to draw the diameter as well.
        **line: Properties of the line, in matplotlib's words.
    """
    angle = np.linspace(-np.pi / 2, np.pi / 2, 181)
    xy = radius * np.stack([np.sin(angle), np.cos(angle)], axis=1)
    if closed:
        xy = np.concatenate([xy, xy[:1]])
    axes.plot(*xy.T, **({"color": MUTED, "linewidth": 0.9, "zorder": 1} | line))


def frame_workspace(
    axes: "Axes",
    workspace: "Workspace",
    *,
    margin: float = 0.05,
    radius: float = 0.0,
    left: float | None = None,
    right: float | None = None,
) -> None:
    """Set the limits of both axes so that the table and the base are seen.

    Args:
        axes: Axes that `draw_workspace` drew on.
        workspace: The same workspace.
        margin: White around them [m].
        radius: Distance straight ahead that must be seen, too [m].
        left: Smallest x instead of the table's [m].
        right: Largest x instead of the table's [m].
    """
    (x_min, x_max), (y_min, y_max) = _extent(workspace, margin, radius)
    axes.set_xlim(x_min if left is None else left, x_max if right is None else right)
    axes.set_ylim(y_min, y_max)


def panel_height(
    workspace: "Workspace", width: float, *, margin: float = 0.05, radius: float = 0.0
) -> float:
    """Return the height of a panel with a title that `frame_workspace` fills [inch].

    Args:
        workspace: Workspace to be drawn.
        width: Width of the panel [inch].
        margin: As for `frame_workspace` [m].
        radius: As for `frame_workspace` [m].
    """
    (x_min, x_max), (y_min, y_max) = _extent(workspace, margin, radius)
    return width * min((y_max - y_min) / (x_max - x_min), _ASPECT_MAX) + _TITLE_HEIGHT


def _extent(
    workspace: "Workspace", margin: float, radius: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the ranges of x and y that show the table and the base [m]."""
    half_width = max(workspace.half_width, _BASE_RADIUS) + margin
    y_min = min(workspace.y_min, -_BASE_RADIUS) - margin
    return (-half_width, half_width), (y_min, max(workspace.y_max, radius) + margin)


def _multiples(low: float, high: float) -> np.ndarray:
    """Return the multiples of the grid's step within a range."""
    first, last = np.ceil(low / _GRID_STEP - 1e-9), np.floor(high / _GRID_STEP + 1e-9)
    return _GRID_STEP * np.arange(first, last + 1)


def template_environment() -> "jinja2.Environment":
    """Return the templates of this package; all text is escaped, and a missing name is an error.

    Raises:
        MissingExtraError: jinja2 is not installed.
    """
    try:
        import jinja2
    except ImportError:
        raise MissingExtraError("jinja2", "report", "writing the report") from None
    return jinja2.Environment(
        loader=jinja2.PackageLoader("cablecast", "report"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
