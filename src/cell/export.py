"""``a465 export``: a wire log as CSV, as a ROS 2 JointTrajectory in JSON, or as MCAP."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from arm.errors import InputError
from arm.files import keep_apart, write_atomic
from arm.unit import Unit
from cell.console import Console
from cell.exportros import joint_trajectory
from cell.exportseries import Executed, executed, planned, unit_of
from driver.logfile import Session, read_log

SUFFIXES = {"csv": ".csv", "trajectory": ".trajectory.json", "mcap": ".mcap"}
JOINTS = ("J1", "J2", "J3", "J4", "J5", "J6")  # of the arm's URDF


def export_step(
    log: Path, form: str, output: Path | None, sent: bool, unit_name: str | None, console: Console
) -> dict[str, Any]:
    """Write a log in another form; what was written, as JSON types.

    Args:
        log: the wire log.
        form: csv, trajectory or mcap.
        output: file to write, whole or not at all; default: beside the log.
        sent: of a trajectory: what was sent, instead of where the arm was seen.
        unit_name: of the unit; default: what the log tells.

    Raises:
        InputError: no log, nothing in it, a form that is none, a library that is missing, or the file cannot be
            written.
    """
    if form not in SUFFIXES:
        raise InputError(
            f"--format {form}: must be one of {', '.join(SUFFIXES)}", value=form, choices=list(SUFFIXES)
        )
    if sent and form != "trajectory":
        raise InputError(f"--planned goes with --format trajectory only, not {form}", format=form)
    session = read_log(log)
    unit = unit_of(session, unit_name)
    path = output or log.with_suffix(SUFFIXES[form])
    keep_apart(path, log)
    told: dict[str, Any] = {"log": str(log), "format": form, "unit": unit.name, "file": str(path)}
    if form == "trajectory":
        trajectory = _sent(session, unit) if sent else _seen(executed(session, unit))
        content: str | bytes = json.dumps(trajectory, separators=(",", ":"), allow_nan=False) + "\n"
        told |= {"planned": sent, "points": len(trajectory["points"])}
    elif form == "csv":
        seen = executed(session, unit)
        content = csv_text(seen)
        told |= {"samples": len(seen.time_s), "before_homing": seen.unhomed}
    else:
        from cell.exportmcap import mcap_bytes

        seen, motions = executed(session, unit), planned(session, unit)
        content, counted = mcap_bytes(session, JOINTS, seen, motions)
        told |= {"messages": counted}
    write_atomic(path, content)
    told |= {
        "motions": len(session.motions),
        "plans_sha256": [note.data.get("sha256") for note in session.noted("plan")],
        "damaged": session.damaged,
        "bytes": path.stat().st_size,
    }
    console.say(_phrase(told))
    return told


def _phrase(told: dict[str, Any]) -> str:
    count = told.get("samples", told.get("points", sum(told.get("messages", {}).values())))
    what = {"csv": "samples", "trajectory": "points", "mcap": "messages"}[told["format"]]
    damaged = f"; {told['damaged']} damaged records left out" if told["damaged"] else ""
    return f"{count} {what} of {told['unit']} in {told['file']}{damaged}"


def csv_text(seen: Executed) -> str:
    """A line a sample. ``motion`` and ``segment`` count from 0 and are empty where the arm rests or it is not known.

    Angles are given finer than a count; jaws are 0 open to 1 closed, empty until asked.
    """
    header = ["time_s", "motion", "segment", *(f"{name}_deg" for name in JOINTS), "jaws_fraction_closed"]
    degrees = np.degrees(seen.q)
    lines = [",".join(header)]
    for i, time_s in enumerate(seen.time_s):
        numbers = ["" if n < 0 else str(n) for n in (seen.motion[i], seen.segment[i])]
        jaws = f"{seen.jaws[i]:.4f}" if math.isfinite(seen.jaws[i]) else ""
        lines.append(",".join([f"{time_s:.6f}", *numbers, *(f"{d:.5f}" for d in degrees[i]), jaws]))
    return "\n".join(lines) + "\n"


def _seen(seen: Executed) -> dict[str, Any]:
    return joint_trajectory(JOINTS, seen.time_s, seen.q, seen.velocity, float(seen.time_s[0]))


def _sent(session: Session, unit: Unit) -> dict[str, Any]:
    """All motions in one; where the arm rests between two, their ends are both there."""
    motions = planned(session, unit)
    if not motions:
        raise InputError(
            f"{session.file}: holds no motion with a known start, so nothing was planned",
            file=str(session.file),
        )
    time_s = np.concatenate([m.time_s for m in motions])
    q = np.concatenate([m.q for m in motions])
    parts = [m.velocity for m in motions if m.velocity is not None]
    velocity = np.concatenate(parts) if len(parts) == len(motions) else None
    return joint_trajectory(JOINTS, time_s, q, velocity, float(time_s[0]))
