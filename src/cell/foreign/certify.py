"""``a465 certify``: prove or refute a trajectory that another program made."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from arm.arguments import shown
from arm.controller.unit import Limits
from arm.errors import ImpossibleError, InputError
from arm.io.kind import kind_of_file
from arm.io.outputs import keep_apart, keep_page
from arm.io.storage import keep_unread
from arm.plan_file import write_plan
from arm.robot.model import Robot
from cell.config.arm_file import ArmFile
from cell.config.cell import Cell
from cell.console import Console
from cell.export.scene import surroundings_of_file
from cell.files.observation import read_observation
from cell.files.task import Task
from cell.foreign.judge import (
    CLEAR,
    REFUTED,
    UNDECIDED,
    Asked,
    Peaks,
    certified,
    first_lost,
    peaks_of,
    refusal_of,
)
from cell.foreign.sendable import plan_of_trajectory, shown_plan
from cell.foreign.trajectory_file import JointTrajectory, read_trajectory
from cell.program.program_file import ProgramTask, place_of_file
from cell.session.speed import planning_speed
from cell.task.pose_list_planning import ListPlace, place_of_arm, place_of_cell
from plan.collision.certificate import ClearanceCertificate
from plan.collision.world import World
from plan.trajectory.virtual_unit import is_virtual

MOST_CLEARANCE = 1.0  # m
LEAST_CLEARANCE_MM = 0.1  # that anyone asks for; less is a length in m
_NO_LOOK = (
    "boards and cubes are not among the bodies, only the table and the walls; add them with --look FILE"
)


@dataclass(frozen=True, eq=False)
class _Place:
    """What a trajectory is judged in; scenes and programs have no `sendable` place, scenes and arm files no `cell`.

    Attributes:
        remarks: what a verdict in it does not say, a line each.
    """

    world: World
    robot: Robot
    limits: Limits
    asked: Asked
    sendable: ListPlace | None
    cell: Cell | None = None
    remarks: tuple[str, ...] = ()


def certify_step(
    trajectory_file: Path,
    place_file: Path,
    look: Path | None,
    clearance: float | None,
    speed: float | None,
    output: Path | None,
    page: Path | None,
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
        page: preview to write, also of a refused trajectory: it opens at the refused moment, with both bodies in red.

    Raises:
        InputError: a file or value is wrong.
        ImpossibleError: the trajectory is refuted (data: pair, distance_m, time_s), undecided, beyond a limit, or
            cannot be sent.
    """
    if trajectory_file.suffix == ".toml" and kind_of_file(place_file) == "trajectory":
        why = f"{place_file} is a trajectory, which comes first: give a465 certify {place_file} {trajectory_file}"
        raise InputError(why, file=str(place_file))
    keep_apart(output, trajectory_file, place_file, look, kind="plan")
    keep_page(page, trajectory_file, place_file, look)
    keep_unread(output, page)
    if output is not None and page is not None and output.resolve() == page.resolve():
        raise InputError(f"--output and --page are the same file, {output}; must be two", option="--page")
    if clearance is not None and not 0.0 <= clearance <= MOST_CLEARANCE:
        rule = f"must be from 0 to {1e3 * MOST_CLEARANCE:g} mm"
        raise InputError(f"--clearance-mm = {shown(1e3 * clearance)}: {rule}", option="--clearance-mm")
    if clearance is not None and 0.0 < 1e3 * clearance < LEAST_CLEARANCE_MM:
        rule = f"is in mm: must be 0, or from {LEAST_CLEARANCE_MM:g} to {1e3 * MOST_CLEARANCE:g}"
        raise InputError(f"--clearance-mm {shown(1e3 * clearance)}: {rule}", option="--clearance-mm")
    place = _place(place_file, look, clearance, speed)
    if (output is not None or page is not None) and place.sendable is None:
        option = "--page" if output is None else "--output"
        if place.cell is not None:
            why = (
                f"{option} needs a cell, task or arm file; {place_file} is a program: give {place.cell.file}"
            )
            raise InputError(why, option=option)
        why = f"{option} needs a cell, task or arm file; a plan states unit and q_start, which {place_file} lacks"
        raise InputError(why, option=option)
    if kind_of_file(trajectory_file) == "samples":
        why = f"{trajectory_file}: is a table of samples; a465 export --format trajectory writes what certify takes"
        raise InputError(why, file=str(trajectory_file))
    trajectory = read_trajectory(trajectory_file, place.robot.joint_names)
    peaks = peaks_of(trajectory, place.limits)
    if output is not None and trajectory.velocity is None:
        why = f"--output needs points with velocities, which {trajectory_file} lacks: the arm would stop at corners"
        raise InputError(why, option="--output")
    check = certified(place.world, trajectory.curve, place.asked.clearance)
    if check.seen < place.asked.clearance:
        check = first_lost(place.world, trajectory, place.asked.clearance, check)
    _print(trajectory, place, peaks, check, console)
    if trajectory.times[0] > 0.0:
        late = f"its first point is at {trajectory.times[0]:g} s, and the way there is not judged"
        console.say(f"NOTE: {trajectory_file}: {late}")
    if doubt := peaks.slow():
        console.say(f"NOTE: {trajectory_file}: {doubt}")
    refusal = refusal_of(trajectory_file, place.robot.joint_names, place.asked, peaks, check)
    plan = None
    if output is not None and refusal is None and place.sendable is not None:
        plan = plan_of_trajectory(trajectory_file, trajectory, place.sendable, place.asked.clearance)
        write_plan(output, plan)
    if page is not None:
        _write_page(page, trajectory_file, trajectory, place, check, refusal)
        console.say(f"open {page} in a browser")
    for remark in place.remarks:
        console.say(remark)
    if refusal is not None:
        raise refusal
    if check.pair[0]:
        at = f"{check.pair[0]} - {check.pair[1]} {check.time:.2f} s after the start"
        proved = f"{1e3 * check.clearance:.2f} mm all along (required: {1e3 * place.asked.clearance:g} mm)"
        console.say(f"clear: at least {proved}; closest {at}")
    result = {
        "trajectory": str(trajectory_file),
        "points": len(trajectory.times),
        "between_points": "lines" if trajectory.velocity is None else "cubics",
        "motion_s": trajectory.duration,
        "verdict": CLEAR,
        "required_mm": 1e3 * place.asked.clearance,
        "proved_mm": _millimetres(check.clearance),
        "seen_mm": _millimetres(check.seen),
        "closest": list(check.pair),
        "closest_at_s": check.time,
        "velocity_share": [float(v) for v in peaks.velocity],
        "acceleration_share": None if peaks.acceleration is None else [float(v) for v in peaks.acceleration],
        "plan": None,
        "page": None if page is None else str(page),
    }
    if plan is not None and place.sendable is not None:
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
        return _Place(world, found.robot, found.limits, Asked(clearance or 0.0, 1.0, True), None)
    place = place_of_file(file)
    asked = planning_speed(place if isinstance(place, ArmFile) else place.cell, speed)
    world = World(found.robot, found.bodies)
    if isinstance(place, ArmFile):
        listed = place_of_arm(place, asked)
    else:
        seen = None if look is None else read_observation(look, place.cell)
        listed = place_of_cell(place, seen, asked)
    required = place.required if isinstance(place, ProgramTask) else listed.options.clearance
    sendable = None if isinstance(place, ProgramTask) else listed
    least = required if clearance is None else clearance
    cell = None if isinstance(place, ArmFile) else place.cell
    remarks = []
    if isinstance(place, Task) and not isinstance(place, ProgramTask) and look is None:
        remarks.append(_NO_LOOK)
    remarks.extend(f"NOTE: {doubt}" for doubt in place.doubts())
    if least < required - 1e-9:  # the same mm may differ in the last digit in m
        remarks.append(
            f"the clearance of {1e3 * least:g} mm is less than the {1e3 * required:g} mm of {_clearance_key(place)}"
        )
    return _Place(
        world,
        found.robot,
        found.limits.scaled(asked),
        Asked(least, asked, not is_virtual(listed.unit)),
        sendable,
        cell,
        tuple(remarks),
    )


