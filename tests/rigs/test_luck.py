"""Casts of one rig for two purposes share no luck, and casts for one purpose can be made again."""

import numpy as np
import pytest

from cablecast.data.record import collect_dataset
from cablecast.rigs.make import make_rig

ACTION = [[np.radians(-15), np.radians(10), 0.6, np.radians(10)]]


def test_casts_to_tune_with_and_real_casts_of_one_rig_do_not_share_their_luck(setup, tmp_path):
    pytest.importorskip("mujoco")
    from cablecast.rigs.virtual import RigVirtual, VirtualConfig

    config = VirtualConfig(
        segment_count=10, dt=2e-3, reset_time=0.1, rest_time_max=0.2, sensing="exact"
    )
    with make_rig(RigVirtual(setup, 3, config), setup, 3) as rig:
        ends = {}
        for name, purpose in (("tune", "tune"), ("real", "real"), ("tune again", "tune")):
            # Twice the same motion: only chance tells the casts apart.
            casts = collect_dataset(
                tmp_path / name, rig, setup, purpose=purpose, actions=ACTION, repeats=2
            )
            ends[name] = casts.rest_xy
    np.testing.assert_array_equal(ends["tune"], ends["tune again"])
    every = np.concatenate([ends["tune"], ends["real"]])
    assert len(np.unique(every, axis=0)) == len(every)
