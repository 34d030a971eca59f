"""Times that no motion undercuts."""

from __future__ import annotations

import numpy as np
import pytest

from arm.controller.unit import Limits
from plan.program.sequence.times import rest_to_rest, standing_time, way_bounds

LIMITS = Limits(np.full(2, -3.0), np.full(2, 3.0), np.array([1.0, 0.5]), np.array([2.0, 2.0]))


@pytest.mark.parametrize(
    ("points", "seconds"),
    [
        ([(0.0, 0.0), (2.0, 0.0)], 2.0 + 0.5),  # a trapezoid: way / v + v / a
        ([(0.0, 0.0), (0.02, 0.0)], 2.0 * np.sqrt(0.01)),  # a triangle
        ([(0.0, 0.0), (0.0, 0.2)], 0.4 + 0.25),
        ([(0.0, 0.0), (0.7, 0.0), (2.0, 0.0)], 2.5),  # what lies on the way costs nothing
        ([(0.0, 0.0), (2.0, 0.0), (0.0, 0.0)], 5.0),  # where a joint turns back it rests
        ([(0.0, 0.0), (2.0, 2.0)], 4.0 + 0.25),  # the slowest joint
        ([(0.0, 0.0), (0.0, 0.0)], 0.0),
    ],
)
def test_from_rest_to_rest_it_takes_what_the_slowest_joint_takes(
    points: list[tuple[float, float]], seconds: float
) -> None:
    assert rest_to_rest(np.array(points), LIMITS) == pytest.approx(seconds)


def test_bounds_of_ways_between_stops_are_those_from_rest_to_rest() -> None:
    q = np.random.default_rng(4).uniform(-3.0, 3.0, (5, 2))
    stops = [standing_time(one) for one in q]
    bounds = way_bounds(q, q, stops, stops, LIMITS)
    direct = [[rest_to_rest(np.array([a, b]), LIMITS) for b in q] for a in q]
    assert bounds == pytest.approx(np.array(direct))
    assert (bounds + 1e-12 >= (np.abs(q[None] - q[:, None]) / LIMITS.velocity).max(axis=-1)).all()
