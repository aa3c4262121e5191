import json

import numpy as np
import pytest
from synthetic_casts import network

from cablecast.errors import CheckpointError
from cablecast.learning.network import ForwardModel

pytest.importorskip("safetensors")


def described(seed=0):
    return network([4, 16, 2], seed, info={"metrics": {"held_out_median_pct": 0.5}})


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


def test_a_foreign_safetensors_file_is_refused(tmp_path):
    from safetensors.numpy import save_file

    save_file({"weight": np.ones(3)}, tmp_path / "model.safetensors")
    with pytest.raises(CheckpointError, match=r"must be cablecast.forward_model"):
        ForwardModel.load(tmp_path)
    save_file(
        {"weight": np.ones(3)},
        tmp_path / "model.safetensors",
        metadata={"format": "cablecast.forward_model", "format_version": "2"},
    )
    with pytest.raises(CheckpointError, match="of version 2"):
        ForwardModel.load(tmp_path)


def test_a_failed_save_leaves_the_old_model(tmp_path):
    old = described()
    old.save(tmp_path)
    broken = described(seed=1)
    broken.info["metrics"]["held_out_median_pct"] = float("nan")
    with pytest.raises(ValueError, match="JSON"):
        broken.save(tmp_path)
    assert ForwardModel.load(tmp_path).fingerprint == old.fingerprint
