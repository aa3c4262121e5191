"""EngineWarp on a CUDA device: the same cable as on the CPU. Skipped where there is none."""

import numpy as np
import pytest
from tests.engines.wide_casts import CABLE, casts, distance_pct

from cablecast.cable import load_cable
from cablecast.engines.base import CableState
from cablecast.engines.warp_ import EngineWarp
from cablecast.engines.warp_.rollout import rollout_kernel
from cablecast.engines.warp_.world import Features
from cablecast.motion.grip_path import GripPath

SEED = 7
MATERIALS = {
    "plain": {},
    "damped and curled": {"damping_time": 0.004, "rest_curvature": 1.0},
    "yielding": {"yield_curvature": 15.0, "yield_time": 0.2},
    "in the air, with a grain": {"drag_coefficient": 1.1, "friction_ratio": 0.8},
    "with a rod at its end": {"attachment_arm": 0.02, "attachment_friction_ratio": 0.7},
}

pytestmark = pytest.mark.cuda


@pytest.fixture(autouse=True)
def cuda_device():
    import warp as wp

    EngineWarp()
    if not wp.get_cuda_devices():
        pytest.skip("no CUDA device")


def landings_apart(cable, paths, **options):
    """Distances between landings on the CPU and on CUDA [% of cable length], shape [world]."""
    cpu, cuda = (
        EngineWarp(device=device, **options).rollout(cable, paths) for device in ("cpu", "cuda")
    )
    np.testing.assert_array_equal(cpu.finite, cuda.finite)
    return distance_pct(cuda.endpoint_xy, cpu.endpoint_xy)


@pytest.mark.parametrize("name", MATERIALS)
def test_cuda_gives_the_landings_of_the_cpu(name):
    apart = landings_apart(
        CABLE.with_params(**MATERIALS[name]), casts(256, SEED), precision="double"
    )
    # Same arithmetic in another order: rounding of 1e-16, grown by the sensitivity of a cast.
    assert np.median(apart) < 1e-3
    assert np.percentile(apart, 90) < 0.1


def test_cuda_in_single_precision_lands_as_near_as_the_cpu_in_single_precision():
    double = EngineWarp(precision="double").rollout(CABLE, casts(256, SEED))
    errors = []
    for device in ("cpu", "cuda"):
        single = EngineWarp(device=device).rollout(CABLE, casts(256, SEED))
        apart = distance_pct(single.endpoint_xy, double.endpoint_xy)
        errors.append(np.percentile(apart, (50, 90)))
    assert (errors[1] < 1.5 * errors[0] + 0.01).all()


def test_cables_of_different_lengths_play_in_one_batch():
    cables = [load_cable(name) for name in ("cable_1", "cable_2", "cable_3")]
    paths = casts(3, SEED)
    cpu, cuda = (
        EngineWarp(device=device, precision="double").rollout(cables, paths)
        for device in ("cpu", "cuda")
    )
    np.testing.assert_allclose(cuda.endpoint_xyz[:, :8], cpu.endpoint_xyz[:, :8], atol=1e-6)


def test_a_cable_that_is_held_at_both_ends_and_hangs_in_the_air():
    count = 41
    nodes = np.stack([np.zeros(count), np.linspace(0, CABLE.length, count), np.zeros(count)], 1)
    path = GripPath.hold(np.zeros(5), 1.0)
    far = GripPath.hold([0.0, CABLE.length, 0.0, 0.0, 0.0], 1.0)
    cpu, cuda = (
        EngineWarp(count - 1, device=device, precision="double", table=False).rollout(
            CABLE,
            path,
            CableState.at_rest(nodes[None]),
            duration=0.3,
            far_path=far,
            record_nodes=True,
        )
        for device in ("cpu", "cuda")
    )
    assert cpu.nodes is not None
    assert cuda.nodes is not None
    np.testing.assert_allclose(cuda.nodes, cpu.nodes, atol=1e-9)


def test_a_world_depends_on_no_other_and_comes_again_to_the_bit():
    paths = casts(4000, SEED)
    engine = EngineWarp(device="cuda")
    whole, again = (engine.rollout(CABLE, paths).endpoint_xyz for _ in range(2))
    np.testing.assert_array_equal(whole, again)
    alone = engine.rollout(CABLE, paths[np.arange(33, 35)], duration=3.0)
    np.testing.assert_array_equal(whole[33:35, :30], alone.endpoint_xyz[:, :30])


def test_the_kernel_compiles_ahead_of_time(tmp_path):
    import warp as wp

    # Double precision is the same source.
    module = rollout_kernel("single", 1, Features()).kernel.module
    files = wp.compile_aot_module(module, arch=80, module_dir=tmp_path, use_ptx=True)
    assert [file.suffix for file in files] == [".ptx"]
    assert ".entry" in files[0].read_text()
