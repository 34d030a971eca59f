"""The broadphase leaves open what may be near, and what it settles it bounds as well as if it compared all."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm.robot.shapes import Body, Box, Capsule, Sphere
from arm.se3 import Array, transform
from arms.around import bodies_around, one_ball, some_q
from arms.grazing import ARMS, arm
from plan.collision import separation
from plan.collision.covers import ROUNDING
from plan.collision.separation import OpenPairs
from plan.collision.world import World


def crowded(name: str, rng: np.random.Generator) -> World:
    """An arm among 90 bodies, with paddings, some pairs allowed to touch."""
    bodies = [replace(body, padding=float(rng.uniform(0.0, 0.01))) for body in bodies_around(rng, 90)]
    robot = arm(name)
    allowed = [frozenset((robot.bodies[-1].name, bodies[i].name)) for i in range(0, 90, 7)]
    return World(robot, bodies, allowed=allowed, padding=0.001)


def naive(world: World, q: Array, enough: float, delta: Array) -> OpenPairs:
    """From the bounds of all pairs."""
    volumes, (m, p) = world.volumes, (len(q), len(world.pairs))
    at, (row, pair) = volumes.placed(q), np.divmod(np.arange(m * p), p)
    motion = volumes.motion_of(at, delta, row, pair).reshape(m, p)
    bound = volumes.distances(at) - (motion + world.paddings)
    open_ = bound < enough
    return OpenPairs(*np.nonzero(open_), bound[open_], np.where(open_, np.inf, bound).min(axis=1))


@pytest.mark.parametrize("few", [0, 1000])
@pytest.mark.parametrize("name", ARMS)
def test_open_pairs_are_those_of_all_bounds(name: str, few: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether bodies are chosen by coarse balls first or not; also where nothing or everything is near."""
    monkeypatch.setattr(separation, "_FEW_BODIES", few)
    rng = np.random.default_rng(1)
    world = crowded(name, rng)
    found_open = settled = 0
    for enough in (-0.02, 0.0, 0.005, 0.3, 3.0, -np.inf):
        q = some_q(world, rng, 12)
        delta = rng.uniform(0.0, rng.choice([0.0, 0.01, 0.2]), q.shape)
        found = world.volumes.open_pairs(world.volumes.placed(q), enough, delta)
        wanted = naive(world, q, enough, delta)
        assert np.array_equal(found.row, wanted.row)
        assert np.array_equal(found.pair, wanted.pair)
        assert np.allclose(found.bound, wanted.bound, rtol=0.0, atol=1e-12)
        assert np.allclose(found.least, wanted.least, rtol=0.0, atol=1e-12)
        found_open += len(found.row)
        settled += int(np.isfinite(found.least).sum())
    assert found_open > 500
    assert settled > 20


def test_without_motion_only_distances_and_paddings_count() -> None:
    rng = np.random.default_rng(2)
    world = crowded("open", rng)
    q = some_q(world, rng, 10)
    found = world.volumes.open_pairs(world.volumes.placed(q), 0.02)
    wanted = naive(world, q, 0.02, np.zeros_like(q))
    assert np.array_equal(found.pair, wanted.pair)
    assert np.abs(found.least - wanted.least).max() < 1e-12


@pytest.mark.parametrize("few", [0, 1000])
def test_balls_that_overlap_are_open_whatever_is_enough(
    tmp_path: Path, few: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Though the padding of another body brings its bound below what coarse balls show of the first."""
    monkeypatch.setattr(separation, "_FEW_BODIES", few)
    inside = Body("inside", Sphere(0.02), transform(t=(0.33, 0.0, 0.0)), "wall")
    padded = Body("padded", Sphere(0.02), transform(t=(0.225, 0.0, 0.0)), "wall", padding=0.05)
    world = World(one_ball(tmp_path, base=False), [inside, padded])
    found = world.volumes.open_pairs(world.volumes.placed(np.zeros((1, 1))), -0.02)
    assert [world.pair_names(i) for i in found.pair.tolist()] == [("l1", "inside")]
    assert found.bound.tolist() == [-np.inf]
    assert found.least[0] == pytest.approx(-0.015, abs=1e-6)


def test_bounds_are_below_the_distance_by_their_rounding(tmp_path: Path) -> None:
    """A ball beside balls and boxes, whose distances are exact."""
    kinds = [Sphere(0.02), Box((0.04, 0.04, 0.04)), Capsule(0.02, 0.1), Sphere(0.02)]
    bodies = [
        Body(f"body {i}", shape, transform(t=(0.3 + (-1) ** i * 0.1 * (i + 1), 0.0, 0.0)), "wall")
        for i, shape in enumerate(kinds)
    ]
    world = World(one_ball(tmp_path, base=False), bodies)
    bound = world.volumes.distances(world.volumes.placed(np.zeros((1, 1))))[0]
    for index, body in enumerate(bodies):
        pair = next(i for i in range(len(world.pairs)) if body.name in world.pair_names(i))
        exact = 0.1 * (index + 1) - 0.04
        assert exact - 2.1 * ROUNDING < bound[pair] < exact - 0.9 * ROUNDING
        assert world.pair_distances(np.zeros(1), np.array([pair]))[0] == pytest.approx(exact, abs=1e-6)
