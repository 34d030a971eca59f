"""Sampled clearance along a plan's moves, for display: the closest pair and its nearest points.

The certified clearance of a move is in the plan; samples only show where along the move it is small.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm.controller.unit import Unit
from arm.plan_file import Move, Plan
from arm.robot.model import Robot
from arm.robot.shapes import Body, body_from_json
from arm.se3 import Array
from cell.preview.overlays import ClearanceSample
from cell.preview.timeline import CubePose, cube_tracks, timed_steps
from plan.collision.world import World

CLEARANCE_EVERY_S = 0.2


def sample_clearance(
    plan: Plan,
    robot_open: Robot,
    robot_holding: Robot,
    unit: Unit,
    every_s: float = CLEARANCE_EVERY_S,
) -> dict[int, tuple[ClearanceSample, ...]]:
    """Sample every move; return samples by index of the plan's step, none in a scene without bodies.

    Cubes are where the plan has placed them by then. The allowed collisions of a held cube are those of the move.

    Raises:
        InputError: a move holds a cube that is not in the scene.
    """
    steps = timed_steps(plan)
    bodies = [body_from_json(b) for b in plan.scene.get("bodies", [])]
    cubes = [body_from_json(c) for c in plan.scene.get("cubes", [])]
    tracks = cube_tracks(steps, cubes, robot_open, unit)
    if not bodies and not cubes:
        return {}
    sampled = {}
    for index, timed in enumerate(steps):
        move = timed.step
        if not isinstance(move, Move):
            continue
        now = _cubes_at(timed.start_s, cubes, tracks)
        held = now.held
        world = World(
            robot_holding if held else robot_open,
            [*bodies, *now.standing],
            held,
            now.T_tool_held,
            [frozenset((held.name, name)) for name in move.allowed_collisions] if held else [],
        )
        sampled[index] = _along(move, world, unit, every_s)
    return sampled


@dataclass(frozen=True)
class _Cubes:
    """Cubes at one time: those at rest, and the one in the jaws with its pose in the tool frame."""

    standing: tuple[Body, ...]
    held: Body | None
    T_tool_held: Array | None


def _cubes_at(time_s: float, cubes: Sequence[Body], tracks: dict[str, tuple[CubePose, ...]]) -> _Cubes:
    now = {cube.name: [p for p in tracks[cube.name] if p.start_s <= time_s][-1] for cube in cubes}
    held = next((cube for cube in cubes if now[cube.name].held), None)
    return _Cubes(
        tuple(cube.at(now[cube.name].T) for cube in cubes if not now[cube.name].held),
        held,
        now[held.name].T if held else None,
    )


def _along(move: Move, world: World, unit: Unit, every_s: float) -> tuple[ClearanceSample, ...]:
    duration = move.path.duration_s
    times = np.linspace(0.0, duration, max(2, int(np.ceil(duration / every_s)) + 1))
    samples = []
    for time_s, q in zip(times, unit.positions(move.path.at(times)), strict=True):
        distance = world.distance(q)
        if np.isfinite(distance.value):
            samples.append(ClearanceSample(float(time_s), distance.value, distance.pair, distance.points))
    return tuple(samples)
