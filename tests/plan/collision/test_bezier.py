"""Curves of motions are the motions themselves."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import PPoly

from arm.errors import InputError
from arm.robot.model import Robot
from arms.moved_worlds import UNIT, at, count_path, crowded_world
from plan.collision.bezier import Curve, curve_of_counts, curve_of_path, curve_of_waypoints
from plan.collision.certificate import certify_curve
from plan.collision.world import World
from plans.given import HOME, INF, NAN
from tasks.task2 import Q_START, TABLE


def test_the_curve_is_the_executed_motion() -> None:
    """Lines, parabolas and cubics in counts: the Bernstein form passes where the controller goes."""
    rng = np.random.default_rng(4)
    path = count_path(rng, np.asarray(Q_START), (1, 3, 2, 3))
    curve = curve_of_counts(path, UNIT)
    begins = np.concatenate([[0.0], curve.ends[:-1]])
    for i in range(4):
        u = np.linspace(0.0, 1.0, 21)
        piece = Curve(curve.control[i : i + 1], np.array([1.0]))
        times = begins[i] + u * (curve.ends[i] - begins[i])
        # a hair inside, so that `at` takes the same segment at its ends
        times = np.clip(times, begins[i] + 1e-9, curve.ends[i] - 1e-9)
        assert np.abs(at(piece, u) - UNIT.positions(path.at(times))).max() < 1e-6
    assert curve.ends[-1] == pytest.approx(path.duration_s)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_the_curve_of_a_path_is_the_path(order: int) -> None:
    rng = np.random.default_rng(order)
    path = PPoly(rng.normal(size=(order + 1, 5, 6)), np.cumsum(rng.uniform(0.2, 1.0, 6)))
    curve = curve_of_path(path)
    np.testing.assert_allclose(curve.ends, path.x[1:] - path.x[0])
    u = np.linspace(0.0, 1.0, 9)
    for i in range(5):
        piece = Curve(curve.control[i : i + 1], np.array([1.0]))
        inside = path(path.x[i] + (u[:-1]) * (path.x[i + 1] - path.x[i]))
        np.testing.assert_allclose(at(piece, u)[:-1], inside, atol=1e-12)


def test_a_curve_whose_parts_do_not_fit_is_refused_by_its_shape() -> None:
    world = crowded_world(np.random.default_rng(1))
    good = np.zeros((2, 4, 6))
    for control, ends in (
        (good, np.ones(3)),
        (good, np.ones((2, 1))),
        (np.zeros((2, 4, 5)), np.ones(2)),
        (np.zeros((2, 3, 6)), np.ones(2)),
        (np.zeros((0, 4, 6)), np.ones(0)),
        (np.zeros((4, 6)), np.ones(4)),
    ):
        with pytest.raises(InputError, match=r"must be \(m, 4, 6\) and \(m,\), m at least 1") as refused:
            certify_curve(world, Curve(control, ends), 0.005)
        assert refused.value.data["shape"] == list(control.shape)


@pytest.fixture(scope="module")
def world(robot: Robot) -> World:
    return World(robot, [TABLE])


def test_a_curve_has_two_way_points_or_more_of_finite_numbers(world: World) -> None:
    for wrong in (
        [HOME],
        [],
        HOME,
        np.zeros((2, 0)),
        "way",
        None,
        [[0.0] * 6, [0.0] * 5],
        np.zeros((2, 2, 6)),
    ):
        with pytest.raises(InputError, match=r"waypoints = .*must be \(m, n\), two or more rows"):
            curve_of_waypoints(wrong)
    for bad in (NAN, INF):
        with pytest.raises(InputError, match=r"waypoints\[1\].*finite"):
            curve_of_waypoints([HOME, np.full(6, bad)])
        with pytest.raises(InputError, match="curve: a control point is not finite"):
            certify_curve(world, Curve(np.full((1, 4, 6), bad), np.ones(1)), 0.01)
        with pytest.raises(InputError, match="clearance = "):
            certify_curve(world, curve_of_waypoints([HOME, HOME]), bad)
    for n in (5, 7):
        with pytest.raises(
            InputError, match=r"must be \(m, 4, 6\) and \(m,\), m at least 1, for an arm of 6 joints"
        ):
            certify_curve(world, curve_of_waypoints(np.zeros((2, n))), 0.01)
    for curve in (
        Curve(np.zeros((0, 4, 6)), np.zeros(0)),
        Curve(np.zeros((4, 6)), np.zeros(1)),
        Curve(np.zeros((2, 4, 6)), np.zeros(1)),
    ):
        with pytest.raises(InputError, match="curve: control points of shape"):
            certify_curve(world, curve, 0.01)
