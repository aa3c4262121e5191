import numpy as np
import pytest

from cablecast.errors import InputError
from cablecast.learning.kernel import matern, solve_kernel_system

pytest.importorskip("torch")
pytestmark = pytest.mark.usefixtures("one_core")

COUNT = 240
NOISE_VARIANCE = 1e-2
TOLERANCE = 1e-6
# The kernel matrix is stored in single precision, so its entries are off by up to 6e-8 of an
# eigenvalue of order 100; the noise of 1e-2 divides that.
RELATIVE_ERROR = 2e-3


@pytest.fixture(scope="module")
def system():
    generator = np.random.default_rng(0)
    inputs = generator.uniform(-1, 1, (COUNT, 4)).astype(np.float32)
    targets = np.stack([np.sin(2 * inputs[:, 0]), inputs[:, 1] * inputs[:, 2]], axis=1)
    targets = targets.astype(float) + 0.05 * generator.normal(size=(COUNT, 2))
    matrix = matern(inputs.astype(float), inputs.astype(float)) + NOISE_VARIANCE * np.eye(COUNT)
    return inputs, targets, matrix


def solve(inputs, targets, inducing_count=40, **options):
    inducing = np.random.default_rng(1).permutation(len(inputs))[:inducing_count]
    settings = {"tolerance": TOLERANCE, "max_iterations": 300} | options
    return solve_kernel_system(inputs, targets, NOISE_VARIANCE, inducing, **settings)


@pytest.mark.parametrize("block_rows", [70, COUNT, 4000])
def test_the_weights_solve_the_dense_system(system, block_rows):
    inputs, targets, matrix = system
    weights, residuals = solve(inputs, targets, block_rows=block_rows)
    expected = np.linalg.solve(matrix, targets)
    error = np.linalg.norm(weights - expected) / np.linalg.norm(expected)
    assert error < RELATIVE_ERROR
    assert residuals[-1] <= TOLERANCE < residuals[0]


def test_the_residual_is_that_of_the_worse_output(system):
    inputs, targets, matrix = system
    weights, residuals = solve(inputs, targets, tolerance=1e-2)
    remainder = np.linalg.norm(targets - matrix @ weights, axis=0)
    expected = np.max(remainder / np.linalg.norm(targets, axis=0))
    assert residuals[-1] == pytest.approx(expected, rel=0.02, abs=1e-5)


def test_a_preconditioner_on_all_casts_leaves_next_to_nothing_to_iterate(system):
    inputs, targets, _ = system
    _, few = solve(inputs, targets, inducing_count=10)
    _, some = solve(inputs, targets, inducing_count=120)
    _, every = solve(inputs, targets, inducing_count=COUNT)
    assert len(every) <= 3 < len(some) < len(few)


def test_progress_is_told_after_every_iteration_up_to_the_greatest_number(system):
    inputs, targets, _ = system
    calls = []
    _, residuals = solve(
        inputs,
        targets,
        inducing_count=200,
        max_iterations=4,
        progress=lambda state: calls.append((state.done, state.total)),
    )
    assert calls == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert len(residuals) == 4
    assert residuals[-1] > TOLERANCE


def test_targets_that_are_not_finite_are_reported(system):
    inputs, targets, _ = system
    with pytest.raises(InputError, match="no finite solution"):
        solve(inputs, np.full_like(targets, np.nan))


def test_a_solution_that_is_none_is_refused(system):
    inputs, targets, _ = system
    with pytest.raises(InputError, match=r"residual of .* after 1 iterations: .* below 0\.1"):
        solve(inputs, targets, inducing_count=2, max_iterations=1)


def test_casts_that_all_resemble_each_other_are_told_apart():
    """Long length scales: the kernel is above 0.99, and the answer lies in its last digits."""
    generator = np.random.default_rng(2)
    inputs = generator.normal(scale=0.03, size=(1200, 4)).astype(np.float32)
    targets = np.stack([np.sin(60 * inputs[:, 0]), 30 * inputs[:, 1]], axis=1).astype(float)
    targets += generator.normal(scale=0.03, size=targets.shape)
    noise_variance, kernel = 1e-5, matern(inputs.astype(float), inputs.astype(float))
    assert kernel.mean() > 0.99
    weights, residuals = solve_kernel_system(
        inputs, targets, noise_variance, np.arange(150), tolerance=1e-3, max_iterations=200
    )
    remainder = targets - kernel @ weights - noise_variance * weights
    relative = np.linalg.norm(remainder, axis=0) / np.linalg.norm(targets, axis=0)
    # Entries rounded to 6e-8 of 1 leave a few per cent of a noise of 1e-5; the sums must not add
    # to it.
    assert np.all(relative < 0.05)
    # Without the subtracted mean, the residual grows from 0.4 for as long as one waits.
    assert len(residuals) < 50
