"""The preview page of a log: what was executed over what was planned, with whatever of the run can still be found."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from arm.controller.unit import Unit
from arm.errors import InputError
from arm.io.storage import data_file, read_json
from arm.plan_file import FORMAT, Plan, read_plan
from arm.robot.model import load_a465
from cell.console import Console
from cell.export.series import unit_of
from cell.files.task import Task, read_task
from cell.preview.executed import MatchedMotion, match, plan_of
from cell.preview.overlays import ExecutedMove
from cell.preview.page import write_preview
from cell.task.plan_matches import require_match
from driver.log.read import Session, read_log

TOOL_LENGTH = 0.134112  # of the gripper and fingers of the URDF, m
JAW_OPENINGS = (0.06, 0.04)  # open, and holding a cube of the default cell, m


@dataclass(frozen=True)
class Replay:
    """A log with the plan that it follows.

    Attributes:
        plan: of most of the log's motions; made from the lines sent if no plan file was found.
        plan_file: where it was read, or None.
        matched: the motions of the log that are in it.
        task: of the plan, or None if it was not found: then the arm has its default tool and the cell no boards.
    """

    session: Session
    unit: Unit
    plan: Plan
    plan_file: Path | None
    matched: tuple[MatchedMotion, ...]
    task: Task | None

    @property
    def executed(self) -> tuple[ExecutedMove, ...]:
        """For the page."""
        return tuple(m.executed for m in self.matched if len(m.executed.time_s))

    @property
    def farthest_deg(self) -> float | None:
        """Of any sample from the planned path, worst joint."""
        worst = [float(np.abs(m.difference).max()) for m in self.matched if m.difference.size]
        return float(np.degrees(max(worst))) if worst else None


def preview_log(log: Path, task_file: Path | None, output: Path, console: Console) -> dict[str, Any]:
    """``a465 preview LOG``; what was written, as JSON types.

    Raises:
        InputError: no log, no motion in it, a task file that cannot be read, or the page cannot be written.
        ImpossibleError: the task given is not that of the log's plan.
    """
    replay = _replay(log, task_file)
    _write(replay, output)
    moves = len([m for m in replay.session.motions if m.segments])
    shown = len([m for m in replay.matched if replay.session.motions[m.number].segments])
    told = {
        "page": str(output),
        "log": str(log),
        "plan": None if replay.plan_file is None else str(replay.plan_file),
        "plan_sha256": None if replay.plan_file is None else replay.plan.sha256,
        "task": None if replay.task is None else str(replay.task.file),
        "streams": moves,
        "streams_shown": shown,
        "samples": sum(len(e.time_s) for e in replay.executed),
        "farthest_deg": replay.farthest_deg,
        "motions": [_motion_to_json(m) for m in replay.matched],
        "damaged": replay.session.damaged,
        "bytes": output.stat().st_size,
    }
    for line in _remarks(replay, moves, shown):
        console.say(line)
    console.say(f"open {output} in a browser")
    return told


def _motion_to_json(motion: MatchedMotion) -> dict[str, Any]:
    worst = np.degrees(np.abs(motion.difference).max(axis=0)) if motion.difference.size else np.zeros(0)
    return {
        "step": motion.step,
        "planned_s": round(motion.planned_s, 3),
        "lasted_s": None if motion.lasted_s is None else round(motion.lasted_s, 3),
        "samples": len(motion.executed.time_s),
        "farthest_deg": [round(float(v), 5) for v in worst],
    }


def _remarks(replay: Replay, streams: int, shown: int) -> Iterator[str]:
    farthest = replay.farthest_deg
    if farthest is not None:
        yield f"executed motion is at most {farthest:.4f} deg from the planned path, at any sample of any joint"
    if replay.plan_file is None:
        yield "no plan file of this log was found beside it: the arm alone is shown, with what was sent as the plan"
    else:
        yield f"plan {replay.plan.sha256[:12]} of {replay.plan_file}: {shown} of {streams} streamed motions are its own"
    if replay.task is None:
        yield "its task file was not found: the arm has the default tool, boards and camera are not drawn; give TASK"


def _replay(log: Path, task_file: Path | None) -> Replay:
    session = read_log(log)
    noted = [note.data["unit"] for note in session.noted("run") if "unit" in note.data]
    best: tuple[int, Path, Plan, tuple[MatchedMotion, ...]] | None = None
    for path in sorted(log.resolve().parent.glob("*.json")):
        plan = _plan(path)
        if plan is None or plan.unit not in (noted or [plan.unit]):
            continue
        unit = unit_of(session, plan.unit)
        matched = match(session, plan, unit)
        if matched and (best is None or len(matched) > best[0]):
            best = (len(matched), path, plan, matched)
    if best is None:
        unit = unit_of(session, None)
        plan, matched = plan_of(session, unit)
        if not plan.steps:
            raise InputError(
                f"{log}: holds no motion with a known start, so there is nothing to show", file=str(log)
            )
        return Replay(session, unit, plan, None, matched, None)
    _, path, plan, matched = best
    return Replay(session, unit_of(session, plan.unit), plan, path, matched, _task(session, plan, task_file))


def _plan(path: Path) -> Plan | None:
    """The plan in a file, or None if it holds something else."""
    try:
        head = read_json(path)
    except InputError:
        return None
    if not isinstance(head, dict) or head.get("format") != FORMAT:
        return None
    return read_plan(path)


def _task(session: Session, plan: Plan, given: Path | None) -> Task | None:
    """The task given, which must be the plan's; or the first found whose digest is that in the plan."""
    if given is not None:
        task = read_task(given)
        require_match(task, plan)
        return task
    for path in _task_files(session, plan):
        try:
            task = read_task(path)
        except InputError:
            continue  # one that cannot be read is not the one
        if task.digest == plan.provenance.get("task") and task.cell.unit.name == plan.unit:
            return task
    return None


def _task_files(session: Session, plan: Plan) -> Iterator[Path]:
    """Where the task may be: as noted in the log, by its name in scenes here, and among the project's own."""
    for note in session.noted("run"):
        if isinstance(note.data.get("task"), str):
            yield session.file.resolve().parent / note.data["task"]
    name = plan.task.get("name")
    if isinstance(name, str) and name and Path(name).name == name:
        yield Path("scenes") / f"{name}.toml"
        yield data_file("scenes") / f"{name}.toml"


def _write(replay: Replay, output: Path) -> None:
    if replay.task is not None:
        cell = replay.task.cell
        write_preview(
            replay.plan,
            cell.robot(),
            cell.robot(cell.cube_size),
            replay.unit,
            output,
            boards=cell.boards,
            dictionary=cell.dictionary,
            camera=cell.camera,
            executed=replay.executed,
        )
        return
    # Clearance is not sampled: it would be that of a tool which may be another.
    wide, narrow = (load_a465(TOOL_LENGTH, opening) for opening in JAW_OPENINGS)
    write_preview(
        replay.plan, wide, narrow, replay.unit, output, clearance_every_s=0.0, executed=replay.executed
    )
