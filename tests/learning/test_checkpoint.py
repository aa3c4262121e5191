import json
import os
import subprocess
import sys

import numpy as np
import pytest
from tests.learning.synthetic_casts import network, process_of, random_actions

from cablecast.errors import CheckpointError, MissingExtraError
from cablecast.learning.checkpoint import import_torch, one_thread
from cablecast.learning.gaussian_process import GaussianProcessModel
from cablecast.learning.landing import FEATURE_COUNT
from cablecast.learning.network import ForwardModel
from cablecast.learning.policy import load_model

pytest.importorskip("safetensors")


def described(seed=0):
    return network([FEATURE_COUNT, 16, 2], seed, info={"metrics": {"held_out_median_pct": 0.5}})


def test_the_description_lies_beside_the_weights_for_people(tmp_path):
    described().save(tmp_path)
    assert (
        json.loads((tmp_path / "model.json").read_text())["metrics"]["held_out_median_pct"] == 0.5
    )
    assert not list(tmp_path.glob(".*"))


def test_a_missing_model_is_named(tmp_path):
    with pytest.raises(CheckpointError, match=r"no model at .*nowhere"):
        ForwardModel.load(tmp_path / "nowhere")


@pytest.mark.parametrize("kept", [0, 5, 100, 1000, -1])
def test_a_truncated_model_is_named(tmp_path, kept):
    described().save(tmp_path)
    file = tmp_path / "model.safetensors"
    file.write_bytes(file.read_bytes()[:kept])
    with pytest.raises(CheckpointError, match=r"model.safetensors is truncated") as caught:
        ForwardModel.load(tmp_path)
    assert "\n" not in str(caught.value)


def test_a_flipped_bit_in_the_weights_is_detected(tmp_path):
    described().save(tmp_path)
    file = tmp_path / "model.safetensors"
    content = bytearray(file.read_bytes())
    content[-10] ^= 0x01
    file.write_bytes(content)
    with pytest.raises(CheckpointError, match="do not match their checksum"):
        ForwardModel.load(tmp_path)


def test_a_failed_save_leaves_the_old_model(tmp_path):
    old = described()
    old.save(tmp_path)
    broken = described(seed=1)
    broken.info["metrics"]["held_out_median_pct"] = float("nan")
    with pytest.raises(ValueError, match="JSON"):
        broken.save(tmp_path)
    assert ForwardModel.load(tmp_path).fingerprint == old.fingerprint


@pytest.mark.parametrize(
    ("model", "kind"),
    [
        (network([FEATURE_COUNT, 8, 2]), ForwardModel),
        (process_of(network([FEATURE_COUNT, 2])), GaussianProcessModel),
    ],
)
def test_a_model_is_loaded_as_the_kind_that_was_saved(model, kind, tmp_path):
    model.save(tmp_path)
    loaded = load_model(tmp_path)
    assert type(loaded) is kind
    assert loaded.fingerprint == model.fingerprint
    actions = random_actions(20, seed=0)
    np.testing.assert_array_equal(loaded.predict(actions), model.predict(actions))


def test_what_is_no_such_model_is_refused_with_the_kind_that_it_should_be(tmp_path):
    from safetensors.numpy import save_file

    process_of(network([FEATURE_COUNT, 2])).save(tmp_path)
    with pytest.raises(CheckpointError, match=r"gaussian_process .* must be cablecast.forward_mod"):
        ForwardModel.load(tmp_path)
    file = tmp_path / "model.safetensors"
    save_file({"weight": np.ones(3)}, file)
    kinds = "must be cablecast.forward_model or cablecast.gaussian_process"
    with pytest.raises(CheckpointError, match=f"holds something: it {kinds}"):
        load_model(tmp_path)
    version = {"format": "cablecast.forward_model", "format_version": "2"}
    save_file({"weight": np.ones(3)}, file, metadata=version)
    with pytest.raises(CheckpointError, match="of version 2"):
        ForwardModel.load(tmp_path)


torch = pytest.importorskip("torch")


def test_threads_that_wait_leave_the_processor_to_others():
    # libgomp prints, when loaded, what it has read.
    code = "from cablecast.learning.checkpoint import check_device; check_device('cpu')"
    environment = {k: v for k, v in os.environ.items() if k != "OMP_WAIT_POLICY"}
    done = subprocess.run(
        [sys.executable, "-c", code + "; import os; assert 'OMP_WAIT_POLICY' not in os.environ"],
        env=environment | {"OMP_DISPLAY_ENV": "TRUE"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    if "OMP_WAIT_POLICY" not in done.stderr:
        pytest.skip("torch uses no OpenMP here")
    assert "OMP_WAIT_POLICY = 'PASSIVE'" in done.stderr


def test_torch_has_one_thread_inside_the_block_and_its_own_number_after_it():
    before = torch.get_num_threads()
    with one_thread():
        assert torch.get_num_threads() == 1
    assert torch.get_num_threads() == before
    with pytest.raises(RuntimeError, match="inside"), one_thread():
        raise RuntimeError("inside")
    assert torch.get_num_threads() == before


def test_a_missing_torch_is_named_with_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(MissingExtraError, match=r"the Gaussian process needs torch.*\[learn\]"):
        import_torch("the Gaussian process")
