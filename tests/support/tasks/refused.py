"""Seeded scenes that cannot be planned, each for one known reason."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from arm.controller.unit import Limits, load_unit
from arm.robot.shapes import Body, Box
from arm.se3 import Array, frozen, rotation, transform
from plan.advice.changes import Request
from plan.budget import TransitBudget
from plan.options import PlanOptions
from tasks.task2 import BOARD_A, BOARD_B, POST, Q_START, TABLE, PlacedBoard, Task2, placed_board, task2

UNIT = load_unit("crs93")


def request(task: Task2, limits: Limits | None = None, options: PlanOptions | None = None) -> Request:
    """The task as a request."""
    limits = limits or UNIT.limits()
    return Request(task.scene, task.transfers, Q_START, UNIT, limits, options or PlanOptions(look="never"))


def slab_above(rng: np.random.Generator, hole: int = 0) -> Body:
    """A slab that hangs 70 to 110 mm above a hole of board B: no line fits under it."""
    T = placed_board(*BOARD_B).T_base_hole(hole) @ transform(t=(0.0, 0.0, float(rng.uniform(0.08, 0.12))))
    return Body("slab", Box((0.05, 0.05, 0.02)), frozen(T), "wall")


def with_target(board: PlacedBoard, cubes: int = 1, stand: bool = True, extra: Sequence[Body] = ()) -> Task2:
    """The task with board B elsewhere."""
    plain, a = task2(cubes=cubes), placed_board(*BOARD_A)
    bodies = board.bodies() if stand else board.bodies()[:1]
    transfers = tuple(replace(t, place=board.station(i, gap=1e-3)) for i, t in enumerate(plain.transfers))
    return Task2(replace(plain.scene, bodies=(TABLE, POST, *a.bodies(), *bodies, *extra)), transfers)


def far(rng: np.random.Generator, by: tuple[float, float], cubes: int = 1) -> Task2:
    """Board B stands that much (m, from .. to) further out."""
    name, centre, *angles = BOARD_B
    away = float(rng.uniform(*by))
    return with_target(placed_board(name, (centre[0] + away, centre[1], centre[2]), *angles), cubes)


def on_its_edge(rng: np.random.Generator) -> Task2:
    """Board B on its edge, its normal level towards the arm, the hole 25 to 40 mm above the table."""
    board = placed_board(*BOARD_B).board
    T = np.array(transform(rotation(np.array([0.0, -np.pi / 2, 0.0]))))
    at = np.array([rng.uniform(0.55, 0.65), -rng.uniform(0.2, 0.25), rng.uniform(0.025, 0.04)])
    T[:3, 3] = at - (T @ board.T_board_hole(0))[:3, 3]
    return with_target(PlacedBoard(board, frozen(T)), stand=False)


def under_a_lid() -> Request:
    """A lid low above both boards and a wall between them; joints J2 and J3 cannot fold the arm."""
    wall = Body("wall e", Box((1.0, 0.01, 1.5)), transform(t=(0.77, -0.06, 0.75)), "wall")
    lid = Body("lid", Box((1.4, 1.4, 0.02)), transform(t=(0.4, 0.0, 0.8)), "wall")
    limits = narrow(UNIT.limits(), [-100, -67, -110, -180, -105, -180], [100, 90, 110, 180, 105, 180])
    few = PlanOptions(look="never", transit=TransitBudget(corners=40, corner_edges=10, rrt=100))
    return request(task2([wall, lid], cubes=1), limits, few)


def at_the_start(rng: np.random.Generator, robot_tool: Array) -> Body:
    """A crate 1 to 4 mm beside the open jaws where the arm starts, below them."""
    T = transform(t=robot_tool[:3, 3] + [0.0, 0.0, -0.025 - float(rng.uniform(0.001, 0.004))])
    return Body("crate", Box((0.05, 0.05, 0.05)), T, "wall")


def narrow(limits: Limits, lower_deg: Sequence[float], upper_deg: Sequence[float]) -> Limits:
    """Limits cut to a range of each joint."""
    lower, upper = np.radians(lower_deg), np.radians(upper_deg)
    return replace(
        limits, lower=frozen(np.maximum(limits.lower, lower)), upper=frozen(np.minimum(limits.upper, upper))
    )
