"""Does a plan match the cell of now, and does it hold? Asked before anything is executed."""

from __future__ import annotations

from typing import Any

import numpy as np

from arm.errors import ImpossibleError
from arm.planfile import Plan
from arm.se3 import angle_between, inverse
from cell.cellfile import Cell
from cell.furniture import plate_body, plate_name
from cell.lookfile import Seen
from cell.planning import limits_digest
from cell.taskfile import Task
from plan.replay import ReplayedMove, replay
from plan.scene import scene_from_json


def require_match(task: Task, plan: Plan) -> None:
    """The plan's unit, arm, limits and calibration must be those of the cell of now.

    Raises:
        ImpossibleError: naming each that differs; nothing moved.
    """
    cell = task.cell
    now = {
        "unit": cell.unit.name,
        "robot_open": cell.robot().digest,
        "robot_holding": cell.robot(cell.cube_size).digest,
        "limits": limits_digest(cell),
        "calibration": cell.camera.digest,
    }
    then = {**plan.provenance, "unit": plan.unit}
    differing = [key for key in now if then.get(key) != now[key]]
    if differing:
        shown = "; ".join(f"{key} {str(then.get(key))[:12]}, now {now[key][:12]}" for key in differing)
        raise ImpossibleError(
            f"the plan is not for the cell of now: {shown}; plan again",
            differing=differing,
            plan={key: then.get(key) for key in differing},
            now={key: now[key] for key in differing},
        )


def require_scene(cell: Cell, plan: Plan, seen: Seen) -> None:
    """The boards must stand where the plan has them, within the cell's tolerance.

    Raises:
        ImpossibleError: naming each that does not, and by how much; nothing moved.
    """
    bodies = {b["name"]: np.array(b["T_base_body"]) for b in plan.scene["bodies"]}
    faults = []
    for pose in seen.poses:
        plate = plate_body(pose.board.name, pose.T_base_board)
        planned = bodies.pop(plate.name, None)
        if planned is None:
            faults.append(f"{plate.name} is not in the plan")
            continue
        moved = inverse(planned) @ plate.T_base_body
        shift, turn = float(np.linalg.norm(moved[:3, 3])), angle_between(np.eye(3), moved[:3, :3])
        if shift > cell.moved or turn > cell.turned:
            faults.append(
                f"{plate.name} stands {1e3 * shift:.1f} mm and {np.degrees(turn):.2f} deg from the plan's"
            )
    faults += [f"{name} of the plan was not seen" for name in bodies if name.startswith(plate_name(""))]
    if faults:
        raise ImpossibleError(
            f"the scene is not the plan's: {'; '.join(faults)}; look and plan again", faults=faults
        )


def replayed(task: Task, plan: Plan) -> tuple[ReplayedMove, ...]:
    """Every move of the plan, judged anew.

    Raises:
        ImpossibleError: the plan does not match the cell of now, or does not hold.
    """
    require_match(task, plan)
    cell = task.cell
    scene = scene_from_json(plan.scene, cell.robot(), cell.robot(cell.cube_size))
    limits = cell.unit.limits(plan.speed_registers, plan.acceleration_registers)
    return replay(plan, scene, cell.unit, limits)


def check_plan(task: Task, plan: Plan) -> dict[str, Any]:
    """What ``a465 check`` prints.

    Raises:
        ImpossibleError: see `replayed`.
    """
    moves = replayed(task, plan)
    return {
        "plan_sha256": plan.sha256,
        "holds": True,
        "min_clearance_mm": 1e3 * min(m.check.clearance for m in moves),
        "peak_velocity": max(m.peak_velocity for m in moves),
        "peak_acceleration": max(m.peak_acceleration for m in moves),
        "moves": [
            {
                "name": m.move.name,
                "stated_mm": 1e3 * m.move.clearance,
                "proved_mm": 1e3 * m.check.clearance,
                "closest": list(m.check.pair),
            }
            for m in moves
        ],
    }
