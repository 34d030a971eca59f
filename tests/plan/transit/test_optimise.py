"""Ways around, made faster: never slower, always proved, always the same; and the gradients that drive them."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from arm.controller.unit import load_unit
from arm.errors import ImpossibleError
from arm.robot.shapes import Body, Box, Cylinder, Shape
from arm.se3 import Array, rotation, transform
from arms.grazing import ARMS, OBSTACLES, arm, obstacle, world_of
from plan.budget import TransitBudget
from plan.collision.bezier import curve_of_waypoints
from plan.collision.certificate import certify_curve
from plan.collision.world import Near, World
from plan.trajectory.time_estimates import path_time
from plan.transit.optimise import _EXTRA, Ends, Shortening, TransitOptimiser, _Model
from plan.transit.planner import plan_transit
from tasks.task2 import TABLE

LIMITS = load_unit("crs93").limits().scaled(0.5)
CLEARANCE = 0.01
QUERIES = 40
ROUGH = TransitBudget(corners=120, corner_edges=40, rrt=600, shortcuts=20, steps=0)
FULL = TransitBudget(corners=120, corner_edges=40, rrt=600, shortcuts=20, steps=10)


@cache
def queries() -> tuple[tuple[World, Array, Array, Ends], ...]:
    """Blocked on the straight way, clear at both ends; half of them entered and left at speed."""
    rng = np.random.default_rng(21)
    found: list[tuple[World, Array, Array, Ends]] = []
    while len(found) < QUERIES:
        world = world_of(("open", "holding")[len(found) % 2], [TABLE, *_around(rng, 4)])
        ends = rng.uniform(0.7 * LIMITS.lower, 0.7 * LIMITS.upper, (2, 6))
        ends[1] = ends[0] + np.clip(ends[1] - ends[0], -1.5, 1.5)
        if any(world.in_collision(q, CLEARANCE) for q in ends):
            continue
        if certify_curve(world, curve_of_waypoints(ends), CLEARANCE).proved:
            continue
        speed = (len(found) % 4 > 1) * 0.5 * rng.uniform(-1.0, 1.0, (2, 6)) * LIMITS.velocity
        found.append((world, ends[0], ends[1], Ends(speed[0], speed[1])))
    return tuple(found)


def _around(rng: np.random.Generator, count: int) -> list[Body]:
    bodies = []
    for i in range(count):
        angle = rng.uniform(-np.pi, np.pi)
        place = np.array([0.55 * np.cos(angle), 0.55 * np.sin(angle), rng.uniform(0.2, 0.8)])
        a, b, c = (float(v) for v in rng.uniform(0.05, 0.35, 3))
        shape: Shape = Box((a, b, c)) if i % 2 else Cylinder(a / 3.0, c)
        bodies.append(Body(f"body {i}", shape, transform(rotation(rng.normal(size=3)), place), "wall"))
    return bodies


def way(index: int, budget: TransitBudget) -> Array | None:
    world, q_from, q_to, ends = queries()[index]
    try:
        return plan_transit(world, q_from, q_to, LIMITS, CLEARANCE, 7, budget, ends)
    except ImpossibleError:
        return None


@cache
def ways() -> tuple[tuple[Array | None, Array | None], ...]:
    """As found, and made faster."""
    return tuple((way(i, ROUGH), way(i, FULL)) for i in range(QUERIES))


@pytest.mark.slow
def test_optimised_paths_are_faster_and_certified() -> None:
    gains = []
    for (world, q_from, q_to, ends), (rough, better) in zip(queries(), ways(), strict=True):
        assert (rough is None) == (better is None)
        if rough is None or better is None:
            continue
        for path in (rough, better):
            assert np.array_equal(path[[0, -1]], [q_from, q_to])
            assert np.all((path >= LIMITS.lower) & (path <= LIMITS.upper))
            assert certify_curve(world, curve_of_waypoints(path), CLEARANCE).proved
            samples = [a + u * (b - a) for a, b in pairwise(path) for u in np.linspace(0.0, 1.0, 60)]
            assert not any(world.in_collision(q, CLEARANCE - 1e-6) for q in samples)
        times = [path_time(path, LIMITS, ends.enter, ends.leave) for path in (rough, better)]
        assert times[1] <= times[0] + 1e-9
        gains.append(1.0 - times[1] / times[0])
    assert len(gains) > 0.8 * QUERIES
    assert np.mean(gains) > 0.01  # most ways need little, some much


@pytest.mark.slow
def test_the_same_query_has_the_same_way() -> None:
    """Whatever was asked before."""
    for index in range(0, QUERIES, 5):
        again, known = way(index, FULL), ways()[index][1]
        assert (again is None) == (known is None)
        if again is not None and known is not None:
            assert np.array_equal(again, known)


@cache
def rough_paths() -> tuple[tuple[TransitOptimiser, Array], ...]:
    """Paths around a box through two random corners each, clear at samples; each with its optimiser."""
    rng, still = np.random.default_rng(22), Ends(np.zeros(6), np.zeros(6))
    found: list[tuple[TransitOptimiser, Array]] = []
    while len(found) < 8:
        world = world_of("holding", [TABLE, *_around(rng, 4)])
        optimiser = TransitOptimiser(world, LIMITS, CLEARANCE, still)
        path = rng.uniform(0.5 * LIMITS.lower, 0.5 * LIMITS.upper, (4, 6))
        if optimiser.blocked(path[[0, 3]]) and not (
            world.in_collision(path[0], CLEARANCE) or optimiser.blocked(path, 0.05)
        ):
            found.append((optimiser, path))
    return tuple(found)


@pytest.mark.slow
def test_steps_go_on_where_they_ended() -> None:
    for optimiser, path in rough_paths()[:3]:
        at_once, in_parts = Shortening(optimiser, path), Shortening(optimiser, path)
        at_once.run(5)
        in_parts.run(2)
        in_parts.run(3)
        assert np.array_equal(at_once.path, in_parts.path)
        assert at_once.time == in_parts.time < optimiser.time(path)


@pytest.mark.slow
def test_every_step_keeps_the_path_clear_at_its_samples() -> None:
    """Whole steps and halves of them; each is faster."""
    halved = 0
    for optimiser, path in rough_paths():
        shortening, time = Shortening(optimiser, path), optimiser.time(path)
        for _ in range(8):
            region = shortening._region
            shortening.run(1)
            assert not optimiser.blocked(shortening.path)
            assert shortening.time <= time
            halved += shortening._region == 0.5 * region
            time = shortening.time
    assert halved


@pytest.mark.parametrize("seed", range(20))
def test_what_the_limit_of_one_joint_leaves_undone_another_does(seed: int) -> None:
    """A constraint that asks for nearly all the room there is, with way-points near their limits."""
    rng, still = np.random.default_rng(seed), Ends(np.zeros(6), np.zeros(6))
    optimiser = TransitOptimiser(world_of("open", []), LIMITS, -1.0, still)  # nothing is near
    path = np.where(rng.random((4, 6)) < 0.5, 0.9 * LIMITS.upper, 0.9 * LIMITS.lower)
    path[1:-1] += rng.uniform(0.0, 0.1, (2, 6)) * path[1:-1]
    model, region, way = _Model(optimiser, path), 0.5, rng.choice([-1.0, 1.0], (2, 6))
    limit = np.where(way > 0.0, LIMITS.upper, LIMITS.lower)
    most = np.minimum(np.abs(limit - path[1:-1]) / LIMITS.velocity, region)
    model.rows, model.room = -way.reshape(1, -1), np.array([-0.95 * most.sum()])
    trial = model.step(region)
    assert trial is not None
    assert ((trial >= LIMITS.lower) & (trial <= LIMITS.upper)).all()
    done = way * (trial - path)[1:-1] / LIMITS.velocity
    assert done.sum() >= 0.95 * most.sum() - 1e-5
    assert (done <= most + 1e-9).all()
    assert np.array_equal(trial[[0, -1]], path[[0, -1]])


@pytest.mark.slow
def test_a_path_with_many_corners_is_left_as_it_is() -> None:
    """Its quadratic program would take seconds."""
    optimiser, path = rough_paths()[0]
    fine = np.concatenate([np.linspace(a, b, 12, endpoint=False) for a, b in pairwise(path)] + [path[-1:]])
    assert len(fine) > 18
    long = Shortening(optimiser, fine)
    long.run(3)
    assert long.path is fine


@pytest.mark.slow
def test_settled_paths_are_free_between_the_samples_of_the_steps() -> None:
    grazed = 0
    for optimiser, path in rough_paths():
        shortening = Shortening(optimiser, path)
        shortening.run(8)
        grazed += bool(optimiser.blocked(shortening.path, 0.05))
        assert not optimiser.blocked(shortening.settled(), 0.05)
        assert optimiser.time(shortening.settled()) <= optimiser.time(path)
    assert grazed


@pytest.mark.parametrize("name", ARMS)
def test_gradients_of_distance_are_its_slopes(name: str) -> None:
    """Against central differences; left out where both sides differ, because the nearest points are not unique."""
    rng = np.random.default_rng(5)
    step, compared, skipped = 1e-4, 0, 0
    for _ in range(6):
        bodies = []
        for i, kind in enumerate([k for k in OBSTACLES if k != "self"]):
            place = rng.uniform((-0.7, -0.7, 0.0), (0.7, 0.7, 0.9))
            bodies.append(
                Body(f"body {i}", obstacle(kind, rng), transform(rotation(rng.normal(size=3)), place), "wall")
            )
        world = world_of(name, bodies)
        model = arm(name).model
        qs = rng.uniform(model.lowerPositionLimit, model.upperPositionLimit, (12, model.nq))
        near = world.near(qs, 0.1)
        for row, pair, distance, gradient in zip(
            near.row, near.pair, near.distance, near.gradient, strict=True
        ):
            index = np.array([pair])
            assert distance == pytest.approx(world.pair_distances(qs[row], index)[0], abs=1e-9)
            if distance < 1e-3:
                continue
            for k in range(model.nq):
                move = step * np.eye(model.nq)[k]
                ahead = world.pair_distances(qs[row] + move, index)[0]
                behind = world.pair_distances(qs[row] - move, index)[0]
                if abs(ahead + behind - 2.0 * distance) > 2e-6:
                    skipped += 1
                    continue
                compared += 1
                assert gradient[k] == pytest.approx((ahead - behind) / (2.0 * step), abs=0.005), (pair, k)
    assert compared > 1000
    assert skipped < 0.1 * compared


def test_near_finds_every_pair_that_is_near() -> None:
    rng = np.random.default_rng(6)
    world = world_of("holding", [TABLE, *_around(rng, 6)])
    model = world.robot.model
    qs = rng.uniform(model.lowerPositionLimit, model.upperPositionLimit, (40, 6))
    found = world.near(qs, 0.08)
    every = np.arange(len(world.pairs))
    wanted = {(r, int(p)) for r, q in enumerate(qs) for p in every[world.pair_distances(q, every) < 0.08]}
    assert {(int(r), int(p)) for r, p in zip(found.row, found.pair, strict=True)} == wanted
    nothing = world.near(qs, -9.0)
    assert nothing.gradient.shape == (0, 6)


def test_the_direction_out_of_a_body_counts_only_on_the_path_itself() -> None:
    """On trials that end in a body it is not to be trusted, because walls are thin."""
    seen = [np.zeros(0), np.array([-0.01, 0.02, -0.01, 0.02])]

    class Seen:
        def near(self, q: Array, limit: float) -> Near:
            distance = seen.pop(0)
            index = np.arange(len(distance))
            return Near(index, index, distance, np.zeros((len(index), 6)))

    still = Ends(np.zeros(6), np.zeros(6))
    path = np.linspace(0.0, 0.3, 3)[:, None] * np.ones(6)
    model = _Model(TransitOptimiser(Seen(), LIMITS, CLEARANCE, still), path)  # type: ignore[arg-type]
    model.constrain([(0, 0.5), (1, 0.5)], path + 0.1)
    assert model.room == pytest.approx(np.array([-0.01, 0.02, 0.02]) - CLEARANCE - _EXTRA)
