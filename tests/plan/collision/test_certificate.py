"""Proofs of clearance: never above the truth, near it, and valid between the samples."""

from __future__ import annotations

import numpy as np
import pytest

from arm.controller.segments import CountPath
from arm.errors import InputError
from arm.robot.model import load_a465
from arm.robot.shapes import Body, Box, Shape
from arm.se3 import Array, apply, transform
from arms.moved_worlds import UNIT, at, count_path, crowded_world
from plan.collision.bezier import Curve, curve_of_waypoints
from plan.collision.certificate import (
    TIGHT_ABSOLUTE,
    TIGHT_RELATIVE,
    ArmErrors,
    certify_curve,
    certify_move,
    moved_by_errors,
)
from plan.collision.world import DISTANCE_ERROR, World
from tasks.task2 import Q_START, TABLE, TOOL_LENGTH


def random_cubic(world: World, rng: np.random.Generator) -> Curve:
    """One cubic about a random configuration, from hardly moving to half a radian per joint, mostly bent."""
    q = rng.uniform(UNIT.lower, UNIT.upper)
    control = q + rng.choice([0.01, 0.1, 0.5]) * rng.normal(size=(1, 4, 6))
    return Curve(control, np.array([1.0]))


def sampled(world: World, curve: Curve, count: int) -> float:
    return min(world.distance(q).value for q in at(curve, np.linspace(0.0, 1.0, count)))


@pytest.mark.slow
def test_the_bound_is_below_dense_sampling_and_near_it() -> None:
    gaps, verdicts = [], []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        world = crowded_world(rng)
        for _ in range(30):
            curve = random_cubic(world, rng)
            dense = sampled(world, curve, 120)
            tight = certify_curve(world, curve, 0.01, tight=True)
            assert tight.clearance <= dense + 2e-6
            if tight.seen > 0.0:
                assert dense >= tight.clearance - 2e-6
                assert tight.seen >= tight.clearance
                gaps.append((dense - tight.clearance) / max(dense, 1e-3))
                allowed = max(TIGHT_ABSOLUTE, TIGHT_RELATIVE * tight.seen)
                assert tight.seen - tight.clearance <= allowed + 2 * DISTANCE_ERROR
            if dense > 2e-4:
                asked = dense - 1e-4  # nearer than the gap that tight mode leaves otherwise
                assert certify_curve(world, curve, asked, tight=True).proved == (tight.seen >= asked + 2e-5)
            for clearance in (0.0, 0.01, dense + 1e-4, dense - 1e-4):
                decided = certify_curve(world, curve, clearance)
                if decided.proved:
                    assert dense >= clearance - 2e-6
                    assert decided.clearance <= dense + 2e-6
                elif dense > 0.0:
                    # the cheap mode gives up only within the arithmetic's resolution
                    assert dense < clearance + 5e-5
                verdicts.append(decided.proved)
    assert len(gaps) > 30
    assert np.median(gaps) <= 0.05
    assert 0.2 < np.mean(verdicts) < 0.8


def corners(shape: Shape) -> Array:
    assert isinstance(shape, Box)
    signs = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
    return np.asarray(signs * np.array(shape.size) / 2)


def test_grazing_moves_are_never_called_clear() -> None:
    """A floor is put 1 mm too near to the lowest finger of the move, or 1 mm further; the verdict follows."""
    rng = np.random.default_rng(11)
    robot = load_a465(TOOL_LENGTH, 0.06)
    fingers_only = [frozenset((b.name, "floor")) for b in robot.bodies if "finger" not in b.name]
    verdicts = []
    for _ in range(30):
        q0 = np.asarray(Q_START) + rng.uniform(-0.3, 0.3, 6)
        curve = curve_of_waypoints([q0, q0 + rng.uniform(-0.6, 0.6, 6)])
        lowest = min(
            apply(body.T_base_body, corners(body.shape))[:, 2].min()
            for q in at(curve, np.linspace(0.0, 1.0, 200))
            for body in robot.bodies_at(q)
            if body.name.startswith("finger")
        )
        for depth in (-1e-3, 1e-3):
            top = lowest - 0.01 + depth
            floor = Body("floor", Box((3.0, 3.0, 0.02)), transform(t=(0.0, 0.0, top - 0.01)), "table")
            world = World(robot, [floor], allowed=fingers_only)
            checked = certify_curve(world, curve, 0.01)
            if depth > 0.0 or "floor" not in checked.pair:
                assert not checked.proved
            else:
                assert checked.proved
            verdicts.append(checked.proved)
    assert 10 < sum(verdicts) <= 30


