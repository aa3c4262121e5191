"""What counts as a strike from a direction."""

import numpy as np
import pytest
from benchmarks.arrival import arrived, good

from cablecast.engines.swing import SAMPLE_DT
from cablecast.task import Arrival

# Ten samples along x at 2 m/s.
TIP = np.arange(10.0)[:, None] * [2.0 * SAMPLE_DT, 0.0, 0.0]


@pytest.mark.parametrize(
    ("place", "turn_deg", "speed", "marks"),
    [
        (0.04, 9.0, 1.0, [True, True, True]),
        (0.06, 9.0, 1.0, [False, True, True]),
        (0.04, 11.0, 1.0, [True, False, True]),
        (0.04, 9.0, 4.0, [True, True, False]),
    ],
)
def test_distance_angle_and_speed_count_at_the_closest_point(place, turn_deg, speed, marks):
    turn = np.radians(turn_deg)
    asked = Arrival(
        goal=(TIP[5, 0], place, 0.0), direction=(np.cos(turn), np.sin(turn), 0.0), dt=SAMPLE_DT
    )
    distance, angle, found = arrived(TIP, asked)
    assert (distance, angle, found) == pytest.approx((place, turn_deg, 2.0))
    assert good(distance, angle, found / speed).tolist() == marks
