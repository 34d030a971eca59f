"""Content of the page: a plan, its arm and its cell as JSON types. Lengths m, angles rad, time s on one clock.

The page evaluates the integer segments in encoder counts that are sent to the controller, so it shows the exact motion,
not a resampled one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from arm.board import Board
from arm.controller.unit import Unit
from arm.errors import InputError
from arm.plan_file import GripperStep, LookStep, Move, Pause, Plan
from arm.robot.model import LinkBody, Robot
from arm.robot.shapes import Body, body_from_json
from arm.se3 import Array, inverse, rotation_vector
from cell.export.timeline import TimedStep, cube_tracks, timed_steps
from cell.preview.overlays import (
    ClearanceSample,
    ExecutedMove,
    Refused,
    boards_to_json,
    camera_to_json,
    clearance_to_json,
    executed_to_json,
    pose_numbers,
    shape_numbers,
)
from plan.options import clearance_words
from vision.camera.model import Camera, Image


def page_content(
    plan: Plan,
    robot_open: Robot,
    robot_holding: Robot,
    unit: Unit,
    boards: Sequence[Board] = (),
    dictionary: str = "DICT_4X4_50",
    camera: Camera | None = None,
    photograph: Image | None = None,
    clearance: Mapping[int, Sequence[ClearanceSample]] | None = None,
    executed: Sequence[ExecutedMove] = (),
    erring: Sequence[float] = (),
    refused: Refused | None = None,
    resting: bool = False,
) -> dict[str, Any]:
    """Return everything that the page draws.

    Args:
        plan: to show; bodies and cubes are those of its scene.
        robot_open, robot_holding: the arm with open jaws and with the jaws at the cube's width.
        unit: of the plan.
        boards: of the cell; those whose plates are in the scene are drawn with holes and markers.
        dictionary: of the boards' markers.
        camera: drawn with its field of view, and what it sees.
        photograph: that it took; ignored without a camera.
        clearance: samples of a move by index of its step.
        executed: drawn over the plan.
        erring: clearance of each move for an arm with its errors, m; empty if they are not known.
        refused: of a motion that is no plan to execute; the page then has no code.
        resting: whether the plan only shows where everything stands; the page then has no code either.

    Raises:
        InputError: the plan is for another unit, or the arms do not match each other or its scene.
    """
    if plan.unit != unit.name:
        why = f"unit = {unit.name!r}: the plan is for {plan.unit!r}"
        raise InputError(why, value=unit.name, plan=plan.unit)
    steps = timed_steps(plan)
    of_erring = iter(erring)
    bodies = [body_from_json(b) for b in plan.scene.get("bodies", [])]
    cubes = [body_from_json(c) for c in plan.scene.get("cubes", [])]
    tracks = cube_tracks(steps, cubes, robot_open, unit, plan.scene.get("supplies", ()))
    joined = {
        motion.first + k
        for motion in plan.motions
        for k in range(1, len(motion.moves))
        if _planned(motion.moves[k])
    }
    of_refusal = {} if refused is None else {"refused": asdict(refused) | {"pair": list(refused.pair)}}
    return {
        **of_refusal,
        **({"resting": True} if resting else {}),
        "task": plan.task,
        "unit": plan.unit,
        "speed": plan.speed,
        "sha256": plan.sha256,
        # the page of a log shows the past and cannot approve a plan; one of no unit is never sent
        "code": None if executed or plan.arm or refused is not None or resting else plan.code,
        "provenance": plan.provenance,
        "notes": plan.notes,
        "less_clearance": clearance_words(plan.provenance.get("options", {})),
        "motion_s": plan.duration_s,
        "motions": len(list(plan.moves)) - len(joined),
        "duration_s": steps[-1].end_s,
        "joints": _joints(plan, robot_open, unit),
        "arm": _arm(robot_open, robot_holding),
        "bodies": [{**_body(b), "kind": b.kind, "T": pose_numbers(b.T_base_body)} for b in bodies],
        "cubes": [
            {
                **_body(c),
                "track": [
                    {"start": round(p.start_s, 6), "held": p.held, "T": pose_numbers(p.T)}
                    for p in tracks[c.name]
                ],
            }
            for c in cubes
        ],
        "boards": boards_to_json(boards, bodies, dictionary),
        "camera": None if camera is None else camera_to_json(camera, photograph),
        "steps": [
            _step(timed, i in joined, next(of_erring, None) if isinstance(timed.step, Move) else None)
            for i, timed in enumerate(steps)
        ],
        "clearance": {str(i): clearance_to_json(s) for i, s in (clearance or {}).items()},
        "executed": [executed_to_json(move) for move in executed],
    }


def _planned(move: Move) -> bool:
    """Whether the move comes from the planner; one read from a log has no closest pair and ends at rest."""
    return any(move.closest)


def _joints(plan: Plan, robot: Robot, unit: Unit) -> dict[str, Any]:
    return {
        "names": list(robot.joint_names),
        "counts_per_rad": unit.counts_per_rad.tolist(),
        "counts_at_zero": unit.counts_at_zero.tolist(),
        "lower": unit.lower.tolist(),
        "upper": unit.upper.tolist(),
        "velocity": unit.velocity(plan.speed_registers).tolist(),
        "acceleration": unit.acceleration(plan.acceleration_registers).tolist(),
    }


def _arm(robot_open: Robot, robot_holding: Robot) -> dict[str, Any]:
    """Kinematic chain as constant placements and axes, and the bodies with both positions of the jaws."""
    count = len(robot_open.joint_names)
    zero = robot_open.joint_poses(np.zeros(count))
    holding = {body.name: body for body in robot_holding.bodies}
    if set(holding) != {body.name for body in robot_open.bodies}:
        raise InputError("robot_holding: must have the same bodies as robot_open; only the jaws may differ")
    return {
        "chain": [
            {"T": pose_numbers(inverse(zero[i]) @ zero[i + 1]), **_axis(robot_open, zero, i)}
            for i in range(count)
        ],
        "T_end_tool": pose_numbers(inverse(zero[-1]) @ robot_open.T_base_tool(np.zeros(count))),
        "bodies": [
            {
                **_body(body),
                "joint": body.joint,
                "open": pose_numbers(body.T_joint_body),
                "holding": pose_numbers(holding[body.name].T_joint_body),
            }
            for body in robot_open.bodies
        ],
    }


def _body(body: Body | LinkBody) -> dict[str, Any]:
    return {"name": body.name, "shape": shape_numbers(body.shape), "padding": body.padding}


def _axis(robot: Robot, zero: Array, joint: int) -> dict[str, Any]:
    """Kind and axis of a joint in its own frame, determined from a test motion."""
    step = 0.5
    q = np.zeros(len(robot.joint_names))
    q[joint] = step
    moved = inverse(zero[joint + 1]) @ robot.joint_poses(q)[joint + 1]
    rotation = rotation_vector(moved[:3, :3]) / step
    revolute = bool(np.linalg.norm(rotation) > 0.5)
    axis = rotation if revolute else moved[:3, 3] / step
    return {"revolute": revolute, "axis": [float(v) + 0.0 for v in np.round(axis, 9)]}


def _step(timed: TimedStep, joined: bool, erring: float | None) -> dict[str, Any]:
    """A step; a move is `joined` if it continues the one before without a stop. `erring`: its clearance with errors."""
    step = timed.step
    common = {
        "name": step.name,
        "start": round(timed.start_s, 6),
        "end": round(timed.end_s, 6),
        "jaws": [round(f, 4) for f in timed.jaws],
    }
    match step:
        case Move():
            return common | {
                "kind": "move",
                "role": "along" if step.role == "line" else step.role,
                "cube": step.cube,
                "threaded": step.threaded,
                "counts": list(step.path.start),
                "segments": [[s.duration_ms, *map(list, s.coefficients)] for s in step.path.segments],
                "held": step.held,
                "clearance": step.clearance if _planned(step) else None,
                "clearance_with_errors": erring,
                "clearances": [float(np.floor(c * 1e6)) / 1e6 for c in step.clearances],
                "joined": joined,
                "closest": list(step.closest),
                "certified": step.certified,
            }
        case GripperStep():
            return common | {"kind": "gripper", "role": "gripper", "cube": step.cube, "action": step.action}
        case Pause():
            return common | {"kind": "pause", "role": "pause", "cube": None}
        case LookStep():
            return common | {"kind": "look", "role": "look", "cube": None}