def _clearance_key(place: Task | ArmFile) -> str:
    """Return the key that states the clearance of a file, and the file."""
    if isinstance(place, ArmFile) or (isinstance(place, ProgramTask) and place.clearance is not None):
        return f"clearance_mm in {place.file}"
    return f"motion.clearance_mm in {place.cell.file}"


def _print(
    trajectory: JointTrajectory, place: _Place, peaks: Peaks, check: ClearanceCertificate, console: Console
) -> None:
    lines = trajectory.velocity is None
    rows = [
        (
            name,
            100.0 * peaks.velocity[k],
            None if peaks.acceleration is None else 100.0 * peaks.acceleration[k],
            float(peaks.beyond[k]) <= 0.0,
        )
        for k, name in enumerate(place.robot.joint_names)
    ]
    console.table(("joint", "% of velocity", "% of acceleration", "positions within limits"), rows)
    between = "straight lines" if lines else "cubics"
    console.say(f"{len(trajectory.times)} points, {between} between them, {trajectory.duration:.2f} s")
    if lines:
        console.say("without velocities the joints have corners at the points: accelerations are not judged")


def _write_page(
    page: Path,
    file: Path,
    trajectory: JointTrajectory,
    place: _Place,
    check: ClearanceCertificate,
    refusal: ImpossibleError | None,
) -> None:
    """Write the preview of a trajectory, with why it is refused."""
    from cell.preview.overlays import Refused
    from cell.preview.page import Drawn, write_preview

    listed, cell = place.sendable, place.cell
    if listed is None:
        return
    drawn = (
        Drawn() if cell is None else Drawn(boards=cell.boards, dictionary=cell.dictionary, camera=cell.camera)
    )
    if refusal is not None:
        near = refusal.data["verdict"] in (REFUTED, UNDECIDED)
        what = str(refusal).removeprefix(f"{file}: ")
        drawn["refused"] = Refused(what, check.time if near else 0.0, check.pair if near else ())
    arms = listed.scene.robot_open, listed.scene.robot_holding
    write_preview(shown_plan(file, trajectory, listed, check), *arms, listed.unit, page, **drawn)


def _millimetres(distance: float) -> float | None:
    return 1e3 * distance if np.isfinite(distance) else None
