"""MODELCARD.md: what a model is, what it learned from, and how far it may be trusted."""

from collections.abc import Mapping
from typing import Any

from cablecast.models.base import LandingModel
from cablecast.models.forward import ForwardModel

_KINDS = {
    ForwardModel.FORMAT: "A network from an action to where the free end comes to rest "
    "(f_forw, arXiv 2405.09581, section V-F).",
    "cablecast.gaussian_process": "A Gaussian process from an action to where the free end comes "
    "to rest, the learned baseline of arXiv 2405.09581, section VI-A.",
}

_ADAPTATIONS = {
    "correction": "A Gaussian process over the action and the predicted landing adds what real "
    "casts do differently, and says how far they scatter about the prediction.",
    "fine-tuning": "The network went on training on real casts, as in the paper.",
    "real only": "The network has seen nothing but real casts.",
}


def model_card(model: LandingModel, policy_info: Mapping[str, Any] | None = None) -> str:
    """The card of a trained model, in Markdown.

    Args:
        model: The model.
        policy_info: What the search that was prepared with it says of itself.
    """
    info, cable = model.info, model.cable
    dataset, adaptation = info["dataset"], info.get("adaptation")
    lines = [
        f"# Where casts of {cable.name} land",
        "",
        _KINDS[model.FORMAT],
        "",
        "It takes (theta1, theta2, r2, psi) in radians and metres and answers with x and y on the "
        "table in metres: the robot's base is at (0, 0), y points away from it, x to its right. It "
        "was made for theta2 > 0; other actions are mirrored.",
        "",
        "## What it learned from",
        "",
        f"- {_dataset_line(dataset)}",
    ]
    if adaptation:
        if adaptation["method"] != "real only":
            lines.append(f"- {_dataset_line(adaptation['dataset'])}")
        lines += ["", _ADAPTATIONS[adaptation["method"]]]
    lines += ["", "## How well it predicts", "", *_error_lines(info["metrics"])]
    lines += [
        "",
        "These are errors of prediction, in % of cable length "
        f"({cable.length:g} m). How near casts come to targets is another matter: see "
        "`cablecast evaluate`.",
        "",
        "## What to know before using it",
        "",
        f"- It holds for this cable, for v_max = {model.setup.motion.v_max:g} m/s and "
        f"r0 = {model.setup.motion.r0:g} m, and for actions within the ranges of its casts.",
        "- It knows resting points only; whether the cable keeps to the table on its way is "
        "interpolated from the casts of its dataset.",
    ]
    if not (adaptation or dataset.get("kind") == "real"):
        lines.append("- It has seen no real cast: how far a rig differs from it is unknown to it.")
    lines += ["", "## Settings", "", "| setting | value |", "|---|---|"]
    settings = {
        "seed": info.get("seed"),
        "training": info.get("config"),
        "kernel": info.get("kernel"),
        "adaptation": adaptation and {"method": adaptation["method"]} | adaptation["config"],
        "policy": policy_info,
        "versions": info.get("versions"),
    }
    lines += [f"| {name} | {value} |" for name, value in _flatten(settings)]
    return "\n".join(lines) + "\n"


def _dataset_line(dataset: Mapping[str, Any]) -> str:
    kinds = {"sim": "simulated casts (D_sim)", "real": "casts on a rig (D_real)"}
    rig = dataset["settings"].get("rig", {}).get("rig")
    where = f" on the {rig} rig" if rig else ""
    what = kinds.get(dataset["kind"], "casts")
    if where:
        what = what.replace(" on a rig", where)
    return f"{dataset['row_count']} {what}, fingerprint `{dataset['fingerprint']}`"


def _error_lines(metrics: Mapping[str, Any]) -> list[str]:
    rows = []
    for key, count, words in (
        ("held_out", "held_out_count", "casts of its own dataset that were held out"),
        ("real_before", "real_used_count", "real casts, before it learned from them"),
        ("real", "real_used_count", "real casts, each predicted without having been seen"),
    ):
        if f"{key}_median_pct" in metrics:
            values = " | ".join(f"{metrics[f'{key}_{name}_pct']:.2f}" for name in ("median", "p90"))
            rows.append(f"| {metrics[count]} {words} | {values} |")
    lines = ["| on | median | 90 % are below |", "|---|---|---|", *rows]
    if "spread_calibration" in metrics:
        lines += [
            "",
            "Offsets of these real casts are "
            f"{metrics['spread_calibration']:.2f} times as large as it expected (rms; 1 is right).",
        ]
    return lines


def _flatten(values: Mapping[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    rows = []
    for key, value in values.items():
        if isinstance(value, Mapping):
            rows += _flatten(value, f"{prefix}{key}.")
        elif value is not None:
            rows.append((f"{prefix}{key}", value))
    return rows
