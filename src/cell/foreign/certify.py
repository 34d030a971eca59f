"""``a465 certify``: prove or refute a trajectory that another program made."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from arm.arguments import shown
from arm.controller.segments import cubic_position_range
from arm.controller.unit import Limits
from arm.errors import ImpossibleError, InputError
from arm.io.storage import keep_apart
from arm.plan_file import write_plan
from arm.robot.model import Robot
from arm.se3 import Array
from cell.config.arm_file import ArmFile
from cell.console import Console
from cell.export.scene import surroundings_of_file
from cell.files.observation import read_observation
from cell.foreign.sendable import plan_of_trajectory
from cell.foreign.trajectory_file import JointTrajectory, read_trajectory
from cell.program.program_file import ProgramTask, place_of_file
from cell.session.speed import planning_speed
from cell.task.pose_list_planning import ListPlace, place_of_arm, place_of_cell
from plan.collision.bezier import Curve
from plan.collision.certificate import ClearanceCertificate, certify_curve
from plan.collision.world import World
from plan.failure import nearness
from plan.trajectory.extremes import cubic_peaks

MOST_CLEARANCE = 1.0  # m
PARTS = 8  # into which what is not decided at once is cut


@dataclass(frozen=True, eq=False)
class Peaks:
    """Largest shares of the limits that a trajectory needs, each (n,); 1 is the limit.

    Attributes:
        velocity, acceleration: of each joint; acceleration NaN where joints move on straight lines with corners.
        beyond: by how much positions are beyond their limits, rad (m); at most 0 if they are not.
    """

    velocity: Array
    acceleration: Array
    beyond: Array


def peaks_of(trajectory: JointTrajectory, limits: Limits) -> Peaks:
    """Return the shares of limits that a trajectory needs, exactly, between its points too."""
    a, lasts = trajectory.coefficients, np.diff(trajectory.times)[:, None]
    low, high = trajectory.q[:-1] + cubic_position_range(a)
    velocity, acceleration, _ = cubic_peaks(a, lasts)
    beyond = np.maximum(limits.lower - low.min(axis=0), high.max(axis=0) - limits.upper)
    push = acceleration.max(axis=0) / limits.acceleration
    if trajectory.velocity is None:
        push = np.full_like(push, np.nan)
    return Peaks(velocity.max(axis=0) / limits.velocity, push, beyond)


def certified(world: World, curve: Curve, clearance: float) -> ClearanceCertificate:
    """Prove or refute the clearance of a chain of cubics, each apart where it is not decided as a whole.

    A certificate that is not proved and has seen no distance below the clearance is undecided.
    """
    whole = certify_curve(world, curve, clearance, tight=True)
    if whole.proved or whole.seen < clearance:
        return whole
    begins = np.concatenate([[0.0], curve.ends[:-1]])
    open_ = np.flatnonzero(np.array(whole.bounds) < clearance)
    found = whole
    bounds = np.array(whole.bounds)
    for k in open_:
        part = _cut(curve.control[k], begins[k], curve.ends[k])
        check = certify_curve(world, part, clearance, tight=False)
        bounds[k] = check.clearance
        if check.seen < found.seen:
            found = replace(found, seen=check.seen, pair=check.pair, time=begins[k] + check.time)
        if found.seen < clearance:
            break
    least = min(float(bounds.min()), found.seen)
    return replace(found, clearance=least, proved=least >= clearance, bounds=tuple(bounds.tolist()))


def _cut(control: Array, begin: float, end: float) -> Curve:
    """Return a cubic (4, n) as `PARTS` cubics; time from its begin."""
    cuts = np.linspace(0.0, 1.0, PARTS + 1)
    p0, p1, p2, p3 = control
    a1, a2, a3 = 3.0 * (p1 - p0), 3.0 * (p0 - 2.0 * p1 + p2), p3 - 3.0 * p2 + 3.0 * p1 - p0
    parts = []
    for u, v in pairwise(cuts):
        h = v - u
        start = p0 + u * (a1 + u * (a2 + u * a3))
        b1, b2, b3 = h * (a1 + u * (2.0 * a2 + 3.0 * u * a3)), h**2 * (a2 + 3.0 * u * a3), h**3 * a3
        parts.append([start, start + b1 / 3.0, start + (2.0 * b1 + b2) / 3.0, start + b1 + b2 + b3])
    return Curve(np.array(parts), cuts[1:] * (end - begin))


@dataclass(frozen=True, eq=False)
class _Place:
    """What a trajectory is judged in; `sendable` is None for a scene file, whose arm has no plan."""

    world: World
    robot: Robot
    limits: Limits
    clearance: float
    speed: float
    sendable: ListPlace | None


def certify_step(
    trajectory_file: Path,
    place_file: Path,
    look: Path | None,
    clearance: float | None,
    speed: float | None,
    output: Path | None,
    console: Console,
) -> dict[str, Any]:
    """Judge a trajectory, write it as a plan if asked, and return the verdict as JSON types.

    Args:
        trajectory_file: see `cell.foreign.trajectory_file`.
        place_file: scene, cell, task, program or arm file.
        look: boards and cubes to add to a cell or task.
        clearance: required, m; default: that of the cell, program or arm file, 0 of a scene.
        speed: allowed fraction of the limits, see `cell.session.speed`; default: that of the file, 1 of a scene.
        output: plan file to write; its motion is certified again, in whole counts.

    Raises:
        InputError: a file or value is wrong.
        ImpossibleError: the trajectory is refuted (data: pair, distance_m, time_s), undecided, beyond a limit, or
            cannot be sent.
    """
    if output is not None:
        keep_apart(output, trajectory_file, place_file, look)
    if clearance is not None and not 0.0 <= clearance <= MOST_CLEARANCE:
        rule = f"must be from 0 to {1e3 * MOST_CLEARANCE:g} mm"
        raise InputError(f"--clearance-mm = {shown(1e3 * clearance)}: {rule}", option="--clearance-mm")
    place = _place(place_file, look, clearance, speed)
    if output is not None and place.sendable is None:
        why = f"--output needs a cell, task or arm file; a plan states unit and q_start, which {place_file} lacks"
        raise InputError(why, option="--output")
    trajectory = read_trajectory(trajectory_file, place.robot.joint_names)
    peaks = peaks_of(trajectory, place.limits)
    check = certified(place.world, trajectory.curve, place.clearance)
    _print(trajectory, place, peaks, check, console)
    _require(trajectory_file, place, peaks, check)
    if check.pair[0]:
        at = f"{check.pair[0]} - {check.pair[1]} {check.time:.2f} s after the start"
        proved = f"{1e3 * check.clearance:.2f} mm all along (required: {1e3 * place.clearance:g} mm)"
        console.say(f"clear: at least {proved}; closest {at}")
    result = {
        "trajectory": str(trajectory_file),
        "points": len(trajectory.times),
        "between_points": "lines" if trajectory.velocity is None else "cubics",
        "motion_s": trajectory.duration,
        "verdict": "clear",
        "required_mm": 1e3 * place.clearance,
        "proved_mm": _millimetres(check.clearance),
        "seen_mm": _millimetres(check.seen),
        "closest": list(check.pair),
        "closest_at_s": check.time,
        "velocity_share": [float(v) for v in peaks.velocity],
        "acceleration_share": None if trajectory.velocity is None else [float(v) for v in peaks.acceleration],
        "plan": None,
    }
    if output is not None and place.sendable is not None:
        plan = plan_of_trajectory(trajectory_file, trajectory, place.sendable, place.clearance)
        write_plan(output, plan)
        console.say(f"plan {plan.sha256[:12]} written to {output}")
        away = np.abs(trajectory.q[0] - place.sendable.q_start).max()
        if away > 1.0 / np.abs(place.sendable.unit.counts_per_rad).min():
            console.say(
                "it does not begin at q_start, where execution begins: it can be previewed, not executed"
            )
        result |= {"plan": str(output), "plan_sha256": plan.sha256}
    return result


def _place(file: Path, look: Path | None, clearance: float | None, speed: float | None) -> _Place:
    """Read what a trajectory is judged in."""
    found = surroundings_of_file(file, look)
    if "q_start" not in found.states:  # of a scene file
        if speed is not None:
            raise InputError(
                f"--speed does not go with a scene file ({file}), which has no speed", option="--speed"
            )
        world = World(found.robot, found.bodies, found.held, found.T_tool_held, found.allowed, found.padding)
        return _Place(world, found.robot, found.limits, clearance or 0.0, 1.0, None)
    place = place_of_file(file)
    asked = planning_speed(place if isinstance(place, ArmFile) else place.cell, speed)
    world = World(found.robot, found.bodies)
    if isinstance(place, ArmFile):
        listed = place_of_arm(place, asked)
    else:
        seen = None if look is None else read_observation(look, place.cell.boards)
        listed = place_of_cell(place, seen, asked)
    required = place.required if isinstance(place, ProgramTask) else listed.options.clearance
    sendable = None if isinstance(place, ProgramTask) else listed
    least = required if clearance is None else clearance
    return _Place(world, found.robot, found.limits.scaled(asked), least, asked, sendable)


def _print(
    trajectory: JointTrajectory, place: _Place, peaks: Peaks, check: ClearanceCertificate, console: Console
) -> None:
    lines = trajectory.velocity is None
    rows = [
        (
            name,
            100.0 * peaks.velocity[k],
            None if lines else 100.0 * peaks.acceleration[k],
            float(peaks.beyond[k]) <= 0.0,
        )
        for k, name in enumerate(place.robot.joint_names)
    ]
    console.table(("joint", "% of velocity", "% of acceleration", "within limits"), rows)
    between = "straight lines" if lines else "cubics"
    console.say(f"{len(trajectory.times)} points, {between} between them, {trajectory.duration:.2f} s")
    if lines:
        console.say("without velocities the joints have corners at the points: accelerations are not judged")


def _require(file: Path, place: _Place, peaks: Peaks, check: ClearanceCertificate) -> None:
    """Require that limits and clearance are kept.

    Raises:
        ImpossibleError: they are not, or it is not decided.
    """
    joints = place.robot.joint_names
    if (peaks.beyond > 1e-9).any():
        joint = int(peaks.beyond.argmax())
        why = f"{file}: {joints[joint]} is beyond its position limits by {peaks.beyond[joint]:.3g} rad (m)"
        raise ImpossibleError(
            why, verdict="beyond limits", joint=joints[joint], beyond=float(peaks.beyond[joint])
        )
    for what, share in (("velocity", peaks.velocity), ("acceleration", peaks.acceleration)):
        joint = int(np.nan_to_num(share).argmax())
        if share[joint] > 1.0 + 1e-9:
            slower = share[joint] if what == "velocity" else np.sqrt(share[joint])
            needs = f"{100.0 * share[joint]:.0f} % of its {what} limit at speed {place.speed:g}"
            why = (
                f"{file}: {joints[joint]} needs {needs}; make the trajectory {slower:.2f} times as slow"
                f"{'' if place.speed == 1.0 else ', or give --speed'}"
            )
            raise ImpossibleError(
                why, verdict="beyond limits", joint=joints[joint], limit=what, share=float(share[joint])
            )
    if check.proved:
        return
    if check.seen < place.clearance:
        near = nearness(check.pair, check.seen, place.clearance)
        why = f"{file}: refuted: {check.time:.3f} s after the start {near}"
        verdict = "refuted"
    else:
        verdict = "undecided"
        why = (
            f"{file}: undecided: {1e3 * check.clearance:.2f} mm are proved, {1e3 * place.clearance:g} mm are required, "
            f"and nothing nearer than {1e3 * check.seen:.2f} mm was seen; give a lower --clearance-mm"
        )
    raise ImpossibleError(
        why,
        verdict=verdict,
        pair=list(check.pair),
        distance_m=check.seen,
        proved_m=check.clearance,
        time_s=check.time,
    )


def _millimetres(distance: float) -> float | None:
    return 1e3 * distance if np.isfinite(distance) else None
