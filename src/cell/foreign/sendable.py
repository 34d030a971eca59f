"""A trajectory of another program as a plan: cubics in whole counts and ms, certified as they would be sent."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from arm.controller.segments import CountPath, Segment
from arm.controller.unit import Counts
from arm.errors import ImpossibleError
from arm.io.storage import read_bytes, sha256
from arm.plan_file import Move, Plan
from cell.foreign.trajectory_file import JointTrajectory
from cell.task.pose_list_planning import ListPlace
from plan.collision.certificate import ClearanceCertificate, certify_move
from plan.collision.world import World
from plan.failure import nearness
from plan.motion.builder import rounded_down
from plan.program.goals.attachments import AttachmentState
from plan.program.planned import Planned, Reached
from plan.program.setting import Setting
from plan.trajectory.extremes import segment_extremes
from plan.trajectory.integer_segments import SHORTEST_MS
from plan.trajectory.rounding import round_chain

LONGEST_MS = 60_000  # of a segment in a plan file
LONGEST_S = 3600.0
REST = 1e-3  # rad/s (m/s), velocity at an end that counts as rest
DEVIATION = 5e-4  # rad (m), largest deviation of what is sent from the trajectory, besides a count


def plan_of_trajectory(file: Path, trajectory: JointTrajectory, place: ListPlace, clearance: float) -> Plan:
    """Return a plan with one move, the trajectory, for the arm with open jaws that carries nothing.

    Args:
        file: of the trajectory; named in messages, its hash is in the plan.
        trajectory: from rest to rest.
        place: the arm, what is around it, and the speed of the plan.
        clearance: required, m.

    Raises:
        ImpossibleError: it cannot be sent: no velocities, not from rest to rest, beyond limits once it is in whole
            counts, or points so close that the line could not send them; or it is too near to a body.
    """
    setting = Setting(place.scene, place.unit, place.limits, place.options)
    path = _sent(file, trajectory, setting)
    world = World(setting.robot, (*place.scene.bodies, *place.scene.cubes))
    check = certify_move(world, path, place.unit, clearance)
    if not check.proved:
        why = (
            f"{file}, in whole counts: {nearness(check.pair, check.seen, clearance)} after {check.time:.2f} s"
        )
        raise ImpossibleError(why, pair=list(check.pair), distance_m=check.seen, time_s=check.time)
    bounds = tuple(rounded_down(min(bound, check.seen)) for bound in check.bounds)
    opening = 0.0 if place.gripper is None else place.gripper.width(0.0)
    name = f"trajectory {file.stem}"
    move = Move(
        name,
        "transit",
        None,
        path,
        None,
        opening,
        rounded_down(check.clearance),
        check.pair,
        True,
        (),
        bounds,
    )
    first, last = place.unit.positions(np.array([path.start, path.end]))
    reached = Reached(name, last, setting.robot.T_base_tool(last), "")
    stated = place.provenance
    stated["notes"]["trajectory"] = sha256(read_bytes(file, "JSON"))
    task: dict[str, Any] = {
        "name": place.name,
        "kind": place.kind,
        "poses": [{"name": name, "q": [round(float(v), 9) + 0.0 for v in last]}],
    }
    nothing = AttachmentState(None, None, ())
    return Planned(
        setting, first, last, (move,), (reached,), 0.0, nothing, provenance=stated, task=task
    ).plan()


def shown_plan(
    file: Path, trajectory: JointTrajectory, place: ListPlace, check: ClearanceCertificate
) -> Plan:
    """Return a plan of a trajectory for a page, whether or not it is proved or could be sent.

    Its points are at whole ms and its motion is rounded to counts, so it differs from the trajectory by no more than
    one sees. Its move is certified if the trajectory is.
    """
    setting = Setting(place.scene, place.unit, place.limits, place.options)
    unit = place.unit
    knots = np.rint(1e3 * (trajectory.times - trajectory.times[0])).astype(np.int64)
    kept = np.append(True, np.diff(knots) > 0)
    ends = unit.counts(trajectory.q)[kept].astype(np.int64)
    lasts = np.diff(knots[kept])
    step = np.diff(ends, axis=0)
    rows: list[tuple[tuple[int, ...], ...]]
    if trajectory.velocity is None:
        rows = [(tuple(row),) for row in step.tolist()]
    else:
        rate = trajectory.velocity[kept] * unit.counts_per_rad
        begin, end = (
            np.rint(rate[part] * lasts[:, None] / 1e3).astype(np.int64)
            for part in (slice(-1), slice(1, None))
        )
        cubics = np.stack([begin, 3 * step - 2 * begin - end, begin + end - 2 * step], axis=1)
        rows = [tuple(map(tuple, one)) for one in cubics.tolist()]
    segments = tuple(Segment(ms, row) for ms, row in zip(lasts.tolist(), rows, strict=True))
    path = CountPath(tuple(ends[0].tolist()), segments)
    name, opening = f"trajectory {file.stem}", 0.0 if place.gripper is None else place.gripper.width(0.0)
    clearance = max(rounded_down(check.seen if not check.proved else check.clearance), 0.0)
    move = Move(name, "transit", None, path, None, opening, clearance, check.pair, check.proved)
    nothing, task = AttachmentState(None, None, ()), {"name": file.stem}
    first, last = trajectory.q[0], trajectory.q[-1]
    planned = Planned(setting, first, last, (move,), (), 0.0, nothing, provenance=place.provenance, task=task)
    return planned.plan()


def _sent(file: Path, trajectory: JointTrajectory, setting: Setting) -> CountPath:
    """Return the segments of a trajectory."""
    if trajectory.velocity is None:
        why = f"{file}: its points have no velocities, so the joints have corners there, at which the arm would stop"
        raise ImpossibleError(f"{why}; give velocities")
    names = setting.robot.joint_names
    for word, rate in (("begin", trajectory.velocity[0]), ("end", trajectory.velocity[-1])):
        if np.abs(rate).max() > REST:
            joint = names[int(np.abs(rate).argmax())]
            raise ImpossibleError(
                f"{file}: {joint} does not {word} at rest; a plan begins and ends there", joint=joint
            )
    if trajectory.duration > LONGEST_S:
        why = f"{file}: takes {trajectory.duration:.0f} s; a plan takes at most {LONGEST_S:g} s"
        raise ImpossibleError(why, duration_s=trajectory.duration)
    knots = _knots_ms(trajectory)
    if len(knots) < 2:
        why = f"{file}: takes {trajectory.duration:.3f} s; the controller needs at least {SHORTEST_MS} ms"
        raise ImpossibleError(why, duration_s=trajectory.duration)
    q, rate = trajectory.at(knots / 1e3)
    rate[[0, -1]] = 0.0
    unit = setting.unit
    a = round_chain(unit, setting.sent, knots, q, rate)
    rows = np.moveaxis(a, 1, 0).tolist()
    path = CountPath(
        tuple(int(c) for c in unit.counts(q[0])),
        tuple(Segment(int(ms), tuple(map(tuple, row))) for ms, row in zip(np.diff(knots), rows, strict=True)),
    )
    _require_limits(file, path, setting)
    times = np.union1d(trajectory.times - trajectory.times[0], np.arange(0.0, trajectory.duration, 0.01))
    off = np.abs(unit.positions(path.at(times)) - trajectory.at(times)[0]) - 1.0 / np.abs(unit.counts_per_rad)
    if off.max() > DEVIATION:
        k, joint = divmod(int(off.argmax()), off.shape[1])
        why = (
            f"{file}: {names[joint]} would be {off.max():.2g} rad (m) off {times[k]:.3f} s after the start, because "
            f"the controller takes no points closer than {SHORTEST_MS} ms; give a smoother trajectory"
        )
        raise ImpossibleError(why, joint=names[joint], off=float(off.max()), time_s=float(times[k]))
    return path


def _knots_ms(trajectory: JointTrajectory) -> Counts:
    """Return the times of its points, whole ms from the first, without those that follow another too soon."""
    times = np.rint(1e3 * (trajectory.times - trajectory.times[0])).astype(np.int64)
    end = int(times[-1])
    knots = [0]
    for time in (*times[1:-1].tolist(), end):
        while time - knots[-1] > LONGEST_MS:
            knots.append(knots[-1] + LONGEST_MS - SHORTEST_MS)
        if time == end or (time - knots[-1] >= SHORTEST_MS and end - time >= SHORTEST_MS):
            knots.append(time)
    return np.array(knots if end >= SHORTEST_MS else knots[:1], dtype=np.int64)


def _require_limits(file: Path, path: CountPath, setting: Setting) -> None:
    """Require that segments keep the limits at the plan's speed."""
    found, limits, names = segment_extremes(path, setting.unit), setting.sent, setting.robot.joint_names
    for what, excess in (
        ("velocity", found.velocity.max(axis=0) / limits.velocity),
        ("acceleration", found.acceleration.max(axis=0) / limits.acceleration),
    ):
        joint = int(excess.argmax())
        if excess[joint] > 1.0 + 1e-9:
            why = (
                f"{file}, in whole counts: {names[joint]} needs {100.0 * excess[joint]:.1f} % of its {what} limit at "
                f"speed {setting.options.speed:g}; make the trajectory slower by some per cent"
            )
            raise ImpossibleError(why, joint=names[joint], limit=what, share=float(excess[joint]))