def test_clearance_lost_between_knots_is_found() -> None:
    """Both ends, and their middle, are clear; the cubic swings down in between."""
    world = World(load_a465(TOOL_LENGTH, 0.06), [TABLE])
    q = np.radians([0.0, -40.0, -80.0, 0.0, -60.0, 0.0])
    swing = np.zeros((4, 6))
    swing[1, 1], swing[2, 1] = -1.6, 1.6  # joint 2 lowers the arm when it goes negative
    curve = Curve((q + swing)[None], np.array([2.0]))
    ends = min(world.distance(q_at).value for q_at in at(curve, np.array([0.0, 0.5, 1.0])))
    assert ends > 0.02
    found = certify_curve(world, curve, 0.01, tight=True)
    assert not found.proved
    assert found.seen < 0.0
    assert "table" in found.pair
    assert 0.0 < found.time < 2.0
    assert world.distance(at(curve, np.array([found.time / 2.0]))[0]).value == pytest.approx(
        found.seen, abs=1e-9
    )


def test_a_thin_wall_between_two_way_points_is_seen() -> None:
    sheet = Body("sheet", Box((0.6, 1e-3, 1.2)), transform(t=(0.55, 0.0, 0.6)), "wall")
    world = World(load_a465(TOOL_LENGTH, 0.06), [sheet])
    left, right = np.array(Q_START), np.array(Q_START)
    right[0] = -left[0]
    assert world.distance(left).value > 0.03
    assert world.distance(right).value > 0.03
    found = certify_curve(world, curve_of_waypoints([left, right]), 0.01)
    assert not found.proved
    assert "sheet" in found.pair


def test_decide_is_cheaper_than_tight_and_agrees() -> None:
    rng = np.random.default_rng(3)
    world = crowded_world(rng)
    cost = {True: 0, False: 0}
    for _ in range(60):
        curve = random_cubic(world, rng)
        results = {tight: certify_curve(world, curve, 0.01, tight=tight) for tight in (True, False)}
        for tight, result in results.items():
            cost[tight] += (
                result.evaluations * result.proved
            )  # tight mode sees a deep collision before any piece
        if results[True].clearance >= 0.01 or results[True].seen < 0.01:
            assert results[False].proved == (results[True].clearance >= 0.01)
    assert cost[False] <= cost[True]


@pytest.mark.slow
def test_a_move_of_many_segments_is_proved_whole() -> None:
    rng = np.random.default_rng(12)
    world = crowded_world(rng)
    compared = 0
    for seed in range(30):
        path = count_path(np.random.default_rng(seed), rng.uniform(UNIT.lower, UNIT.upper), (3,) * 6)
        dense = min(world.distance(q).value for q in UNIT.positions(path.sample(1e-2)))
        found = certify_move(world, path, UNIT, 0.01)
        assert found.clearance <= dense + 2e-6
        if found.seen > 0.0:
            compared += 1
            allowed = max(TIGHT_ABSOLUTE, TIGHT_RELATIVE * found.seen)
            assert found.seen - found.clearance <= allowed + 2 * DISTANCE_ERROR
            there = UNIT.positions(path.at([found.time]))[0]
            assert world.distance(there).value == pytest.approx(found.seen, abs=1e-6)
            assert set(world.distance(there).pair) == set(found.pair)
    assert compared >= 5


def test_a_motion_that_stands_still() -> None:
    world = World(load_a465(TOOL_LENGTH, 0.06), [TABLE])
    still = CountPath(tuple(int(c) for c in UNIT.counts(Q_START)), ())
    found = certify_move(world, still, UNIT, 0.01)
    assert found.proved
    assert found.seen - DISTANCE_ERROR == pytest.approx(found.clearance, abs=1e-9)


def test_the_same_request_gives_the_same_answer() -> None:
    rng = np.random.default_rng(2)
    world = crowded_world(rng)
    curve = random_cubic(world, rng)
    assert certify_curve(world, curve, 0.01, tight=True) == certify_curve(world, curve, 0.01, tight=True)


@pytest.mark.parametrize("clearance", [float("nan"), float("inf"), None, "5 mm"])
def test_a_clearance_that_is_no_number_is_refused(clearance: object) -> None:
    world = crowded_world(np.random.default_rng(0))
    curve = random_cubic(world, np.random.default_rng(0))
    with pytest.raises(InputError, match=r"clearance = .*must be a finite number in m"):
        certify_curve(world, curve, clearance)


# An arm whose joints err
SIGMAS = 3.0


