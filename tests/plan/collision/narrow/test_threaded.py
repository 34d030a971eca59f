"""A ring on the arm with a bar through it: distances, collision checks and proofs of the whole world."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.robot.shapes import Body, Sphere, Torus
from arm.se3 import Array, rotation, transform
from arms.grazing import place
from arms.hoop import RING, SIDE, THREADED, along_bar, bar, hoop_arm, joints, motion, sampled, threaded
from plan.budget import DISTANCE_CHECKS, TORUS_CHECKS, SearchBudget, allowed
from plan.collision.bezier import curve_of_waypoints
from plan.collision.certificate import TIGHT_ABSOLUTE, TIGHT_RELATIVE, certify_curve
from plan.collision.world import DISTANCE_ERROR, World

ASIDE = 0.0324 - 0.0048 - SIDE / np.sqrt(2.0)  # clearance of the ring on the bar's axis, m


def near_ring(world: World) -> Array:
    return np.array([i for i in range(len(world.pairs)) if "ring" in world.pair_names(i)], dtype=np.intp)


def test_the_ring_is_as_far_from_the_bar_as_their_sizes_say() -> None:
    for x in (0.0, 0.004, -0.01):
        world = threaded(bar((x, 0.0)))
        found = world.distance(joints(THREADED))
        assert found.pair[0] == "ring"
        assert found.pair[1].startswith("bar")
        corner = np.hypot(SIDE / 2.0 + abs(x), SIDE / 2.0)
        assert found.value == pytest.approx(RING.radius - RING.tube - corner, abs=1e-6)
        assert np.linalg.norm(found.points[0] - found.points[1]) == pytest.approx(found.value, abs=1e-6)
        below = world.distances_below(joints(THREADED), found.value + 1e-4)
        assert below[0].value == pytest.approx(found.value, abs=1e-9)


def test_collision_checks_answer_what_distances_say() -> None:
    """Also where only the ring is near, only others are, and with paddings."""
    rng = np.random.default_rng(2)
    bodies = [replace(body, padding=0.001 * i) for i, body in enumerate(bar((0.003, 0.002)))]
    world, seen = threaded(bodies), []
    ring = near_ring(world)
    for _ in range(90):
        q = place(motion(rng), np.array([rng.uniform(0.0, 2.0)]))[0]
        distances = world.pair_distances(q, np.arange(len(world.pairs)))
        least = float(distances.min())
        assert world.distance(q).value == pytest.approx(least, abs=1e-6)
        just = [least - 1e-5, least + 1e-5] if least > -0.5 * RING.tube else []  # deep inside, depths differ
        for clearance in (0.0, 0.008, -0.001, *just):
            if abs(least - clearance) > 1e-6:
                assert world.in_collision(q, clearance) == (least < clearance)
        seen.append((least < 0.0, bool(np.argmin(distances) in ring)))
    assert {(True, True), (False, True)} <= set(seen)


@pytest.mark.slow
def test_gradients_are_those_of_the_distance() -> None:
    """Of pairs with the ring as the outer and as the inner body, moving or standing."""
    rng = np.random.default_rng(3)
    others = [
        Body(
            "loop", Torus(0.05, 0.004), THREADED @ transform(rotation((1.2, 0.0, 0.0)), (0.05, 0, 0)), "wall"
        )
    ]
    world = threaded([*bar((0.003, 0.002), pieces=2), *others])
    pairs, errors, step = near_ring(world), [], 1e-5
    for _ in range(16):
        q = place(motion(rng), np.array([0.5]))[0]
        near = world.near(q[None], 0.3)
        for pair, distance, gradient in zip(near.pair, near.distance, near.gradient, strict=True):
            if {"ring", "loop"} & set(world.pair_names(int(pair))) and distance > 1e-3:
                one = np.array([pair])
                change = [
                    world.pair_distances(q + d, one)[0] - world.pair_distances(q - d, one)[0]
                    for d in step * np.eye(6)
                ]
                errors.append(np.abs(np.array(change) / (2.0 * step) - gradient).max())
    assert len(errors) > 80
    assert len(pairs) > 8
    assert (
        np.quantile(errors, 0.95) < 0.02
    )  # m/rad; where two points of the circle are equally near there is a kink
    assert np.median(errors) < 2e-3


def test_a_ring_that_goes_along_its_bar_is_proved_clear() -> None:
    curve, world = along_bar(0.2), threaded(bar())
    for asked in (0.003, 0.015, ASIDE - 1e-4):
        decided = certify_curve(world, curve, asked)
        assert decided.proved
        assert decided.clearance >= asked
    tight = certify_curve(world, curve, 0.003, tight=True)
    least = sampled(world, curve)
    assert (
        least - max(TIGHT_ABSOLUTE, TIGHT_RELATIVE * tight.seen) - DISTANCE_ERROR <= tight.clearance <= least
    )
    assert tight.seen == pytest.approx(ASIDE, abs=1e-4)
    assert not certify_curve(world, curve, ASIDE + 1e-4).proved


@pytest.mark.slow
def test_no_sample_of_random_motions_is_nearer_than_proved() -> None:
    rng, proved, touching = np.random.default_rng(4), 0, 0
    world = threaded(bar((0.002, -0.003)))
    for _ in range(20):
        curve = motion(rng)
        least = sampled(world, curve)
        tight = certify_curve(world, curve, 0.002, tight=True)
        assert tight.clearance <= least + 1e-6
        assert tight.proved or least < 0.002 + 1e-4
        for asked in np.maximum([0.0, 0.002, least - 1e-4, least + 1e-4], 0.0).tolist():
            decided = certify_curve(world, curve, asked)
            assert decided.clearance <= max(least, asked) + 1e-6
            assert decided.proved or least < asked + 1e-4 + 1e-6
            assert not (decided.proved and least < asked - 1e-6)
        proved += tight.proved
        touching += least < 0.0
    assert proved > 5
    assert touching > 2


def test_a_ring_that_leaves_its_bar_through_it_is_refuted() -> None:
    """Whatever the bound of the convex hull says: at both ends the ring is clear of the bar."""
    world = threaded(bar(length=0.6))
    aside = THREADED @ transform(t=(-0.1, 0.0, 0.0))
    for count in (1, 2, 7):
        q = [joints(THREADED)]
        for part in np.linspace(0.0, 1.0, count + 1)[1:]:
            q.append(joints(THREADED + part * (aside - THREADED), q[-1]))
        curve = curve_of_waypoints(np.array(q))
        assert world.distance(q[0]).value > 0.02
        assert world.distance(q[-1]).value > 0.02
        for tight in (False, True):
            found = certify_curve(world, curve, 0.0, tight)
            assert not found.proved
            assert found.seen < 0.0
            assert found.pair[0] == "ring"


def test_over_the_end_of_its_bar_a_ring_may_leave() -> None:
    bodies = bar()
    q = [joints(THREADED)]
    for x, z in ((0.0, 0.06), (0.0, 0.115), (-0.05, 0.115), (-0.1, 0.115), (-0.1, 0.0)):
        ends = q[-1]
        q += [
            joints(pose, q[-1])
            for pose in _between(hoop_arm().T_base_tool(ends), THREADED @ transform(t=(x, 0.0, z)), 6)
        ]
    found = certify_curve(threaded(bodies), curve_of_waypoints(np.array(q)), 0.005)
    assert found.proved


def _between(start: Array, end: Array, count: int) -> list[Array]:
    return [start + part * (end - start) for part in np.linspace(0.0, 1.0, count + 1)[1:]]


def test_what_may_touch_is_not_checked() -> None:
    touching, q = bar((0.025, 0.0)), joints(THREADED)
    names = [body.name for body in touching]
    world = threaded(touching)
    assert world.in_collision(q)
    assert not certify_curve(world, curve_of_waypoints(np.stack([q, q + 0.001])), 0.0).proved
    free = threaded(touching, tuple(frozenset(("ring", name)) for name in names))
    assert not free.in_collision(q)
    assert certify_curve(free, curve_of_waypoints(np.stack([q, q + 0.001])), 0.0).proved
    assert not {frozenset(free.pair_names(i)) for i in near_ring(free)} & {
        frozenset(("ring", n)) for n in names
    }


def test_worlds_whose_only_bodies_are_tori() -> None:
    """No pair is left for coal."""
    ring = next(body for body in hoop_arm().bodies if body.name == "ring")
    robot, q = replace(hoop_arm(), bodies=(ring,)), joints(THREADED)
    loop = Body("loop", Torus(0.05, 0.004), THREADED @ transform(t=(0.0, 0.0, 0.03)), "wall")
    world = World(robot, [loop])
    wanted = np.hypot(0.05 - RING.radius, 0.03) - RING.tube - 0.004
    assert world.distance(q).value == pytest.approx(wanted, abs=1e-9)
    assert not world.in_collision(q, wanted - 1e-5)
    assert world.in_collision(q, wanted + 1e-5)
    ball = Body("ball", Sphere(0.01), THREADED, "wall")
    assert World(robot, [ball]).distance(q).value == pytest.approx(RING.radius - RING.tube - 0.01, abs=1e-9)
    assert World(robot, []).distance(q).value == np.inf


def test_distances_of_tori_cost_more_effort() -> None:
    world, q = threaded(bar()), joints(THREADED)
    pair = near_ring(world)[:2]
    with allowed(SearchBudget(1e3)) as meter:
        world.pair_distances(q, pair)
    assert meter.checks == pytest.approx(2 * (DISTANCE_CHECKS + TORUS_CHECKS))
