import numpy as np
import pytest
from synthetic_casts import network, random_actions

from cablecast.errors import CheckpointError
from cablecast.learning.gaussian_process import GaussianProcessModel
from cablecast.learning.network import ForwardModel
from cablecast.learning.policy import load_model

pytest.importorskip("safetensors")


def process():
    shared = vars(network([4, 2])).copy()
    del shared["weights"]
    return GaussianProcessModel(
        **shared,
        inputs=np.ones((3, 4), dtype=np.float32),
        length_scales=np.ones(4),
        coefficients=np.ones((3, 2)),
    )


@pytest.mark.parametrize(
    ("model", "kind"), [(network([4, 8, 2]), ForwardModel), (process(), GaussianProcessModel)]
)
def test_a_model_is_loaded_as_the_kind_that_was_saved(model, kind, tmp_path):
    model.save(tmp_path)
    loaded = load_model(tmp_path)
    assert type(loaded) is kind
    assert loaded.fingerprint == model.fingerprint
    actions = random_actions(20, seed=0)
    np.testing.assert_array_equal(loaded.predict(actions), model.predict(actions))


def test_a_model_is_not_loaded_as_another_kind(tmp_path):
    process().save(tmp_path)
    with pytest.raises(
        CheckpointError, match=r"gaussian_process .* must be cablecast.forward_model"
    ):
        ForwardModel.load(tmp_path)


def test_a_file_that_holds_no_model_is_refused_with_the_kinds_that_there_are(tmp_path):
    from safetensors.numpy import save_file

    save_file({"weight": np.ones(3)}, tmp_path / "model.safetensors")
    kinds = "must be cablecast.forward_model or cablecast.gaussian_process"
    with pytest.raises(CheckpointError, match=f"holds something: it {kinds}"):
        load_model(tmp_path)
