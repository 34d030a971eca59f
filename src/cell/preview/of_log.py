"""The preview page of a log: the executed motion over the planned one, with plan and task files if they are found."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
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
from cell.files.task import Task
from cell.preview.executed import MatchedMotion, match, plan_of
from cell.preview.of_plan import write_page
from cell.preview.overlays import ExecutedMove
from cell.preview.page import write_preview
from cell.program.program_file import task_of_file
from cell.task.plan_matches import require_match
from driver.log.read import Session, read_log

TOOL_LENGTH = 0.134112  # of the gripper and fingers of the URDF, m
JAW_OPENINGS = (0.06, 0.04)  # open, and holding a cube of the default cell, m


@dataclass(frozen=True)
class Replay:
    """A log with the plan that was executed.

    Attributes:
        session: content of the log.
        unit: of the log.
        plan: the plan with the most motions of the log; made from the lines sent if no plan file was found.
        plan_file: its file, or None.
        matched: the motions of the log that are in the plan.
        task: of the plan; None if not found, then the arm is shown with its default tool and without boards.
    """

    session: Session
    unit: Unit
    plan: Plan
    plan_file: Path | None
    matched: tuple[MatchedMotion, ...]
    task: Task | None

    @property
    def executed(self) -> tuple[ExecutedMove, ...]:
        """Executed moves for the page."""
        return tuple(m.executed for m in self.matched if len(m.executed.time_s))

    @property
    def farthest_deg(self) -> float | None:
        """Largest distance of any sample and joint from the planned path, deg."""
        worst = [float(np.abs(m.difference).max()) for m in self.matched if m.difference.size]
        return float(np.degrees(max(worst))) if worst else None


def preview_log(log: Path, task_file: Path | None, output: Path, console: Console) -> dict[str, Any]:
    """``a465 preview LOG``: write the page. Return a summary in JSON types.

    Raises:
        InputError: not a log, no motion in it, a task file that cannot be read, or the page cannot be written.
        ImpossibleError: the given task is not that of the log's plan.
    """
    replay = _replay(log, task_file)
    if replay.task is not None:
        write_page(replay.task, replay.plan, output, unit=replay.unit, executed=replay.executed)
    else:  # clearance is not sampled, because the arm may have another tool
        wide, narrow = (load_a465(TOOL_LENGTH, opening) for opening in JAW_OPENINGS)
        write_preview(
            replay.plan, wide, narrow, replay.unit, output, clearance_every_s=0.0, executed=replay.executed
        )
    moves = len([m for m in replay.session.motions if m.segments])
    shown = len([m for m in replay.matched if replay.session.motions[m.number].segments])
    summary = {
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
    for line in _remarks(replay, moves, shown, task_file):
        console.say(line)
    console.say(f"open {output} in a browser")
    return summary


def _motion_to_json(motion: MatchedMotion) -> dict[str, Any]:
    worst = np.degrees(np.abs(motion.difference).max(axis=0)) if motion.difference.size else np.zeros(0)
    return {
        "step": motion.executed.step,
        "planned_s": round(motion.planned_s, 3),
        "lasted_s": None if motion.lasted_s is None else round(motion.lasted_s, 3),
        "samples": len(motion.executed.time_s),
        "farthest_deg": [round(float(v), 5) for v in worst],
    }


def _remarks(replay: Replay, streams: int, shown: int, task_file: Path | None) -> Iterator[str]:
    farthest = replay.farthest_deg
    if farthest is not None:
        yield f"executed motion is at most {farthest:.4f} deg from the planned path, over all samples and joints"
    if replay.plan_file is None:
        yield "no plan file of this log was found beside it: only the arm is shown, with the lines sent as the plan"
    else:
        yield f"plan {replay.plan.sha256[:12]} of {replay.plan_file}: has {shown} of {streams} streamed motions"
    if task_file is not None and replay.plan_file is None:
        yield f"{task_file} is not shown: boards and camera need the plan of the log; copy it beside the log"
    elif replay.task is None:
        yield "its task file was not found: default tool, no boards, no camera; give TASK to show them"


def _replay(log: Path, task_file: Path | None) -> Replay:
    session = read_log(log)
    noted = [note.data["unit"] for note in session.noted("run") if "unit" in note.data]
    best: Replay | None = None
    for path in sorted(log.resolve().parent.glob("*.json")):
        plan = _plan(path)
        if plan is None or plan.unit not in (noted or [plan.unit]):
            continue
        unit = unit_of(session, plan.unit)
        matched = match(session, plan, unit)
        if len(matched) > (0 if best is None else len(best.matched)):
            best = Replay(session, unit, plan, path, matched, None)
    if best is not None:
        return replace(best, task=_task(session, best.plan, task_file))
    if task_file is not None:
        task_of_file(task_file)  # a wrong file is told, though only a plan says how it goes with the log
    unit = unit_of(session, None)
    plan, matched = plan_of(session, unit)
    if not plan.steps:
        why = f"{log}: has no motion with a known start, so there is nothing to show"
        raise InputError(why, file=str(log))
    return Replay(session, unit, plan, None, matched, None)


def _plan(path: Path) -> Plan | None:
    """Read the plan in a file; None if the file is not a plan."""
    try:
        head = read_json(path)
    except InputError:
        return None
    if not isinstance(head, dict) or head.get("format") != FORMAT:
        return None
    return read_plan(path)


def _task(session: Session, plan: Plan, given: Path | None) -> Task | None:
    """The given task, which must be that of the plan; or the first one found with the digest in the plan."""
    if given is not None:
        task = task_of_file(given)
        require_match(task, plan)
        return task
    for path in _task_files(session, plan):
        try:
            task = task_of_file(path)
        except InputError:
            continue
        if task.digest == plan.provenance.get("task") and task.cell.unit.name == plan.unit:
            return task
    return None


def _task_files(session: Session, plan: Plan) -> Iterator[Path]:
    """Candidate task files: as noted in the log, and with the plan's name in ./scenes and in the shipped scenes."""
    for note in session.noted("run"):
        if isinstance(note.data.get("task"), str):
            yield session.file.resolve().parent / note.data["task"]
    name = plan.task.get("name")
    if isinstance(name, str) and name and Path(name).name == name:
        yield Path("scenes") / f"{name}.toml"
        yield data_file("scenes") / f"{name}.toml"
