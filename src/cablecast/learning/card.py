"""Text of MODELCARD.md: description of a model, its training data, and its prediction errors."""

from collections.abc import Mapping
from typing import Any

from cablecast.learning.gaussian_process import GaussianProcessModel
from cablecast.learning.landing import LandingModel
from cablecast.learning.network import ForwardModel
from cablecast.runs.folder import flat_settings

_KINDS = {
    ForwardModel.FORMAT: "A neural network from an action to the resting point of the free end "
    "(f_forw, arXiv 2405.09581, section V-F).",
    GaussianProcessModel.FORMAT: "A Gaussian process from an action to the resting point of the "
    "free end, the learned baseline of arXiv 2405.09581, section VI-A.",
}

_ADAPTATIONS = {
    "fine-tuning": "The training of the network continued on real casts, as in the paper.",
    "real only": "The network was trained on real casts alone.",
}

# Prefix of the metrics, key of the number of casts, and words for the casts.
_ERROR_ROWS = (
    ("held_out", "held_out_count", "held-out casts of its own dataset"),
    ("real_before", "real_used_count", "real casts, before fine-tuning"),
    ("real", "real_used_count", "real casts, cross-validated"),
)


def model_card(model: LandingModel, policy_info: Mapping[str, Any] | None = None) -> str:
    """Return the card of a trained model in Markdown.

    Args:
        model: Trained model.
        policy_info: Description of the search policy that was built with it.
    """
    info, cable, motion = model.info, model.setup.cable, model.setup.motion
    metrics, adaptation = info["metrics"], info.get("adaptation")
    settings = {
        "seed": info.get("seed"),
        "training": info.get("config"),
        "kernel": info.get("kernel"),
        "policy": policy_info,
        "versions": info.get("versions"),
    }
    data = [_dataset_line(info["dataset"])]
    if adaptation:
        if adaptation["method"] != "real only":
            data.append(_dataset_line(adaptation["dataset"]))
        data += ["", _ADAPTATIONS[adaptation["method"]]]
        adapted = {"method": adaptation["method"], "seed": adaptation["seed"]}
        settings["adaptation"] = adapted | adaptation["config"]
    errors = [
        f"| {metrics[count]} {words} | {metrics[f'{name}_median_pct']:.2f} "
        f"| {metrics[f'{name}_p90_pct']:.2f} |"
        for name, count, words in _ERROR_ROWS
        if f"{name}_median_pct" in metrics
    ]
    lines = [
        f"# Landing model of {cable.name}",
        "",
        _KINDS[model.FORMAT],
        "",
        "Its input is (theta1, theta2, r2, psi, pace) in radians and metres, with a pace of 1 for "
        "the paper's motions, its output x and y on the table in metres. The robot's base is at "
        "(0, 0), y points away from it, and x to its right. The model holds for theta2 > 0; "
        "other actions are mirrored.",
        "",
        "## Training data",
        "",
        *data,
        "",
        "## Prediction errors",
        "",
        "| casts | median | 90th percentile |",
        "|---|---|---|",
        *errors,
        "",
        f"These are errors of prediction, in % of cable length ({cable.length:g} m). "
        "`cablecast evaluate` measures how near casts come to targets.",
        "",
        "## Limits",
        "",
        f"- It holds for this cable, for v_max = {motion.v_max:g} m/s and r0 = {motion.r0:g} m, "
        "and for actions within the ranges of its casts.",
        "- It predicts endpoints only. Whether a cast keeps the cable on the table is interpolated "
        "from the casts of its dataset.",
    ]
    if not model.has_real_casts:
        lines.append("- It was not trained on real casts, so its error on a rig is unknown.")
    lines += ["", "## Settings", "", "| setting | value |", "|---|---|"]
    lines += [f"| {key} | {value} |" for key, value in flat_settings(settings) if value is not None]
    return "\n".join(lines) + "\n"


def _dataset_line(dataset: Mapping[str, Any]) -> str:
    rig = dataset["settings"].get("rig", {}).get("rig")
    words = {
        "sim": "simulated casts (D_sim)",
        "real": f"casts on {f'the {rig}' if rig else 'a'} rig (D_real)",
    }
    what = words.get(dataset["kind"], "casts")
    return f"- {dataset['row_count']} {what}, fingerprint `{dataset['fingerprint']}`"
