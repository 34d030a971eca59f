"""The certificate against plain sampling: CPU on the same straight and bent transits of hard scenes."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable
from functools import partial

import numpy as np

from arm.se3 import Array, frozen, inverse
from plan.collision.bezier import curve_of_waypoints
from plan.collision.certificate import certify_curve
from plan.collision.world import World
from planning_bench.choices import pairs
from planning_bench.query import CLEARANCE, Query
from planning_bench.scenes import draw, lines_that_are_free
from planning_bench.tables import pct

STEP = 0.01  # rad, largest joint step of the sampling
LIFTS = 40  # random way-points tried for a free way around
REPEATS = 3


def certificate_row(scenes: int, first_seed: int) -> str:
    """Decide mode at the asked clearance against sampling at every step, on ways that are free.

    Sampling says yes or no (`World.in_collision`), or how near it came (`World.distance`).
    """
    proof, sampling, evaluations, looks, unproved, ways = [], [], [], [], 0, 0
    measuring = []
    for seed in range(first_seed, first_seed + scenes):
        for kind in ("easy", "hard"):
            scene = draw(kind, seed)
            for index in range(4):
                query = scene.query(index)
                rng = np.random.default_rng([seed, index, 13])
                world, way = _free_way(query, rng)
                if way is None:
                    continue
                ways += 1
                steps = np.concatenate([_steps(a, b) for a, b in itertools.pairwise(way)])
                curve = curve_of_waypoints(way)
                world.in_collision(way[0])  # the broadphase is built once for both
                check = certify_curve(world, curve, CLEARANCE)
                unproved += not check.proved
                proof.append(_cpu(partial(certify_curve, world, curve, CLEARANCE)))
                sampling.append(_cpu(partial(_looks, world.in_collision, steps)))
                measuring.append(_cpu(partial(_looks, world.distance, steps)))
                evaluations.append(check.evaluations)
                looks.append(len(steps))
    ratios = [a / b for a, b in zip(proof, sampling, strict=True)]
    return (
        f"{ways} free transits (straight on easy, one way-point on hard scenes), cube in the hand: certificate at "
        f"{CLEARANCE * 1e3:g} mm {pct(proof, 50, 95, scale=1e3, digits=2)} ms CPU with "
        f"{pct(list(map(float, evaluations)), 50, 95, digits=0)} configurations; sampling at {STEP:g} rad "
        f"{pct(sampling, 50, 95, scale=1e3, digits=2)} ms with {pct(list(map(float, looks)), 50, 95, digits=0)}; "
        f"ratio per transit {pct(ratios, 50, 95, digits=2)} (median, p95); the same samples with their distances "
        f"{pct(measuring, 50, 95, scale=1e3, digits=2)} ms; not proved: {unproved}"
    )


def _free_way(query: Query, rng: np.random.Generator) -> tuple[World, Array | None]:
    """The holding world and way-points that keep the clearance at fine samples, or None."""
    scene, transfer = query.scene, query.transfers[0]
    cube = scene.cube(transfer.cube)
    T = frozen(inverse(transfer.pick.T_base_tool[0]) @ cube.T_base_body)
    world = World(scene.robot_holding, (*scene.bodies, *(c for c in scene.cubes if c is not cube)), cube, T)
    free = lines_that_are_free(query)
    if not free.picks or not free.places:
        return world, None
    pick, place = next(pairs(query, 0, query.q_start))
    a, b = pick.q_offset, place.q_offset
    candidates = [np.array([a, b])]
    for _ in range(LIFTS):
        middle = (a + b) / 2 + rng.normal(size=6) * np.array([0.3, 0.4, 0.4, 0.1, 0.3, 0.1])
        candidates.append(np.array([a, np.clip(middle, query.limits.lower, query.limits.upper), b]))
    for way in candidates:
        fine = np.concatenate([_steps(x, y) for x, y in itertools.pairwise(way)])
        if not any(world.in_collision(q, CLEARANCE + 1e-3) for q in fine):
            return world, way
    return world, None


def _steps(a: Array, b: Array) -> Array:
    count = max(1, int(np.ceil(np.abs(b - a).max() / STEP)))
    return a + (b - a) * np.linspace(0.0, 1.0, count + 1)[:, None]


def _looks(at: Callable[[Array], object], steps: Array) -> list[object]:
    return [at(q) for q in steps]


def _cpu(run: Callable[[], object]) -> float:
    times = []
    for _ in range(REPEATS):
        began = time.process_time()
        run()
        times.append(time.process_time() - began)
    return float(np.median(times))
