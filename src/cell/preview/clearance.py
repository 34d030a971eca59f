"""Sampled clearance along a plan's moves, for display: the closest pair and its nearest points.

The plan states the certified clearance of each move. Samples only show where along the move the clearance is small.
"""

from __future__ import annotations

import numpy as np

from arm.controller.unit import Unit
from arm.plan_file import Move, Plan, touching_pairs
from arm.robot.model import Robot
from arm.robot.shapes import body_from_json
from cell.export.timeline import cube_tracks, timed_steps
from cell.preview.overlays import ClearanceSample
from plan.collision.world import World

CLEARANCE_EVERY_S = 0.2
MOST_SAMPLES = 1200  # of a plan, about 0.1 kB each, so that the page of a long one opens as fast


def sample_clearance(
    plan: Plan, robot_open: Robot, robot_holding: Robot, unit: Unit, every_s: float = CLEARANCE_EVERY_S
) -> dict[int, tuple[ClearanceSample, ...]]:
    """Sample every move; return samples by index of the plan's step. A scene without bodies has no samples.

    Samples are `every_s` apart, in plans of more than `MOST_SAMPLES` of these as far apart as that number needs.
    Each cube is where the plan has placed it by then. The move states what may touch.

    Raises:
        InputError: a move holds a cube that is not in the scene.
    """
    steps = timed_steps(plan)
    bodies = [body_from_json(b) for b in plan.scene.get("bodies", [])]
    cubes = [body_from_json(c) for c in plan.scene.get("cubes", [])]
    tracks = cube_tracks(steps, cubes, robot_open, unit, plan.scene.get("supplies", ()))
    if not bodies and not cubes:
        return {}
    moved = sum(timed.step.path.duration_s for timed in steps if isinstance(timed.step, Move))
    every_s = max(every_s, moved / MOST_SAMPLES)
    sampled = {}
    for index, timed in enumerate(steps):
        move = timed.step
        if not isinstance(move, Move):
            continue
        now = {name: p for name, track in tracks.items() for p in track if p.start_s <= timed.start_s}
        there = [cube for cube in cubes if cube.name in now]
        held = next((cube for cube in there if now[cube.name].held), None)
        world = World(
            robot_holding if held else robot_open,
            [*bodies, *(cube.at(now[cube.name].T) for cube in there if not now[cube.name].held)],
            held,
            now[held.name].T if held else None,
            touching_pairs(move),
        )
        sampled[index] = _along(move, world, unit, every_s)
    return sampled


def _along(move: Move, world: World, unit: Unit, every_s: float) -> tuple[ClearanceSample, ...]:
    duration = move.path.duration_s
    times = np.linspace(0.0, duration, max(2, int(np.ceil(duration / every_s)) + 1))
    samples = []
    for time_s, q in zip(times, unit.positions(move.path.at(times)), strict=True):
        distance = world.distance(q)
        if np.isfinite(distance.value):
            samples.append(ClearanceSample(float(time_s), distance.value, distance.pair, distance.points))
    return tuple(samples)
