"""Fit, simulated casts, training and first aim on a CUDA device; skipped where there is none."""

import numpy as np
import pytest

import cablecast as cc

pytestmark = [pytest.mark.cuda, pytest.mark.slow]


@pytest.fixture(autouse=True, scope="module")
def cuda_device():
    torch = pytest.importorskip("torch")
    if not torch.cuda.is_available():
        pytest.skip("no CUDA device")


@pytest.fixture(scope="module")
def casts():
    pytest.importorskip("mujoco")
    with cc.make_rig("virtual", cc.Setup(cable="cable_3"), seed=0) as rig:
        yield cc.collect(rig, count=5, sampling="spread")


def test_a_fit_on_cuda_follows_the_casts_as_closely_as_one_on_the_cpu(casts):
    cpu, cuda = (cc.tune(casts, validation_count=0, device=device) for device in ("cpu", "cuda"))
    assert cpu.posterior is not None
    assert cuda.posterior is not None
    # Rounding differs, and a step of the fit may end elsewhere within what the casts leave open.
    assert cuda.posterior.distance < 1.1 * cpu.posterior.distance


def test_the_first_aim_is_prepared_on_cuda(casts, tmp_path):
    with cc.make_rig("virtual", cc.Setup(cable="cable_3"), seed=0) as rig:
        config = cc.AimConfig(device="cuda", simulated_count=2000, epochs=20)
        session = cc.prepare_aim(rig, config, casts=casts, out=tmp_path)
        proposal = session.propose(r=1.05, theta_deg=15.0)
    # The network has seen few casts, but the fit plays what it proposes.
    apart = np.linalg.norm(proposal.expected.mean - proposal.goal.value)
    assert apart < 0.05 * session.setup.cable.length
