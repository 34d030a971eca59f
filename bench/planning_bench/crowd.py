"""CPU of one query among many small bodies everywhere in the arm's reach."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from arm.errors import A465Error
from arm.numerics.products import mul
from arm.robot.shapes import Body, Box, Cylinder, Shape, Sphere
from arm.se3 import Array, frozen, inverse, rotation, transform
from plan.collision.world import World
from planning_bench.grips import by_distance
from planning_bench.ours import Ours
from planning_bench.query import Query
from planning_bench.scenes import draw, lines_that_are_free
from planning_bench.tables import markdown

BODIES = (30, 100, 300)
SEEDS = 10
SIZES = (0.02, 0.08)  # m, edges and diameters
REACH, HEIGHT = (0.25, 1.0), (0.05, 1.1)  # m, of their middles from axis 1 and above the table
ROOM = 0.01  # m that they leave to the start and to one line at each hole
_BATCH = 100  # bodies drawn at once


def crowd_row(first_seed: int) -> str:
    """The first query of easy scenes, planned with more and more bodies."""
    planner = Ours()
    seeds = range(first_seed, first_seed + SEEDS)
    planner.plan(draw("easy", first_seed).query(0))
    rows = []
    for count in BODIES:
        queries = [crowded(draw("easy", seed).query(0), count, seed) for seed in seeds]
        cpu, refused = zip(*(_planned(planner, query) for query in queries), strict=True)
        each = ", ".join(f"{t:.2f}" for t in cpu)
        summary = f"{np.median(cpu):.2f}, {np.mean(cpu):.2f}, {max(cpu):.2f}"
        rows.append([str(count), summary, each, str(sum(refused))])
    return markdown(["still bodies", "CPU s median, mean, max", "each", "refused"], rows)


def crowded(query: Query, count: int, seed: int) -> Query:
    """A query among random bodies, until `count` bodies stand still.

    They leave `ROOM` to the start and to one line at each hole, with the cube in the jaws and without. Whether a way
    leads from one to the other is not known.
    """
    rng = np.random.default_rng([seed, 16])
    wanted = count - len(query.scene.bodies)
    found: list[Body] = []
    for first in range(0, 100 * count, _BATCH):
        if len(found) >= wanted:
            break
        drawn = [_body(rng, first + i) for i in range(_BATCH)]
        close = _close(query, drawn)
        found += [body for body in drawn if body.name not in close]
    return replace(query, scene=replace(query.scene, bodies=(*query.scene.bodies, *found[:wanted])))


def _body(rng: np.random.Generator, number: int) -> Body:
    angle, radius = rng.uniform(-np.pi, np.pi), rng.uniform(*REACH)
    at = np.array([radius * np.cos(angle), radius * np.sin(angle), rng.uniform(*HEIGHT)])
    x, y, z = (float(size) for size in np.round(rng.uniform(*SIZES, 3), 3))
    shape: Shape = (Box((x, y, z)), Cylinder(x / 2.0, z), Sphere(x / 2.0))[number % 3]
    return Body(f"near {number}", shape, transform(rotation(rng.normal(size=3)), at), "near")


def _close(query: Query, bodies: list[Body]) -> set[str]:
    """Names of the bodies that are nearer than `ROOM` to the arm at the start or on its lines."""
    scene, transfer, q = query.scene, query.transfers[0], _kept_free(query)
    cube = scene.cube(transfer.cube)
    T_tool_held = frozen(mul(inverse(transfer.pick.T_base_tool[0]), cube.T_base_body))
    close: set[str] = set()
    for world in (World(scene.robot_open, bodies), World(scene.robot_holding, bodies, cube, T_tool_held)):
        for pair in set(world.near(q, ROOM).pair.tolist()):
            close.update(world.pair_names(pair))
    return close


def _kept_free(query: Query) -> Array:
    free = lines_that_are_free(query)
    pick = by_distance(free.picks, query.q_start)[0]
    place = by_distance(free.places, pick.q_offset)[0]
    return np.concatenate([query.q_start[None], pick.q, place.q])


def _planned(planner: Ours, query: Query) -> tuple[float, bool]:
    began, refused = time.process_time(), False
    try:
        planner.plan(query)
    except A465Error:
        refused = True
    return time.process_time() - began, refused
