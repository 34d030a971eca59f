"""The single steps of a task, connected by files. Each step returns the JSON object that its command prints."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from itertools import combinations, zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from arm.errors import ExecutionStopped, InputError
from arm.former import former_names
from arm.io.outputs import keep_apart
from arm.io.storage import canonical_json, keep_unread, write_atomic
from arm.plan_file import Move, Plan, write_plan
from cell.accuracy.budget_report import budget_to_json, print_budgets
from cell.accuracy.clearances import erring_clearances
from cell.accuracy.error_model import ErrorModel
from cell.accuracy.measures import require_insertion
from cell.accuracy.placement import PlacementBudget
from cell.accuracy.plan_budgets import pocket_fit, require_placements
from cell.config.cell import Cell
from cell.config.doubts.cell_doubts import cell_doubts
from cell.console import Console
from cell.files.observation import observation_to_json, read_observation, require_boards, tilt_words
from cell.files.task import KINDS, Task, read_task
from cell.program.program_file import task_of_file
from cell.scene.board_doubts import board_doubts
from cell.scene.places import nothing_to_plan, out_of_view, reach_of
from cell.session.budget import within
from cell.session.speed import planning_speed, tool_words
from cell.task.planning import (
    Rest,
    plan_otherwise,
    plan_rest,
    require_above_table,
)
from plan.budget import PlanningInterrupted, SearchBudget
from plan.cartesian.reachability import ReachTable
from plan.options import clearance_words
from vision.observation import Observation

if TYPE_CHECKING:
    from vision.camera.frame_source import FrameSource

former_names(__name__, "cell.commands.render", "render_step")


def look_step(
    task_file: Path,
    images: Path | None,
    world: Path | None,
    output: Path | None,
    picture: Path | None,
    console: Console,
    camera: str | None = None,
) -> dict[str, Any]:
    """``a465 look``: images from a camera, a folder, or the simulated cell with the arm at q_start."""
    from cell.files.world import read_world
    from cell.session.cameras import require_one_camera
    from cell.session.connection import world_file
    from cell.sim.made import require_boards_of
    from cell.task.look import look_and_save

    require_one_camera(images, camera)
    if world is not None and (images is not None or camera is not None):
        option = "--images" if images is not None else "--camera"
        raise InputError(f"--world is of the simulated cell; there is none with {option}", option="world")
    if picture is not None and picture.suffix.lower() != ".png":
        raise InputError(
            f"--picture {picture}: must end in .png, as it is a PNG", option="picture", file=str(picture)
        )
    if picture is not None and images is not None and picture.resolve().parent == images.resolve():
        rule = "is in the folder of --images, and would be read as one of them; give another folder"
        raise InputError(f"--picture {picture}: {rule}", option="picture", file=str(picture))
    for written, kind in ((output, "look"), (picture, "")):
        keep_apart(written, task_file, world, kind=kind)
        keep_unread(written)
    task = task_of_file(task_file)
    with frames_of(task, images, camera, world) as frames:
        if images is None and camera is None:
            require_boards_of(task, read_world(world_file(task, world), task.cell.marker_size))
        seen = look_and_save(task, frames, picture, console, "at the cell")
    result = observation_to_json(seen, task.cell.camera)
    if output is not None:
        write_atomic(output, canonical_json(result) + "\n")
    _print_look(seen, console)
    _doubt(task.cell, seen, console)
    for doubt in () if images is None else (_copies(seen), _without_markers(seen), _left_over(images, seen)):
        if doubt:
            console.say(f"NOTE: {images}: {doubt}")
    require_boards(seen, task)
    if task.kind not in KINDS:
        return result | {"placements": []}
    return result | {"placements": _foreseen(task, seen, console, picture=picture)}


def required_look(look: Path | None, task_file: Path) -> Path:
    """Return the file of what was seen.

    Raises:
        InputError: there is none, unless the task file has a fault: that is told first.
    """
    if look is None:
        read_task(task_file)
        why = f"--look is missing: boards have to be seen; a465 look {task_file} -o look.json"
        raise InputError(why, option="--look")
    return look


def frames_of(
    task: Task, images: Path | None, camera: str | None, world: Path | None
) -> AbstractContextManager[FrameSource]:
    """Open a folder of images, a camera, or the camera of the simulated cell with the arm at q_start."""
    from cell.report.run_folder import require_no_pictures
    from cell.session.cameras import open_camera
    from cell.session.connection import camera_at_start
    from vision.camera.frame_source import ImageFolder

    if camera is not None:
        return open_camera(task.cell, camera)
    if images is not None:
        require_no_pictures(images)
    return nullcontext(ImageFolder(images) if images is not None else camera_at_start(task, world))


def _print_look(seen: Observation, console: Console) -> None:
    rows = []
    for board in seen.boards:
        for hole, occupancy in zip(board.pose.holes, board.occupancy, strict=True):
            x, y, z = 1e3 * hole.T_base_hole[:3, 3]
            std = 1e3 * float(np.sqrt(np.trace(hole.covariance[:3, :3])))
            rows.append((hole.name, float(x), float(y), float(z), std, occupancy.state))
    if rows:
        console.table(("hole", "x mm", "y mm", "z mm", "std mm", "state"), rows)
    if (shift := seen.camera_shift) is not None:
        console.say(f"camera against the background: moved by {shift.describe()}, {shift.seen} features")
    for board in seen.boards:
        console.say(
            f"board {board.name}: tilt {tilt_words(board.pose)}, residual {board.pose.residual_px:.3f} px"
        )


def _doubt(cell: Cell, seen: Observation, console: Console, own: Iterable[str] = ()) -> None:
    """Print what is doubtful about where boards were seen and the arm starts, and `own` of the task; a refusal may come
    from it."""
    for doubt in (*cell_doubts(cell), board_doubts(cell, seen), *own):
        if doubt:
            console.say(f"NOTE: {doubt}")


def _copies(seen: Observation) -> str:
    """Say that an image of a look is another one's copy; "" if none is."""
    images = seen.images
    for second, first in combinations(range(len(images) - 1, -1, -1), 2):
        if np.array_equal(images[first], images[second]):
            return (
                f"images {first + 1} and {second + 1} of {len(images)} are the same to the bit, so their noise is not "
                "measured; give images that were taken one by one"
            )
    return ""


