import numpy as np

from cablecast.report.reproduction import share_of_draws


def test_an_order_of_methods_is_told_from_chance_by_drawing_the_targets_anew():
    errors = np.random.default_rng(0).uniform(0.0, 20.0, size=(32, 5))
    errors[3, 1:] = np.nan
    assert share_of_draws(errors, errors + 5.0) == 1.0
    assert share_of_draws(errors + 5.0, errors) == 0.0
    # A method that is better at every second target is better by chance.
    other = errors[np.arange(32)[::-1]]
    assert 0.2 < share_of_draws(errors, other) < 0.8
