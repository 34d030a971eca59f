"""``a465 export``: convert a log, plan, scene, cell, task or arm file, recognised by its content, to another format."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from arm.controller.unit import Unit
from arm.errors import A465Error, InputError
from arm.io.kind import KINDS, kind_of_file
from arm.io.outputs import keep_apart, named_as_file
from arm.io.storage import keep_unread, read_text, write_atomic
from arm.io.toml_reader import read_toml
from arm.plan_file import read_plan
from cell.console import Console
from cell.export.ros import JOINTS, joint_trajectory
from cell.export.series import Executed, executed, planned, unit_of
from driver.log.read import Session, is_log, read_log
from plan.trajectory.virtual_unit import NO_UNIT

if TYPE_CHECKING:
    from arm.plan_file import Plan
    from cell.config.arm_file import ArmFile
    from cell.export.ros import Message
    from cell.export.urdf import Surroundings
    from cell.files.task import Task

PERIOD_S = 0.02  # between samples of a plan
URDF = "urdf"
SUFFIXES = {"csv": ".csv", "trajectory": ".trajectory.json", "mcap": ".mcap"}
_KINDS = {"csv": "samples", "trajectory": "trajectory", "mcap": ""}  # of `arm.io.kind`


@dataclass(frozen=True)
class ExportOptions:
    """Options of an export; None and False if not given.

    Attributes:
        form: format, a key of `SUFFIXES` or `URDF`.
        output: file or folder to write; None: beside the file.
        planned: of a log: export the trajectory that was sent, not the sampled positions.
        unit: of a log; None: the one that the log names.
        period: between samples of a plan, s.
        cell: cell, task or arm file that a plan is for; or cell or task file of a log, to show it in MCAP.
        look: observation to add to a cell or task.
    """

    form: str | None = None
    output: Path | None = None
    planned: bool = False
    unit: str | None = None
    period: float | None = None
    cell: Path | None = None
    look: Path | None = None


def export_file(file: Path, asked: ExportOptions, console: Console) -> dict[str, Any]:
    """Write a file in another format. Return a summary in JSON types.

    Raises:
        InputError: the file cannot be exported, a format or option does not apply to it, a library is missing, or the
            output cannot be written.
    """
    if is_log(file):
        _refuse_other_form(asked)
        _refuse_options(file, "a log", asked, ("planned", "unit", "cell"), tuple(SUFFIXES))
        return _log_step(file, asked, console)
    if kind_of_file(file) == "log":
        why = f"{file}: is part of a log: its first line, of the kind open, is missing; give the whole log"
        raise InputError(why, file=str(file))
    if read_text(file, "JSON").lstrip().startswith(("{", "[")):
        _refuse_other_form(asked)
        _refuse_options(file, "a plan", asked, ("period", "cell"), (*SUFFIXES, URDF))
        return _plan_step(file, asked, console)
    if (kind := kind_of_file(file)) not in ("", "scene", "cell", "task", "program", "arm"):
        why = (
            f"{file}: is {KINDS[kind].words}; export takes a log, a plan, or a scene, cell, task or arm file"
        )
        raise InputError(why, file=str(file), kind=kind)
    if not kind:
        read_toml(file)  # what is no TOML is told as what it is
    _refuse_options(file, "a scene, cell, task or arm file", asked, ("look",), (URDF,))
    from cell.export.scene import surroundings_of_file
    from cell.program.program_file import doubts_of_file

    output = asked.output or file.with_name(f"{file.stem}_{URDF}")
    result = {"scene": str(file), **_urdf_step(surroundings_of_file(file, asked.look), output, console)}
    for doubt in doubts_of_file(file):
        console.say(f"NOTE: {doubt}")
    return result


def _refuse_other_form(asked: ExportOptions) -> None:
    """Refuse an output that is named as one of a format that was not asked for, where a table is written."""
    suffix = "" if asked.output is None or asked.form is not None else asked.output.suffix.lower()
    for form, ends in (("trajectory", ".json"), ("mcap", ".mcap"), (URDF, ".urdf")):
        if suffix == ends:
            why = f"{asked.output}: is of --format {form}, which is not given; without it a table (.csv) is written"
            raise InputError(why, file=str(asked.output))


def _refuse_options(
    file: Path, kind: str, asked: ExportOptions, fitting: tuple[str, ...], forms: tuple[str, ...]
) -> None:
    if asked.form is not None and asked.form not in forms:
        why = f"--format {asked.form}: must be one of {', '.join(forms)}, as {file} is {kind}"
        raise InputError(why, value=asked.form, choices=list(forms))
    for name in ("planned", "unit", "period", "cell", "look"):
        if name not in fitting and getattr(asked, name) not in (None, False):
            raise InputError(f"--{name} does not go with {kind} ({file})", option=name)


def _plan_step(file: Path, asked: ExportOptions, console: Console) -> dict[str, Any]:
    from cell.export.plan import csv_of, joints_of, messages_of, sampled, trajectory_of
    from cell.export.scene import surroundings_of_plan, unit_of_plan
    from cell.program.program_file import place_of_file

    plan, form = read_plan(file), asked.form or "csv"
    place = None if asked.cell is None else place_of_file(asked.cell)
    if form == URDF:
        if asked.period is not None:
            raise InputError("--period does not go with --format urdf", option="period")
        output = asked.output or file.with_name(f"{file.stem}_{URDF}")
        summary = _urdf_step(surroundings_of_plan(file, plan, place), output, console)
        return {"plan": str(file), "plan_sha256": plan.sha256, **summary}
    unit = unit_of_plan(file, plan, place)
    if form == "trajectory" and asked.period is not None:
        why = "--period does not go with --format trajectory, which has the ends of segments"
        raise InputError(why, option="period")
    path = asked.output or file.with_suffix(SUFFIXES[form])
    keep_apart(path, file, asked.cell, kind=_KINDS[form])
    keep_unread(path)
    period = PERIOD_S if asked.period is None else asked.period
    if form == "csv":
        samples = sampled(plan, unit, period)
        content: bytes | str = csv_of(samples, joints_of(plan))
        counted: dict[str, Any] = {"samples": len(samples.time_s)}
    elif form == "trajectory":
        content, counted = _points(trajectory_of(plan, unit))
    else:
        content, counted = _messages(
            [*messages_of(plan, unit, period), *_cell_of_plan(file, plan, place, period, console)]
        )
    summary = {"plan": str(file), "plan_sha256": plan.sha256, "format": form, "unit": unit.name}
    return _write(path, content, summary, counted | {"damaged": 0}, console)


def _cell_of_plan(
    file: Path, plan: Plan, place: Task | ArmFile | None, period: float, console: Console
) -> list[Message]:
    """Return what shows the cell of a plan; nothing, with a word why, if its task is not found."""
    from cell.export.foxglove import messages_of_plan
    from cell.export.scene import arm_of_plan, require_arm_of_plan
    from cell.program.find_task import task_or_none
    from cell.program.program_file import place_of_file

    try:
        found = task_or_none(file, plan, None) if place is None else None
        arm = arm_of_plan(file, plan, place if found is None else place_of_file(found))
        require_arm_of_plan(file, plan, arm)
    except A465Error as error:
        if place is not None:
            raise
        console.say(f"the cell is not shown: {error}")
        return []
    return messages_of_plan(plan, arm, period)


def _points(trajectory: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    text = json.dumps(trajectory, separators=(",", ":"), allow_nan=False) + "\n"
    return text, {"points": len(trajectory["points"])}


def _messages(messages: Sequence[Message]) -> tuple[bytes, dict[str, Any]]:
    from cell.export.mcap import mcap_of

    content, topics = mcap_of(messages)
    return content, {"messages": topics}


def _write(
    path: Path, content: bytes | str, source: dict[str, Any], counted: dict[str, Any], console: Console
) -> dict[str, Any]:
    """Write the file, print what it contains, and return the summary."""
    write_atomic(path, content)
    number = counted.get("samples", counted.get("points", sum(counted.get("messages", {}).values())))
    what = {"csv": "samples", "trajectory": "points", "mcap": "messages"}[source["format"]]
    damaged = f"; {counted['damaged']} damaged records left out" if counted["damaged"] else ""
    of = "" if source["unit"] == NO_UNIT else f" of {source['unit']}"
    console.say(f"{number} {what}{of} in {path}{damaged}")
    return {**source, "file": str(path), **counted, "bytes": path.stat().st_size}


def _urdf_step(there: Surroundings, output: Path, console: Console) -> dict[str, Any]:
    from cell.export.folder import write_folder
    from cell.export.urdf import describe

    if named_as_file(output):
        why = f"{output}: must be a folder, in which {URDF} writes cell.urdf and cell.srdf; give another name"
        raise InputError(why, file=str(output))
    made = describe(there)
    write_folder(output, made.files)
    console.say(
        f"the arm and {len(made.links)} bodies in {output}: {', '.join(sorted(made.files))}; "
        f"{len(made.disabled)} disabled collisions"
    )
    if there.padding:
        console.say(f"the scene's padding of {1e3 * there.padding:g} mm is not exported: URDF cannot hold it")
    padded = there.paddings()
    if padded:
        shown = ", ".join(f"{name} {1e3 * padding:g}" for name, padding in padded.items())
        console.say(f"paddings of single bodies are not exported, in mm: {shown}")
    return {
        "format": URDF,
        "folder": str(output),
        "files": sorted(made.files),
        "links": dict(made.links),
        "disabled_pairs": len(made.disabled),
        "padding_mm": 1e3 * there.padding,
        "paddings_mm": {name: 1e3 * padding for name, padding in padded.items()},
    }


def _log_step(log: Path, asked: ExportOptions, console: Console) -> dict[str, Any]:
    form = asked.form or "csv"
    if asked.planned and form != "trajectory":
        raise InputError(f"--planned goes with --format trajectory only, not {form}", format=form)
    if asked.cell is not None and form != "mcap":
        raise InputError(f"--cell goes with --format mcap only, not {form}", format=form)
    session = read_log(log)
    unit = unit_of(session, asked.unit)
    path = asked.output or log.with_suffix(SUFFIXES[form])
    keep_apart(path, log, kind=_KINDS[form])
    if form == "csv":
        samples = executed(session, unit)
        content: bytes | str = csv_text(samples)
        counted: dict[str, Any] = {"samples": len(samples.time_s), "before_homing": samples.unhomed}
    elif form == "trajectory":
        content, counted = _points((_sent if asked.planned else _sampled)(session, unit))
        counted = {"planned": asked.planned, **counted}
    else:
        from cell.export.mcap import messages_of

        samples = executed(session, unit)
        shown = _cell_of_log(session, samples, asked.cell, console)
        content, counted = _messages([*messages_of(session, samples, planned(session, unit)), *shown])
    counted |= {
        "motions": len(session.motions),
        "plans_sha256": [note.data.get("sha256") for note in session.noted("plan")],
        "damaged": session.damaged,
    }
    return _write(path, content, {"log": str(log), "format": form, "unit": unit.name}, counted, console)


def _cell_of_log(session: Session, samples: Executed, cell: Path | None, console: Console) -> list[Message]:
    """Return what shows the cell of a log; without the arm, with a word why, if its task is not found."""
    from cell.export.foxglove import Image, image_message, messages_of_log
    from cell.files.task import cell_of

    folder, images = session.file.resolve().parent, []
    for note in session.noted("look"):
        picture = folder / str(note.data.get("picture"))
        if picture.parent == folder and picture.is_file():
            images.append(image_message(Image(note.time_s, "png", picture.read_bytes())))
    noted = [folder / str(note.data["task"]) for note in session.noted("run") if "task" in note.data]
    file = noted[-1] if cell is None and noted else cell
    if file is None:
        console.say("the cell is not shown: the log names no task; give --cell FILE")
        return images
    try:
        place = cell_of(file)
    except A465Error as error:
        if cell is not None:
            raise
        console.say(f"the cell is not shown: {error}; give --cell FILE")
        return images
    plans = []
    for note in session.noted("plan"):
        kept = folder / str(note.data.get("file"))
        if kept.parent == folder and kept.is_file():
            plans.append((note.time_s, read_plan(kept)))
    if any(plan.scene.get("robot_open") != place.robot().digest for _, plan in plans):
        console.say(
            f"NOTE: {file}: its arm or tool is not that of the log's plans; shown is what the file describes"
        )
    return [*images, *messages_of_log(session, samples, place, plans)]


def csv_text(samples: Executed) -> str:
    """Return one line per sample. ``motion`` and ``segment`` count from 0; they are empty at rest or if unknown.

    The digits of an angle resolve less than a count. Jaws are 0 open to 1 closed, and empty before their first reading.
    """
    header = ["time_s", "motion", "segment", *(f"{name}_deg" for name in JOINTS), "jaws_fraction_closed"]
    degrees = np.degrees(samples.q)
    lines = [",".join(header)]
    for i, time_s in enumerate(samples.time_s):
        numbers = ["" if n < 0 else str(n) for n in (samples.motion[i], samples.segment[i])]
        jaws = f"{samples.jaws[i]:.4f}" if math.isfinite(samples.jaws[i]) else ""
        lines.append(",".join([f"{time_s:.6f}", *numbers, *(f"{d:.5f}" for d in degrees[i]), jaws]))
    return "\n".join(lines) + "\n"


def _sampled(session: Session, unit: Unit) -> dict[str, Any]:
    """The sampled positions as one trajectory."""
    samples = executed(session, unit)
    return joint_trajectory(samples.time_s, samples.q, samples.velocity, float(samples.time_s[0]))


def _sent(session: Session, unit: Unit) -> dict[str, Any]:
    """All motions sent, as one trajectory; a rest between two motions has both of their end points."""
    motions = planned(session, unit)
    if not motions:
        why = f"{session.file}: has no motion with a known start, so there is no planned trajectory"
        raise InputError(why, file=str(session.file))
    time_s = np.concatenate([m.time_s for m in motions])
    q = np.concatenate([m.q for m in motions])
    parts = [m.velocity for m in motions if m.velocity is not None]
    velocity = np.concatenate(parts) if len(parts) == len(motions) else None
    return joint_trajectory(time_s, q, velocity, float(time_s[0]))
