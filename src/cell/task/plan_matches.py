"""Check before execution that a plan matches the present cell, and certify it again."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import astuple, replace
from typing import Any

import numpy as np

from arm.board import plate_name
from arm.errors import ImpossibleError
from arm.io.storage import canonical_json, sha256
from arm.numerics.products import mul
from arm.plan_file import Plan
from arm.poses import BoardPose
from arm.robot.shapes import Body, Shape
from arm.robot.thread import Thread
from arm.se3 import Array, apply, frozen, inverse, transform
from cell.accuracy.arm_errors import arm_errors
from cell.config.arm_file import ARM, ArmFile
from cell.config.cell import Cell
from cell.config.inputs import changes, shortened
from cell.files.board_shift import board_shift
from cell.files.task import Task
from cell.program.planning import program_options, require_board, require_threads, scene_of_plan
from cell.program.program_file import ProgramTask
from cell.scene.bodies import T_hole_cube, plate_body
from cell.scene.build import RELEASE_GAP, T_base_cube_on_table, build_scene, cube_name
from cell.scene.displaced import support_of
from cell.scene.fingerprint import plan_fingerprint
from cell.scene.options import options_of, pose_list_options
from plan.collision.certificate import ArmErrors
from plan.options import PlanOptions
from plan.program.grammar import require_grammar
from plan.scene import Scene, scene_from_json
from plan.verify import ReplayedMove, RequiredClearance, placed_cubes, replay
from vision.observation import Observation, ObservedBoard
from vision.occupancy.classify import Occupancy

_FROM_FILES = ("task", "inputs", "seed", "options", "robot_open", "robot_holding")
PLACED = 5e-4  # permitted distance of a cube's release from its place, m; rounding to counts causes 0.03 mm
SAME = 1e-9  # numerical tolerance for equal bodies, m


def require_match(task: Task, plan: Plan) -> None:
    """Require that the plan's fingerprint matches the present one: unit, arm, limits, calibration, files, options.

    Raises:
        ImpossibleError: names each difference, of task and cell file key by key; nothing moved.
    """
    cell = task.cell
    _require_same_job(task, plan)
    now, then = _provenance_of_now(task, plan), plan.provenance
    differing = [
        key
        for key in (*now, *sorted(then.keys() - now.keys()))
        if key not in now or key not in then or canonical_json(then[key]) != canonical_json(now[key])
    ]
    registers = _other_registers(cell, plan)
    if registers:
        differing = [*(key for key in differing if key != "limits"), "limits"]
    if not differing:
        return
    changed = _changed_inputs(task, plan) if {"task", "inputs"} & set(differing) else {}
    shown = [f"{file}: {shortened(words)}" for file, words in changed.items()]
    for key in differing:
        if key == "limits" and registers:
            shown.append(f"limits: {', '.join(registers)}")
        elif not (changed and key in _FROM_FILES):  # a changed file explains what follows from it
            of = f" ({cell.camera_file.name})" if key == "calibration" else ""
            shown.append(_difference(key, then.get(key), now.get(key)) + of)
    raise ImpossibleError(
        f"the plan is not for the present cell: {'; '.join(shown)}; plan again",
        differing=differing,
        changed=changed,
        plan={key: then.get(key) for key in differing},
        now={key: now.get(key) for key in differing},
    )


def require_arm(arm: ArmFile, plan: Plan) -> None:
    """Require that a plan without a unit is for the arm of an arm file, among its bodies.

    Raises:
        ImpossibleError: names each difference, of the arm file key by key.
    """
    inputs = plan.provenance.get("inputs", {})
    then = inputs.get(ARM) if isinstance(inputs, dict) else None
    changed = changes(then, arm.inputs) if isinstance(then, dict) else []
    if arm.robot.digest != plan.scene.get("robot_open"):
        changed = changed or ["the arm, its SRDF or its meshes"]
    if changed:
        why = f"the plan is not for the arm of {arm.file.name}: {shortened(changed)}; plan again"
        raise ImpossibleError(why, differing=[ARM], changed={arm.file.name: changed})


def _provenance_of_now(task: Task, plan: Plan) -> dict[str, Any]:
    """The fingerprint that a plan made now would have, for the same scene and at the same speed."""
    cell = task.cell
    options = _options_of(task, plan)
    return {
        **{key: value for key, value in plan_fingerprint(task).items() if key != "notes"},
        "robot_open": cell.robot().digest,
        "robot_holding": cell.robot_holding().digest,
        "unit": cell.unit.digest,
        "options": options.to_json(),
        "scene": sha256(plan.scene),
    }


def _options_of(task: Task, plan: Plan) -> PlanOptions:
    """The options that a plan of this task has if it is made now, at the same speed."""
    if isinstance(task, ProgramTask):
        return program_options(task, plan.speed)
    return (pose_list_options if "poses" in plan.task else options_of)(task, plan.speed)


def _difference(key: str, then: Any, now: Any) -> str:
    if isinstance(then, dict) and isinstance(now, dict):
        return f"{key}: {shortened(changes(then, now))}"
    return f"{key} {_short(then)}, now {_short(now)}"


def _short(value: Any) -> str:
    return "not given" if value is None else "given" if isinstance(value, dict) else str(value)[:12]


def _require_same_job(task: Task, plan: Plan) -> None:
    """Require the same task and unit. If they differ, no other difference is worth reporting."""
    name, kind = plan.task.get("name", task.name), plan.task.get("kind", task.kind)
    for what, then, now in (
        ("task", f"{name} ({kind})", f"{task.name} ({task.kind})"),
        ("unit", plan.unit, task.cell.unit.name),
    ):
        if then != now:
            why = f"the plan is for {what} {then}, but {task.file.name} is of {what} {now}; give its file or plan again"
            raise ImpossibleError(why, differing=[what], plan={what: then}, now={what: now})


def _changed_inputs(task: Task, plan: Plan) -> dict[str, list[str]]:
    """Changes of task and cell file since the plan was made; empty if the plan has no record of its inputs."""
    then = plan.provenance.get("inputs")
    files = (("task", task.file.name, task.inputs), ("cell", task.cell.file.name, task.cell.inputs))
    if not isinstance(then, dict) or not all(isinstance(then.get(key), dict) for key, _, _ in files):
        return {}
    found = {name: changes(then[key], inputs) for key, name, inputs in files}
    return {name: words for name, words in found.items() if words}


def _other_registers(cell: Cell, plan: Plan) -> list[str]:
    """Speed and acceleration registers that differ between plan and cell, and by how much."""
    sides = (
        ("speed", plan.speed_registers, cell.speed_registers),
        ("acceleration", plan.acceleration_registers, cell.acceleration_registers),
    )
    return [
        f"{name} register of axis {axis} {then}, now {now} ({100.0 * (now - then) / max(then, 1):+.1f} %)"
        for name, planned, of_cell in sides
        for axis, then, now in zip(cell.unit.axes, planned, of_cell, strict=True)
        if then != now
    ]


def require_start_at(task: Task, plan: Plan) -> None:
    """Require that the plan starts at q_start, where the arm goes first.

    Raises:
        ImpossibleError: it does not; names the deviation of each axis. Nothing moved.
    """
    unit = task.cell.unit
    begin, q_start = next(plan.moves).path.start, unit.counts(task.cell.q_start)
    off = [int(b - c) for b, c in zip(begin, q_start, strict=True)]
    if max(map(abs, off)) > unit.rest_tolerance:
        degrees = np.degrees(unit.positions(begin) - task.cell.q_start)
        shown = ", ".join(
            f"{axis} {counts:+d} counts ({turn:+.2f} deg)"
            for axis, counts, turn in zip(unit.axes, off, degrees, strict=True)
            if abs(counts) > unit.rest_tolerance
        )
        raise ImpossibleError(
            f"the plan does not start at the cell's q_start: off by {shown}; plan again, "
            "or continue from where the arm is with --resume",
            off_counts=off,
        )


def require_scene(task: Task, plan: Plan, observation: Observation) -> None:
    """Require boards at their planned poses, within the cell's tolerance, and cubes in the planned holes.

    Raises:
        ImpossibleError: names each deviation; nothing moved.
    """
    bodies = {b["name"]: np.array(b["T_base_body"]) for b in plan.scene["bodies"]}
    faults = []
    for pose in observation.poses:
        plate = plate_body(pose.board.name, pose.T_base_board, pose.board.plate)
        planned = bodies.pop(plate.name, None)
        if planned is None:
            faults.append(f"{plate.name} is not in the plan")
            continue
        # the board on its plate, as observed
        T_plate_board = mul(inverse(plate.T_base_body), pose.T_base_board)
        T_then, T_now = mul(planned, T_plate_board), pose.T_base_board
        shift = board_shift(pose.board, task.cell.cube_size, T_then, T_now, task.on_board)
        if shift.beyond(task.cell):
            faults.append(f"{plate.name} is {shift} from its planned pose")
    holding = {c["name"].removeprefix(cube_name("")) for c in plan.scene["cubes"]}
    for board in observation.boards:
        for hole, now in zip(board.pose.holes, board.occupancy, strict=True):
            planned_state = "cube" if hole.name in holding else "empty"
            if now.state not in (planned_state, "unsure"):
                faults.append(f"hole {hole.name} looks {now.state}, planned was {planned_state}")
    faults += [f"{name} of the plan was not seen" for name in bodies if name.startswith(plate_name(""))]
    if faults:
        why = f"the scene is not the plan's: {'; '.join(faults)}; look and plan again"
        raise ImpossibleError(why, faults=faults)


def scene_of_now(task: Task, plan: Plan) -> Scene:
    """Rebuild the plan's scene from the present cell file. Only board poses and cubes come from the plan.

    Raises:
        ImpossibleError: the plan's scene has other bodies, cubes or allowed collisions; names them.
    """
    cell = task.cell
    stated = scene_from_json(plan.scene, cell.robot(), cell.robot_holding())
    planned = planned_observation(cell, stated)
    on_table: dict[str, Array] = {}
    for cube in () if isinstance(task, ProgramTask) else stated.cubes:
        place, _, number = cube.name.removeprefix(cube_name("")).rpartition("/")
        if not number.isdigit():
            raise ImpossibleError(f"the plan's scene has {cube.name!r}, which names no place; plan again")
        if place == "table":
            on_table[cube.name] = T_base_cube_on_table(task, f"{place}/{number}")
    final = placed_cubes(plan, stated, cell.unit)
    for entry in plan.task.get("cubes", ()):
        if entry["cube"] != cube_name(entry["from"]):
            raise ImpossibleError(
                f"the plan takes {entry['cube']!r} from {entry['from']!r}, where there is another cube; plan again"
            )
        _require_placed(task, final, planned.poses, entry)
    now = (
        scene_of_plan(task, plan, stated, planned)
        if isinstance(task, ProgramTask)
        else build_scene(cell, planned, on_table)
    )
    served = {
        frozenset((e["cube"], support_of(e[end])))
        for e in plan.task.get("cubes", ())
        for end in ("from", "to")
    }
    now = replace(now, allowed=now.allowed | served)
    differing = _differing(stated, now)
    if differing:
        why = f"the plan's scene is not that of the present cell: {', '.join(differing)}; plan again"
        raise ImpossibleError(why, differing=differing)
    return now


def _require_placed(
    task: Task, cubes: Mapping[str, Array], poses: Sequence[BoardPose], entry: Mapping[str, str]
) -> None:
    """Require that the motion releases a cube at the target that the plan states."""
    place = entry["to"]
    board, _, number = place.rpartition("/")
    holes = {hole.name: hole.T_base_hole for pose in poses for hole in pose.holes}
    if place in holes:
        T_base_place = mul(holes[place], T_hole_cube(task.cell.cube_size))
    elif board == "table" and number.isdigit() and int(number) > 0:
        T_base_place = T_base_cube_on_table(task, place)
    else:
        why = f"the plan brings {entry['cube']!r} to {place!r}, which is no place; plan again"
        raise ImpossibleError(why)
    let_go = apply(T_base_place, [0.0, 0.0, RELEASE_GAP])
    off = float(np.linalg.norm(cubes[entry["cube"]][:3, 3] - let_go))
    if off > PLACED:
        raise ImpossibleError(
            f"the plan brings {entry['cube']!r} to {place!r}, but its motion releases it {1e3 * off:.1f} mm from "
            "there; plan again",
            cube=entry["cube"],
            place=place,
            off_m=off,
        )


def planned_observation(cell: Cell, scene: Scene, more: Iterable[str] = ()) -> Observation:
    """The boards of a plan's scene, with cubes in the same holes as in the scene, and in the holes `more`.

    Raises:
        ImpossibleError: the cell file has no such board.
    """
    holding = {cube.name.removeprefix(cube_name("")) for cube in scene.cubes} | set(more)
    boards = []
    for body in scene.bodies:
        if body.name.startswith(plate_name("")):
            pose = _pose_of_plate(cell, body)
            occupancy = (Occupancy("cube" if hole.name in holding else "empty") for hole in pose.holes)
            boards.append(ObservedBoard(pose, tuple(occupancy)))
    return Observation(tuple(boards))


def _pose_of_plate(cell: Cell, plate: Body) -> BoardPose:
    name = plate.name.removeprefix(plate_name(""))
    for board in cell.boards:
        if board.name == name:
            nominal = plate_body(name, transform(), board.plate).T_base_body
            return BoardPose(
                board, frozen(mul(plate.T_base_body, inverse(nominal))), np.zeros((6, 6)), 0.0, np.inf
            )
    why = f"the plan's scene has {plate.name!r}, which is no board of the cell file; plan again"
    raise ImpossibleError(why)


def _same_shape(a: Shape, b: Shape) -> bool:
    if type(a) is not type(b):
        return False
    x, y = np.hstack(astuple(a)), np.hstack(astuple(b))
    return x.shape == y.shape and bool(np.allclose(x, y, rtol=0.0, atol=SAME))


def _differing(stated: Scene, now: Scene) -> list[str]:
    """Names of bodies and allowed collisions that differ between the scenes."""
    lists = [{b.name: b for b in (*scene.bodies, *scene.cubes)} for scene in (stated, now)]
    names = sorted(set(lists[0]) ^ set(lists[1]))
    for name in sorted(set(lists[0]) & set(lists[1])):
        a, b = (bodies[name] for bodies in lists)
        if (
            not _same_shape(a.shape, b.shape)
            or np.abs(a.T_base_body - b.T_base_body).max() > SAME
            or abs(a.padding - b.padding) > SAME
        ):
            names.append(name)
    contacts = stated.allowed ^ now.allowed
    names += ["the order of the parts"] if stated.supplies != now.supplies else []
    names += [f"the line of {thread.name}" for thread in _other_threads(stated, now)]
    return names + [f"contact of {' and '.join(sorted(pair))}" for pair in sorted(contacts, key=sorted)]


def _other_threads(stated: Scene, now: Scene) -> list[Thread]:
    """Threads of one of the scenes that the other does not have."""

    def same(a: Thread, b: Thread) -> bool:
        alike = (a.name, a.ring, a.line.shape) == (b.name, b.ring, b.line.shape)
        return alike and bool(np.abs(a.line - b.line).max() <= SAME)

    both = (stated.threads, now.threads), (now.threads, stated.threads)
    return [a for ours, others in both for a in ours if not any(same(a, b) for b in others)]


def replayed(task: Task, plan: Plan, errors: ArmErrors | None = None) -> tuple[ReplayedMove, ...]:
    """Certify every move of the plan again, in the present scene; with `errors`, also that of an arm that has them.

    Raises:
        ImpossibleError: the plan does not match the present cell, cannot be executed, or does not hold.
    """
    require_match(task, plan)
    require_grammar(plan)
    cell, options = task.cell, _options_of(task, plan)
    offset: float | None = cell.offset
    if isinstance(task, ProgramTask):
        require_board(task, plan)
        require_threads(task, plan)
        offset = None
    required = RequiredClearance(options.clearance, options.line_clearance, offset)
    return replay(plan, scene_of_now(task, plan), cell.unit, cell.limits, required, errors)


def check_plan(task: Task, plan: Plan) -> dict[str, Any]:
    """The output of ``a465 check`` for a plan of a cell.

    Raises:
        ImpossibleError: see `replayed`.
    """
    return replayed_to_json(plan, replayed(task, plan, arm_errors(task.cell)))


def replayed_to_json(plan: Plan, moves: Sequence[ReplayedMove]) -> dict[str, Any]:
    """Return what verified moves prove of a plan, as JSON types.

    What is proved of an arm with errors holds for the exact arm too, so it counts where it is the better bound.
    """
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
                "proved_mm": 1e3 * max(c.clearance for c in (m.check, m.erring) if c is not None),
                "proved_erring_mm": None if m.erring is None else 1e3 * m.erring.clearance,
                "closest": list(m.check.pair),
                "threaded": m.move.threaded,
            }
            for m in moves
        ],
    }
