"""What several benchmarks share: random feasible actions, tables, JSON."""

import dataclasses
import io
import pathlib
import platform
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cablecast import files
from cablecast.cable import Cable
from cablecast.machine import core_count
from cablecast.motion.action import ActionRanges, MotionConfig
from cablecast.motion.feasibility import check_actions
from cablecast.workspace import Workspace

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def random_actions(
    count: int, seed: int, config: MotionConfig | None = None, *, with_psi: bool = True
) -> NDArray[np.float64]:
    """Uniformly drawn actions that the arm can execute, shape [count, 4].

    Args:
        count: How many.
        seed: Of the drawing.
        config: System parameters; the paper's by default (v_max 1.5 m/s).
        with_psi: Whether the wrist turns (action set A2) or not (A1).
    """
    config = config or MotionConfig()
    ranges = ActionRanges.for_config(config)
    rng = np.random.default_rng(seed)
    drawn: list[NDArray[np.float64]] = []
    while sum(map(len, drawn)) < count:
        u = rng.uniform(size=(count, 4))
        low = np.array([ranges.theta1[0], ranges.theta2[0], ranges.r2[0], ranges.wrist[0]])
        high = np.array([ranges.theta1[1], ranges.theta2[1], ranges.r2[1], ranges.wrist[1]])
        actions = low + u * (high - low)
        if not with_psi:
            actions[:, 3] = 0.0
        actions[:, 3] += actions[:, 1]
        drawn.append(actions[check_actions(actions, config, Workspace()).mask])
    return np.concatenate(drawn)[:count]


def landing_error_pct(
    landing_xy: NDArray[np.float64], reference_xy: NDArray[np.float64], cable: Cable
) -> NDArray[np.float64]:
    """Distance of landings from a reference in % of cable length, shape [action]."""
    return 100.0 * np.linalg.norm(landing_xy - reference_xy, axis=-1) / cable.length


@dataclasses.dataclass
class Table:
    """A table that prints as Markdown."""

    title: str
    columns: tuple[str, ...]
    rows: list[tuple]

    def __str__(self) -> str:
        cells = [self.columns, *[tuple(_show(v) for v in row) for row in self.rows]]
        widths = [max(len(str(row[i])) for row in cells) for i in range(len(self.columns))]
        lines = [
            "| " + " | ".join(str(v).ljust(w) for v, w in zip(r, widths, strict=True)) + " |"
            for r in cells
        ]
        rule = "|" + "|".join("-" * (w + 2) for w in widths) + "|"
        return "\n".join([f"\n{self.title}\n", lines[0], rule, *lines[1:]])

    def to_dict(self) -> dict:
        """Plain values for JSON."""
        return {
            "title": self.title,
            "rows": [dict(zip(self.columns, row, strict=True)) for row in self.rows],
        }


def _show(value) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def compact_png(figure: "Figure", dpi: int) -> bytes:
    """A figure as a PNG file with a palette, at a third of the usual size."""
    from PIL import Image

    from cablecast.report import style

    image = Image.open(io.BytesIO(style.png_bytes(figure, dpi))).convert("RGB").quantize(64)
    buffer = io.BytesIO()
    image.save(buffer, format="png", optimize=True)
    return buffer.getvalue()


def machine() -> dict[str, str]:
    """What the figures were measured on."""
    facts = {"python": platform.python_version(), "machine": platform.machine()}
    facts["cores"] = str(core_count())
    cpu = pathlib.Path("/proc/cpuinfo")
    if cpu.exists():
        names = [line for line in cpu.read_text().splitlines() if line.startswith("model name")]
        facts["cpu"] = names[0].split(":")[1].strip() if names else "unknown"
    for package in ("cablecast", "numpy", "warp-lang", "mujoco", "pybullet"):
        try:
            facts[package] = version(package)
        except PackageNotFoundError:
            facts[package] = "not installed"
    return facts


def write_json(path: pathlib.Path | None, tables: list[Table]) -> None:
    """Write tables and the machine they were measured on, where a file is asked for."""
    if path is None:
        return
    content = {"machine": machine(), "tables": [table.to_dict() for table in tables]}
    files.write_json(path, content)
