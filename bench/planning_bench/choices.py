"""Which grips a sampling planner tries, in which order: the same for all peers, as a careful user would do it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from arm.se3 import Array
from plan.trajectory.time_estimates import straight_time
from planning_bench.grips import GripLine, grip_lines
from planning_bench.query import Query

SAMPLES = 6  # of a line in closed form, to see that it stays on its branch
TRIES = 40  # pairs of grips before giving up


def pairs(query: Query, index: int, q_from: Array) -> Iterator[tuple[GripLine, GripLine]]:
    """Grips of pick and place of transfer `index`, the least time of straight transits first, all yaws and branches.

    Time ties (one slow joint decides) go to the least motion of all joints.
    """
    robot, limits, transfer = query.scene.robot_open, query.limits, query.transfers[index]
    picks = grip_lines(robot, transfer.pick, limits, SAMPLES)
    places = grip_lines(robot, transfer.place, limits, SAMPLES)
    if not picks or not places:
        return
    a, b = (np.array([g.q_offset for g in lines]) for lines in (picks, places))
    time = straight_time(a - q_from, limits)[:, None] + straight_time(b[None] - a[:, None], limits)
    way = np.abs(a - q_from).sum(axis=1)[:, None] + np.abs(b[None] - a[:, None]).sum(axis=2)
    if index + 1 == len(query.transfers):
        time = time + straight_time(query.q_start - b, limits)
        way = way + np.abs(query.q_start - b).sum(axis=1)
    order = np.lexsort((way.ravel(), np.round(time, 6).ravel()))[:TRIES]
    for i, j in zip(*np.unravel_index(order, time.shape), strict=True):
        yield picks[i], places[j]
