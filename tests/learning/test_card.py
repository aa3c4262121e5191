import pytest
from tests.learning.synthetic_casts import CABLE, network, process_of

from cablecast.learning.card import model_card
from cablecast.setup import Setup

SETTINGS = Setup().with_motion(v_max=1.31, r0=0.62).to_settings()
SIMULATED = {"fingerprint": "f00d", "kind": "sim", "row_count": 36123, "settings": SETTINGS}
REAL = {
    "fingerprint": "cafe",
    "kind": "real",
    "row_count": 217,
    "settings": SETTINGS | {"rig": {"rig": "virtual"}},
}
# Every number differs from every other, so that none can stand in for another.
METRICS = {
    "held_out_count": 3612,
    "held_out_median_pct": 0.7134,
    "held_out_p90_pct": 2.4567,
    "held_out_mean_pct": 1.1111,
}
REAL_METRICS = {
    "real_count": 217,
    "real_used_count": 203,
    "real_median_pct": 5.6789,
    "real_p90_pct": 13.5791,
    "real_mean_pct": 7.7777,
    "real_before_median_pct": 9.1234,
    "real_before_p90_pct": 21.9876,
    "real_before_mean_pct": 11.2222,
}


def described(*, dataset=SIMULATED, metrics=METRICS, method=None, **info):
    info = {"dataset": dataset, "metrics": metrics, "seed": 17} | info
    if method is not None:
        info["adaptation"] = {
            "method": method,
            "config": {"epochs": 43},
            "seed": 23,
            "dataset": REAL,
            "curve": [],
        }
    return network([4, 2], info=info)


def table(card, header):
    """Rows of the table with this header, as lists of cells."""
    lines = iter(card.splitlines())
    assert header in lines
    next(lines)
    rows = []
    for line in lines:
        if not line.startswith("|"):
            break
        rows.append([cell.strip() for cell in line.strip("|").split("|")])
    return rows


def errors(card):
    return table(card, "| casts | median | 90th percentile |")


def settings(card):
    return {name: value for name, value in table(card, "| setting | value |")}


def test_the_errors_on_real_casts_are_printed_before_and_after():
    card = model_card(described(metrics=METRICS | REAL_METRICS, method="fine-tuning"))
    assert errors(card) == [
        ["3612 held-out casts of its own dataset", "0.71", "2.46"],
        ["203 real casts, before fine-tuning", "9.12", "21.99"],
        ["203 real casts, cross-validated", "5.68", "13.58"],
    ]


def test_the_casts_that_a_model_learned_from_are_named():
    card = model_card(described(metrics=METRICS | REAL_METRICS, method="fine-tuning"))
    assert "- 36123 simulated casts (D_sim), fingerprint `f00d`\n" in card
    assert "- 217 casts on the virtual rig (D_real), fingerprint `cafe`\n" in card
    alone = model_card(described(dataset=REAL, metrics=REAL_METRICS, method="real only"))
    assert alone.count("fingerprint `cafe`") == 1
    assert "f00d" not in alone


METHODS = {
    "fine-tuning": "The training of the network continued on real casts",
    "real only": "The network was trained on real casts alone",
}


@pytest.mark.parametrize("method", METHODS)
def test_the_way_of_learning_from_real_casts_is_told_and_no_other(method):
    card = model_card(described(metrics=METRICS | REAL_METRICS, method=method))
    assert [name for name, words in METHODS.items() if words in card] == [method]


def test_only_a_model_of_simulated_casts_alone_says_that_its_error_on_a_rig_is_not_known():
    words = "It was not trained on real casts"
    assert words in model_card(described())
    assert words not in model_card(described(metrics=METRICS | REAL_METRICS, method="fine-tuning"))
    assert words not in model_card(described(dataset=REAL, metrics=REAL_METRICS))


def test_cable_and_motion_are_those_of_the_dataset():
    card = model_card(described())
    assert card.startswith(f"# Landing model of {CABLE.name}\n")
    assert f"in % of cable length ({CABLE.length:g} m)" in card
    assert "v_max = 1.31 m/s and r0 = 0.62 m" in card


def test_every_setting_stands_in_the_table_and_what_is_missing_does_not():
    card = model_card(
        described(
            metrics=METRICS | REAL_METRICS,
            method="fine-tuning",
            config={"epochs": 41, "learning_rate": 0.0061},
            versions={"numpy": "2.1.7"},
        ),
        {"candidate_count": 50001, "ranges": {"r2": [0.4, 0.8]}},
    )
    assert settings(card) == {
        "seed": "17",
        "training.epochs": "41",
        "training.learning_rate": "0.0061",
        "adaptation.method": "fine-tuning",
        "adaptation.seed": "23",
        "adaptation.epochs": "43",
        "policy.candidate_count": "50001",
        "policy.ranges.r2": "[0.4, 0.8]",
        "versions.numpy": "2.1.7",
    }


def test_a_gaussian_process_is_called_one_and_tells_its_kernel():
    kernel = {"amplitude_m": 0.412, "length_scales": [1.5, 2.5]}
    card = model_card(process_of(described(kernel=kernel)))
    assert "A Gaussian process from an action" in card
    assert "neural network" not in card
    assert settings(card)["kernel.amplitude_m"] == "0.412"
    assert settings(card)["kernel.length_scales"] == "[1.5, 2.5]"
