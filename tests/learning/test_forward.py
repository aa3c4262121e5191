import itertools
import subprocess
import sys

import numpy as np
import pytest

from cablecast.errors import InputError
from cablecast.learning.network import ForwardModel
from cablecast.setup import Setup
from cablecast.workspace import Workspace

OTHER = Setup(cable="cable_2", workspace=Workspace(table_width=2.0)).with_motion(v_max=1.2)

pytest.importorskip("safetensors")

# Predictions are computed in single precision, for landings of the order of a metre.
SINGLE_PRECISION = 1e-5


def random_model(seed=0):
    generator = np.random.default_rng(seed)
    widths = [4, 16, 16, 2]
    layers = tuple(
        (
            generator.normal(size=(a, b)).astype(np.float32) / np.float32(np.sqrt(a)),
            generator.normal(size=b).astype(np.float32),
        )
        for a, b in itertools.pairwise(widths)
    )
    return ForwardModel(
        weights=layers,
        feature_mean=np.array([-0.7, 0.7, 0.5, 0.7]),
        feature_scale=np.array([0.4, 0.4, 0.1, 0.4]),
        endpoint_mean=np.array([0.5, 0.9]),
        endpoint_scale=0.3,
        margin_features=generator.normal(size=(40, 4)).astype(np.float32),
        margins=generator.normal(size=40).astype(np.float32),
        info={
            "metrics": {"held_out_median_pct": 0.5},
            "dataset": {"settings": OTHER.to_settings()},
        },
    )


def some_actions(count=100):
    actions = np.random.default_rng(1).uniform(
        [-1.3, 0.1, 0.4, 0.1], [-0.1, 1.3, 0.8, 1.5], (count, 4)
    )
    actions[:, 3] += actions[:, 1]
    return actions


def test_a_saved_model_is_loaded_with_the_same_predictions_and_description(tmp_path):
    model = random_model()
    model.save(tmp_path)
    loaded = ForwardModel.load(tmp_path)
    np.testing.assert_array_equal(loaded.predict(some_actions()), model.predict(some_actions()))
    np.testing.assert_array_equal(
        loaded.predict_margin(some_actions()), model.predict_margin(some_actions())
    )
    assert loaded.info == model.info
    assert loaded.fingerprint == model.fingerprint
    assert loaded.setup == OTHER


def test_numpy_predicts_what_torch_computes():
    torch = pytest.importorskip("torch")
    model = random_model()
    hidden = torch.tensor(model.normalize(some_actions(5000)))
    for k, (matrix, offset) in enumerate(model.weights):
        hidden = hidden @ torch.tensor(matrix) + torch.tensor(offset)
        if k < len(model.weights) - 1:
            hidden = torch.nn.functional.silu(hidden)
    expected = model.endpoint_mean + model.endpoint_scale * hidden.numpy()
    np.testing.assert_allclose(model.predict(some_actions(5000)), expected, atol=SINGLE_PRECISION)


def test_predicting_does_not_import_torch(tmp_path):
    random_model().save(tmp_path)
    code = (
        "import sys, numpy as np\n"
        "from cablecast.learning.network import ForwardModel\n"
        f"model = ForwardModel.load({str(tmp_path)!r})\n"
        "model.predict(np.ones((3, 4)))\n"
        "assert 'torch' not in sys.modules and 'scipy' not in sys.modules\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True)
    assert done.returncode == 0, done.stderr.decode()


def test_extreme_features_do_not_make_a_prediction_non_finite():
    assert np.all(np.isfinite(random_model().predict(np.full((1, 4), -1e4))))


def test_margins_are_interpolated_between_simulated_actions():
    model = random_model()
    features = model.margin_features[:5] * model.feature_scale + model.feature_mean
    features[:, 3] += features[:, 1]
    at_rows = model.predict_margin(features)
    np.testing.assert_allclose(at_rows, model.margins[:5], atol=1e-3)
    everywhere = model.predict_margin(some_actions())
    assert model.margins.min() <= everywhere.min()
    assert everywhere.max() <= model.margins.max()


def test_actions_of_the_wrong_shape_are_refused():
    with pytest.raises(InputError, match=r"shape \(4,\)"):
        random_model().predict(np.ones(4))
