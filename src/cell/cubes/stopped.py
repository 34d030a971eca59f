"""Displaced cubes of a stopped plan: where it has them, and how it would have released the one that it moves."""

from __future__ import annotations

import numpy as np

from arm.controller.unit import Unit
from arm.numerics.products import mul, norm
from arm.plan_file import GripperStep, Move, Plan
from arm.se3 import Array, frozen, inverse
from cell.accuracy.placement import gripper_positions
from cell.config.cell import Cell
from cell.cubes.confirm_placed import T_base_of
from cell.files.task import Task
from cell.scene.bodies import T_hole_cube
from cell.scene.build import cube_name
from cell.scene.displaced import BESIDE, DisplacedCube
from plan.scene import scene_from_json
from vision.observation import Observation

SEATED = 1e-4  # m from where a seated cube of a plan is
NEAR_PATH = np.radians(2.0)  # an arm this close to a move of the plan stopped there


def displaced_in(cell: Cell, plan: Plan, planned: Observation) -> tuple[DisplacedCube, ...]:
    """The cubes of a plan's scene that are neither in their seats nor in the jaws, where it has them.

    Args:
        cell: of the plan.
        plan: of a task.
        planned: its boards.
    """
    beside = {t["cube"]: t["from"].removeprefix(BESIDE) for t in plan.task["cubes"] if BESIDE in t["from"]}
    holes = {hole.name: hole.T_base_hole for board in planned.boards for hole in board.pose.holes}
    found, in_jaws = [], next(plan.moves).held
    for cube in scene_from_json(plan.scene, cell.robot(), cell.robot_holding()).cubes:
        home, at = cube.name.removeprefix(cube_name("")), cube.T_base_body[:3, 3]
        seat = mul(holes[home], T_hole_cube(cell.cube_size))[:3, 3] if home in holes else at
        if cube.name == in_jaws or norm(seat - at) < SEATED:
            continue
        nearest = min(holes, key=lambda name: float(norm(holes[name][:3, 3] - at)))
        found.append(DisplacedCube(cube.name, beside.get(cube.name, nearest), cube.T_base_body))
    return tuple(found)


def released_before(plan: Plan, q: Array, unit: Unit) -> frozenset[str]:
    """The cubes that a plan releases before the move with empty jaws that passes closest to q (6,) rad.

    Without such a move nearby, no cube.
    """
    best, gone, at = NEAR_PATH, frozenset[str](), frozenset[str]()
    for step in plan.steps:
        if isinstance(step, GripperStep) and step.action == "open" and step.cube is not None:
            gone |= {plan.task["cubes"][step.cube]["cube"]}
        elif isinstance(step, Move) and step.held is None:
            off = float(np.abs(unit.positions(step.path.sample(0.02)) - q).max(axis=1).min())
            if off < best:
                best, at = off, gone
    return at


def released_at(task: Task, plan: Plan, number: int, planned: Observation, now: Observation) -> Array:
    """Tool pose, 4x4, at which a plan releases a cube, moved with the place of the release.

    A cube from beside a hole may lean in the jaws; then the tool leans as much at its release. And the release may be
    off the hole's axis, by what looks measured before.

    Args:
        task, plan: the task and its plan.
        number: of the cube in the plan.
        planned, now: the boards of the plan, and where they are now.
    """
    q, place = gripper_positions(task.cell, plan)[number, "open"], plan.task["cubes"][number]["to"]
    T = task.cell.robot(task.cell.cube_size).T_base_tool(q)
    T_then, T_now = (T_base_of(task, look, place) for look in (planned, now))
    return T if T_then is None or T_now is None else frozen(mul(mul(T_now, inverse(T_then)), T))
