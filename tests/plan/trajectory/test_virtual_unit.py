"""Counts of arms without a known controller."""

from __future__ import annotations

import numpy as np

from arm.controller.unit import Unit
from arm.robot.model import Robot
from plan.trajectory.virtual_unit import virtual_unit


def test_counts_are_1_urad_and_limits_are_those_of_the_arm(robot: Robot, crs97: Unit) -> None:
    limits = crs97.limits()
    unit = virtual_unit(robot, limits)
    q = np.random.default_rng(1).uniform(limits.lower, limits.upper, (50, 6))
    counts = np.array([unit.counts(row) for row in q])
    assert np.abs(unit.positions(counts) - q).max() <= 0.5e-6 + 1e-12
    assert np.array_equal(unit.lower, limits.lower)
    assert np.array_equal(unit.upper, limits.upper)
    assert np.array_equal(unit.velocity_cap, limits.velocity)
    assert unit.axes == robot.joint_names
    assert unit.digest == virtual_unit(robot, limits.scaled(0.5)).digest