def _errors(rng: np.random.Generator, size_deg: float) -> ArmErrors:
    """Correlated errors, of another size in each joint."""
    root = np.radians(size_deg) * rng.uniform(0.2, 1.0, (6, 1)) * rng.normal(size=(6, 6)) / np.sqrt(6.0)
    return ArmErrors(root @ root.T, SIGMAS)


def _cubic(world: World, rng: np.random.Generator) -> Curve:
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


@pytest.mark.few(2)
@pytest.mark.parametrize("seed", range(6))
def test_no_error_inside_the_ellipsoid_comes_nearer_than_is_proved(seed: int) -> None:
    rng = np.random.default_rng(seed)
    world, below = crowded_world(rng), []
    for _ in range(6):
        curve, errors = _cubic(world, rng), _errors(rng, float(rng.choice([0.1, 0.6, 2.0])))
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
    curve = _cubic(world, rng)
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
    curve = _cubic(world, rng)
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
        certify_curve(world, _cubic(world, rng), 0.01, errors=ArmErrors(np.eye(7), SIGMAS))


@pytest.mark.parametrize("shift", [1e-3, 5e-3])
def test_a_shift_of_the_bodies_is_taken_off_every_distance(shift: float) -> None:
    rng = np.random.default_rng(5)
    world = crowded_world(rng)
    curve = _cubic(world, rng)
    plain = certify_curve(world, curve, 0.0, True)
    shifted = certify_curve(world, curve, 0.0, True, ArmErrors(np.zeros((6, 6)), SIGMAS, shift))
    assert shifted.seen == pytest.approx(plain.seen - shift, abs=1e-3)
    assert shifted.clearance <= plain.seen - shift
    assert min(shifted.bounds) <= plain.seen - shift
    assert shifted.clearance >= plain.clearance - shift - 1e-3


@pytest.mark.parametrize("seed", range(4))
def test_moved_by_errors_leaves_less_than_a_certificate_with_errors_and_not_far_less(seed: int) -> None:
    """They take off what the errors move the body most that they move most: a certificate knows the pair."""
    rng = np.random.default_rng(seed)
    world = crowded_world(rng)
    curve, errors = _cubic(world, rng), _errors(rng, 0.1)
    exact = certify_curve(world, curve, 0.0, True)
    (moved,) = moved_by_errors(world, [curve], errors)
    cheap = np.array(exact.bounds) - moved
    worst = _worst(world, curve, errors)
    assert cheap.min() <= worst + 2e-6
    assert (
        exact.clearance - cheap.min()
        >= exact.seen - certify_curve(world, curve, 0.0, True, errors).seen - 1e-3
    )
    (still,) = moved_by_errors(world, [_still(curve.control[0, 0])], errors)
    largest = world.volumes.placed(curve.control[:, 0]).radii[0]
    assert still[0] == pytest.approx(errors.motion(largest).max())
    radii = world.volumes.placed(at(curve, np.linspace(0.0, 1.0, 50))).radii  # of every body, along the curve
    assert moved[0] >= errors.motion(radii.reshape(-1, 6)).max() - 1e-9


def test_errors_move_a_body_on_one_curve_as_far_with_others_beside_it() -> None:
    rng = np.random.default_rng(5)
    world, errors = crowded_world(rng), _errors(rng, 0.1)
    curves = []
    for count in (1, 20, 3):
        q = rng.uniform(UNIT.lower, UNIT.upper)
        control = q + np.cumsum(0.02 * rng.normal(size=(count, 4, 6)), axis=0)
        curves.append(Curve(control, np.arange(1.0, count + 1.0)))
    together = moved_by_errors(world, curves, errors)
    for curve, moved in zip(curves, together, strict=True):
        assert len(moved) == len(curve.control)
        assert np.array_equal(moved, *moved_by_errors(world, [curve], errors))
    assert len({*together[1].tolist()}) == 8  # pieces


@pytest.mark.parametrize("seed", range(6))
def test_a_shift_of_the_bodies_is_as_a_larger_clearance_for_every_segment(seed: int) -> None:
    """Also where balls and boxes decide, far from everything."""
    rng = np.random.default_rng(seed)
    world = crowded_world(rng)
    near = _cubic(world, rng)
    far = Curve(np.concatenate([near.control, near.control + 0.3]), np.array([1.0, 2.0]))
    shift = 0.004
    shifted = certify_curve(world, far, 0.001, errors=ArmErrors(np.zeros((6, 6)), SIGMAS, shift))
    plain = certify_curve(world, far, 0.001 + shift)
    assert shifted.proved == plain.proved
    if plain.proved:
        assert np.array(shifted.bounds) == pytest.approx(np.array(plain.bounds) - shift, abs=1e-9)
