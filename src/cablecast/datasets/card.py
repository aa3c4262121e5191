"""README.md of a dataset: a card for people and for dataset viewers."""

import json
from collections.abc import Mapping
from typing import Any

from cablecast.datasets.schema import COLUMNS, OPTIONAL_COLUMNS
from cablecast.runs.settings import flat_settings

_TITLES = {
    "sim": "Simulated casts (D_sim)",
    "real": "Casts on a rig for fine-tuning (D_real)",
    "tune": "Casts on a rig for tuning the simulator (D_tune)",
    "evaluate": "Casts at targets (evaluation)",
    "repeat": "The same casts again and again on a rig (repeatability)",
}

_SIMULATED = (
    "The simulated plane has no edge: a row whose free end rests beyond that of the table has the "
    "status `off_table` and keeps its resting point on the plane; the columns of the path's extent "
    "tell of those that left the table on their way. A row of status `non_finite` has no resting "
    "point."
)
_ON_A_RIG = (
    "Only a row of status `ok` has a resting point. The track holds NaN where the free end was not "
    "seen. Aborted trials were repeated and are not included."
)


def dataset_card(info: Mapping[str, Any], stats: Mapping[str, Any]) -> str:
    """Return the card of a finished dataset.

    Args:
        info: Content of `meta/info.json`.
        stats: Content of `meta/stats.json`.
    """
    settings = info["settings"]
    cable = settings.get("cable", {})
    title = f"{_TITLES.get(info['kind'], 'Casts')}: {cable.get('name', 'a cable')}"
    statuses = ", ".join(f"{count} {code}" for code, count in info["status_counts"].items())
    lines = [
        "---",
        # JSON strings are YAML strings; a cable may be called anything.
        f"pretty_name: {json.dumps(title)}",
        "task_categories:",
        "- robotics",
        "tags:",
        "- cablecast",
        "- deformable-objects",
        "- LeRobot",
        "configs:",
        "- config_name: default",
        "  data_files: data/*/*.parquet",
        "---",
        "",
        f"# {title}",
        "",
        f"{info['total_episodes']} casts of a cable of {cable.get('length', '?')} m: a row is one "
        f"action of the robot and where the cable's free end came to rest ({statuses}).",
        "",
        "```python",
        "import datasets",
        "",
        'casts = datasets.load_dataset("parquet", data_files="data/*/*.parquet")["train"]',
        "```",
        "",
        "The robot's base is at (0, 0), y points away from the robot over the table, x to the "
        "right; angles are measured from the y axis, positive to the right.",
        "",
        "| column | unit | meaning | least | greatest |",
        "|---|---|---|---|---|",
    ]
    for column in (*COLUMNS, *OPTIONAL_COLUMNS):
        if column.name not in info["features"]:
            continue
        entry = stats.get(column.name)
        low, high = (f"{entry[key][0]:.4g}" if entry else "" for key in ("min", "max"))
        lines.append(f"| `{column.name}` | {column.unit} | {column.meaning} | {low} | {high} |")
    lines += [
        "",
        _SIMULATED if info["kind"] == "sim" else _ON_A_RIG,
        "",
        "## Settings",
        "",
        f"Fingerprint `{info['fingerprint']}`; all of them are in `meta/info.json`.",
        "",
        "| setting | value |",
        "|---|---|",
        *(f"| `{name}` | {value} |" for name, value in flat_settings(settings)),
        "",
    ]
    return "\n".join(lines)
