"""Certificates of an arm whose joints err: never above the truth for any error that they allow for, and near it."""

from __future__ import annotations

import numpy as np
import pytest

from arm.errors import InputError
from arm.robot.model import load_a465
from arm.robot.shapes import Body, Box
from arm.se3 import Array, transform
from arms.moved_worlds import UNIT, at, crowded_world
from plan.collision.bezier import Curve, curve_of_waypoints
from plan.collision.certificate import TIGHT_ABSOLUTE, TIGHT_RELATIVE, ArmErrors, certify_curve
from plan.collision.world import DISTANCE_ERROR, World
from tasks.task2 import TOOL_LENGTH

SIGMAS = 3.0


def _errors(rng: np.random.Generator, size_deg: float) -> ArmErrors:
    """Correlated errors, of another size in each joint."""
    root = np.radians(size_deg) * rng.uniform(0.2, 1.0, (6, 1)) * rng.normal(size=(6, 6)) / np.sqrt(6.0)
    return ArmErrors(root @ root.T, SIGMAS)


def _curve(world: World, rng: np.random.Generator) -> Curve:
    """A cubic about a configuration that keeps a distance."""
    q = rng.uniform(UNIT.lower, UNIT.upper)
    while not 0.01 < world.distance(q).value < 0.1:
        q = rng.uniform(UNIT.lower, UNIT.upper)
    return Curve(q + rng.choice([0.003, 0.02, 0.1]) * rng.normal(size=(1, 4, 6)), np.array([1.0]))


def _still(q: Array) -> Curve:
    return curve_of_waypoints(np.stack([q, q]))


def _worst(world: World, curve: Curve, errors: ArmErrors) -> float:
    """Least distance on samples of the motion, each with the error of the ellipsoid that lowers it most."""
    q, worst = at(curve, np.linspace(0.0, 1.0, 60)), np.inf
    near = world.near(q, 10.0)
    along = near.gradient @ errors.covariance
    falls = SIGMAS * np.sqrt(np.maximum((along * near.gradient).sum(axis=1), 1e-30))
    for row in range(len(q)):
        mine = np.flatnonzero(near.row == row)
        for k in mine[np.argsort((near.distance - falls)[mine])[:3]]:
            off = -(SIGMAS**2) / falls[k] * along[k]
            worst = min(worst, world.distance(q[row] + off).value)
    return worst


@pytest.mark.parametrize("seed", range(6))
def test_no_error_inside_the_ellipsoid_comes_nearer_than_is_proved(seed: int) -> None:
    rng = np.random.default_rng(seed)
    world, below = crowded_world(rng), []
    for _ in range(6):
        curve, errors = _curve(world, rng), _errors(rng, float(rng.choice([0.1, 0.6, 2.0])))
        worst = _worst(world, curve, errors)
        found = certify_curve(world, curve, 0.01, tight=True, errors=errors)
        assert found.clearance <= worst + 2e-6
        still = [
            certify_curve(world, _still(q), 0.0, True, errors) for q in at(curve, np.linspace(0.0, 1.0, 25))
        ]
        least = min(
            one.seen for one in still
        )  # d(q) less what the errors may move: the piece's bounds allow for both
        assert min(found.bounds) <= least + 2e-6
        if found.seen > 0.0:
            allowed = max(TIGHT_ABSOLUTE, TIGHT_RELATIVE * found.seen) + 4.0 * DISTANCE_ERROR
            assert found.seen - found.clearance <= allowed
        assert all(min(one.bounds) <= one.seen + 1e-9 for one in still)
        plain = certify_curve(world, curve, 0.01, tight=True)
        assert found.clearance <= plain.seen
        for clearance in (0.0, 0.01, worst + 1e-4):
            assert not (
                certify_curve(world, curve, clearance, errors=errors).proved and worst < clearance - 2e-6
            )
        below.append(plain.seen - found.seen)
    assert max(below) > 1e-5


def test_without_errors_it_is_the_certificate_of_an_exact_arm() -> None:
    rng = np.random.default_rng(7)
    world = crowded_world(rng)
    curve = _curve(world, rng)
    exact = ArmErrors(np.zeros((6, 6)), SIGMAS)
    for tight in (False, True):
        assert certify_curve(world, curve, 0.01, tight, exact) == certify_curve(world, curve, 0.01, tight)


@pytest.mark.parametrize("sigma_deg", [0.01, 0.05])
def test_a_turning_base_loses_its_lever_times_the_error(sigma_deg: float) -> None:
    """A wall beside the fingers at 0.7 m: an error of J1 by s moves them by s times their distance from its axis."""
    robot = load_a465(TOOL_LENGTH, 0.06)
    q = np.radians([0.0, -40.0, -80.0, 0.0, -60.0, 0.0])
    x, y = robot.T_base_tool(q)[:2, 3]
    wall = Body("wall", Box((0.001, 0.02, 2.0)), transform(t=(x, y + 0.08, 0.5)), "wall")
    world, still = World(robot, [wall]), _still(q)
    covariance = np.zeros((6, 6))
    covariance[0, 0] = np.radians(sigma_deg) ** 2
    exact, erring = (
        certify_curve(world, still, 0.0, True, errors) for errors in (None, ArmErrors(covariance, SIGMAS))
    )
    assert exact.clearance - erring.clearance == pytest.approx(exact.seen - erring.seen, abs=1e-6)
    assert exact.clearance - erring.clearance == pytest.approx(
        SIGMAS * np.radians(sigma_deg) * np.hypot(x, y), rel=0.15
    )


def test_errors_that_may_add_up_count_so_whatever_their_signs() -> None:
    rng = np.random.default_rng(3)
    world = crowded_world(rng)
    curve = _curve(world, rng)
    found = []
    for sign in (1.0, -1.0):
        covariance = np.radians(0.05) ** 2 * np.eye(6)
        covariance[1, 2] = covariance[2, 1] = sign * 0.9 * covariance[1, 1]
        found.append(certify_curve(world, curve, 0.0, True, ArmErrors(covariance, SIGMAS)).clearance)
    independent = certify_curve(world, curve, 0.0, True, ArmErrors(np.radians(0.05) ** 2 * np.eye(6), SIGMAS))
    assert found[0] == found[1] <= independent.clearance


def test_errors_of_another_arm_are_refused() -> None:
    rng = np.random.default_rng(0)
    world = crowded_world(rng)
    with pytest.raises(InputError, match=r"errors: covariance of shape \(7, 7\): must be \(6, 6\)"):
        certify_curve(world, _curve(world, rng), 0.01, errors=ArmErrors(np.eye(7), SIGMAS))


@pytest.mark.parametrize("shift", [1e-3, 5e-3])
def test_a_shift_of_the_bodies_is_taken_off_every_distance(shift: float) -> None:
    rng = np.random.default_rng(5)
    world = crowded_world(rng)
    curve = _curve(world, rng)
    plain = certify_curve(world, curve, 0.0, True)
    shifted = certify_curve(world, curve, 0.0, True, ArmErrors(np.zeros((6, 6)), SIGMAS, shift))
    assert shifted.seen == pytest.approx(plain.seen - shift, abs=1e-3)
    assert shifted.clearance <= plain.seen - shift
    assert min(shifted.bounds) <= plain.seen - shift
    assert shifted.clearance >= plain.clearance - shift - 1e-3