def _without_markers(seen: Observation) -> str:
    """Say which images of a look show no marker, where others do; "" if all or none do."""
    empty = [str(i) for i, markers in enumerate(seen.frames, start=1) if not markers]
    if not 0 < len(empty) < len(seen.frames):
        return ""
    which = f"image{'s' if len(empty) > 1 else ''} {', '.join(empty)} of {len(seen.frames)}"
    return (
        f"{which} show{'' if len(empty) > 1 else 's'} no marker, and the others do: do all show the cell now?"
    )


def _left_over(folder: Path, seen: Observation) -> str:
    """Say how many images of a folder a look did not use; "" if it used all."""
    from vision.camera.frame_source import IMAGE_SUFFIXES

    names = sorted(p.name for p in folder.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES)
    used = len(seen.images)
    if len(names) <= used:
        return ""
    which = f"the first {used} by name were used, {names[0]} to" if used > 1 else "one was used,"
    return (
        f"has {len(names)} images, of which {which} {names[used - 1]} (look.photographs): are they those of the cell "
        "as it is now?"
    )


def _foreseen(
    task: Task,
    seen: Observation,
    console: Console,
    table: ReachTable | None = None,
    picture: Path | None = None,
) -> list[Any]:
    """Print the budgets of all free targets, draw them over the picture of the look, and return them as JSON.

    Raises:
        ImpossibleError: a cube is too likely to miss its pocket.
    """
    if not ErrorModel.available(task.cell):
        return []
    from cell.task.look import foreseen

    budgets = foreseen(task, seen, table)
    if found := budgets.of(task.cell, seen):
        print_budgets(found, console)
        if picture is not None:
            _draw_over(picture, task.cell, seen, found)
    return [budget_to_json(budget) for budget in require_insertion(task.cell, seen, budgets)]


def _draw_over(picture: Path, cell: Cell, seen: Observation, budgets: Sequence[PlacementBudget]) -> None:
    from cell.accuracy.picture import drawn_over
    from cell.task.look import write_png
    from vision.observe import annotated

    shown = annotated(seen.images[0], cell.camera, seen)
    write_png(picture, drawn_over(shown, cell.camera, seen, budgets, pocket_fit(cell)))


def reach_step(task_file: Path, look_file: Path, console: Console, advice: bool = False) -> dict[str, Any]:
    """``a465 reach``."""
    from cell.task.explain import explain_failure

    task = read_task(task_file)
    seen = read_observation(look_file, task.cell)
    _doubt(task.cell, seen, console)
    require_boards(seen, task, look_file)
    require_above_table(task, seen)
    table = reach_of(task, seen)
    console.table(
        ("hole", "choices", "best branch", "yaw", "what limits it"),
        [(h.hole, len(h.feasible()), h.best.branch, h.best.yaw, h.best.reason()) for h in table.holes],
    )
    with explain_failure(Rest(task, seen, task.cell.q_start, task.cell.speed), advice, every_hole=True):
        table.require()
    return {
        "placements": _foreseen(task, seen, console, table),
        "holes": [
            {
                "hole": h.hole,
                "choices": len(h.feasible()),
                "branch": h.best.branch,
                "yaw": h.best.yaw,
                "joint": h.best.joint,
                "margin_deg": float(np.degrees(h.best.margin)),
            }
            for h in table.holes
        ],
    }


def plan_step(
    task_file: Path,
    look_file: Path,
    output: Path,
    speed: float | None,
    console: Console,
    advice: bool = False,
    budget: SearchBudget | None = None,
) -> dict[str, Any]:
    """``a465 plan``: plan all detected cubes, starting at q_start.

    Raises:
        ExecutionStopped: Ctrl-C was pressed; the best complete plan found by then is written.
        ImpossibleError: there is no plan, or a cube is too likely to miss its pocket.
    """
    from cell.task.explain import explain_failure

    keep_apart(output, task_file, look_file, kind="plan")
    keep_unread(output)
    task = read_task(task_file)
    seen = read_observation(look_file, task.cell)
    _doubt(task.cell, seen, console, (*task.own_doubts(), out_of_view(task)))
    require_boards(seen, task, look_file)
    rest = Rest(task, seen, task.cell.q_start, planning_speed(task.cell, speed))
    stopped: PlanningInterrupted | None = None
    try:
        with within(budget), explain_failure(rest, advice):
            plan = plan_rest(rest)
    except PlanningInterrupted as stop:
        stopped, plan = stop, stop.plan
    if plan is None:
        raise nothing_to_plan(task, seen)
    budgets = require_placements(task.cell, seen, plan, partial(plan_otherwise, rest))
    erring = erring_clearances(task.cell, plan, seen)
    write_plan(output, plan)
    _print_plan(plan, task.cell, console, erring)
    print_budgets(budgets, console)
    if stopped is not None:
        why = f"{stopped}; it is written to {output}, certified, code {plan.code}"
        raise ExecutionStopped(why, plan=str(output), reason="interrupted")
    console.say("a clearance is a distance between bodies as the files describe them, less padding")
    console.say(task.cell.arm_shape())
    console.say(f"plan {plan.sha256[:12]} written to {output}")
    return {
        "plan": str(output),
        "plan_sha256": plan.sha256,
        "speed": plan.speed,
        "motion_s": plan.duration_s,
        "no_plan_is_faster_than_s": plan.task["no_plan_is_faster_than_s"],
        "min_clearance_mm": 1e3 * min(m.clearance for m in plan.moves),
        "cubes": plan.task["cubes"],
        "placements": [budget_to_json(budget) for budget in budgets],
        "skipped": plan.task.get("skipped", []),
        "stopped": plan.notes.get("search"),
        "moves": [move_to_json(m, of) for m, of in zip_longest(plan.moves, erring)],
    }


def _print_plan(plan: Plan, cell: Cell, console: Console, erring: tuple[float, ...]) -> None:
    rows = [
        (m.name, m.path.duration_s, len(m.path.segments), 1e3 * m.clearance)
        + (() if of is None else (1e3 * of,))
        + (" - ".join(m.closest),)
        for m, of in zip_longest(plan.moves, erring)
    ]
    header = (
        "move",
        "duration s",
        "segments",
        "clearance mm",
        *(["with errors mm"] if erring else []),
        "closest",
    )
    console.table(header, rows)
    console.say(
        f"{len(rows)} moves in {len(plan.motions)} motions, {plan.duration_s:.1f} s at speed {plan.speed:g}, "
        f"{tool_words(plan, cell.robot_holding(), cell.unit)}; "
        f"no plan takes less than {plan.task['no_plan_is_faster_than_s']:.1f} s"
    )
    above, share = plan.task["above_that_s"], plan.task["no_plan_is_faster_than_s"] / plan.duration_s
    console.say(
        f"the lower bound is {100.0 * share:.1f} % of the time; the rest, in s: order and grasps {above['order']:.1f}, "
        f"joints that wait for each other {above['straight']:.1f}, detours {above['around']:.1f}, blends and rounding "
        f"{above['sent']:.1f}"
    )
    warn_of(plan, console)


def warn_of(plan: Plan, console: Console) -> None:
    """Print a note if the plan keeps less than the default clearance or its search ended early."""
    for note in (clearance_words(plan.provenance["options"]), plan.notes.get("search")):
        if note:
            console.say(f"NOTE: {note}")


def move_to_json(move: Move, erring: float | None) -> dict[str, Any]:
    """Return what a plan states of a move as JSON types; `erring`: its clearance with errors, m, if known."""
    return {
        "name": move.name,
        "role": move.role,
        "motion_s": move.path.duration_s,
        "clearance_mm": 1e3 * move.clearance,
        "clearance_with_errors_mm": None if erring is None else 1e3 * erring,
        "closest": list(move.closest),
    }
