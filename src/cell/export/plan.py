"""Export a plan as a table, a ROS 2 JointTrajectory or MCAP: the planned motion, on a clock that starts with the plan.

A gripper step takes its settling time and a look takes no time. On the arm both may take longer, and the controller may
stretch any motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from arm.controller.segments import CountPath
from arm.controller.unit import Unit
from arm.errors import InputError
from arm.plan_file import GripperStep, LookStep, Move, Pause, Plan, Step
from arm.se3 import Array, frozen
from cell.export.ros import JOINTS, Message, joint_state, joint_trajectory, nanoseconds, stamp

PERIODS = (0.001, 10.0)  # s between rows
TICK = 1e-9  # s: tolerance for floats; steps and segments begin at whole milliseconds
_KINDS: dict[type, str] = {Move: "move", GripperStep: "gripper", LookStep: "look", Pause: "pause"}


@dataclass(frozen=True, eq=False)
class TimedStep:
    """One step of a plan on its clock.

    Attributes:
        step: of the plan.
        begin_s, end_s: beginning and end of the step.
        q: joint positions at the beginning of the step, (n,) rad (m for sliding joints).
        jaws: target of the jaws during the step, 0 open to 1 shut.
    """

    step: Step
    begin_s: float
    end_s: float
    q: Array
    jaws: float

    @property
    def path(self) -> CountPath | None:
        """Path of a move; None while the arm is at rest."""
        return self.step.path if isinstance(self.step, Move) else None

    def knots_s(self) -> Array:
        """Return the times at which segments begin, and the end."""
        at_rest = np.array([self.begin_s, self.end_s])
        return at_rest if self.path is None else self.begin_s + self.path.knot_times()


@dataclass(frozen=True, eq=False)
class Samples:
    """Joint positions at increasing times.

    Attributes:
        time_s: (m,) from the beginning of the plan.
        q, velocity: (m, n) rad, rad/s (m, m/s); where two segments meet, those of the later one.
        jaws: (m,) target, 0 open to 1 shut.
        step: (m,) names.
    """

    time_s: Array
    q: Array
    velocity: Array
    jaws: Array
    step: tuple[str, ...]


def timed_steps(plan: Plan, unit: Unit) -> tuple[TimedStep, ...]:
    """Return the plan's steps on its clock, in order."""
    found: list[TimedStep] = []
    now, jaws, q = 0.0, 0.0, unit.positions(plan.start)
    for step in plan.steps:
        end = now  # of a look, which takes no time
        if isinstance(step, Move):
            end += step.path.duration_s
        elif isinstance(step, GripperStep):
            end, jaws = now + step.settle_s, step.fraction_closed
        elif isinstance(step, Pause):
            end = now + step.dwell_s
        found.append(TimedStep(step, now, end, frozen(q), jaws))
        now = end
        if isinstance(step, Move):
            q = unit.positions(step.path.end)
    return tuple(found)


def sampled(plan: Plan, unit: Unit, period: float) -> Samples:
    """Sample a plan every `period` s and at the ends of segments.

    Raises:
        InputError: a period outside `PERIODS`, or a plan that takes no time.
    """
    if not PERIODS[0] <= period <= PERIODS[1]:
        why = f"--period {period:g}: must be from {PERIODS[0]:g} to {PERIODS[1]:g} s"
        raise InputError(why, period=period)
    parts = _lasting(plan, unit)
    grid = period * np.arange(int(np.floor(parts[-1].end_s / period)) + 1)
    return _at(parts, unit, np.concatenate([grid, *(part.knots_s() for part in parts)]))


def _lasting(plan: Plan, unit: Unit) -> list[TimedStep]:
    parts = [part for part in timed_steps(plan, unit) if part.end_s > part.begin_s]
    if not parts:
        raise InputError("the plan contains no motion, so there is nothing to export", motion_s=0.0)
    return parts


def _at(parts: Sequence[TimedStep], unit: Unit, times: Array) -> Samples:
    """Sample at times in any order. Times are rounded to a microsecond, duplicates dropped."""
    time_s = np.unique(np.round(times, 6))
    which = np.searchsorted([part.begin_s for part in parts], time_s + TICK, side="right") - 1
    shape = len(time_s), len(parts[0].q)
    q, velocity, jaws = np.empty(shape), np.zeros(shape), np.empty(len(time_s))
    for index, part in enumerate(parts):
        rows = which == index
        jaws[rows] = part.jaws
        q[rows] = part.q
        if part.path is not None:
            at = time_s[rows] - part.begin_s
            q[rows] = unit.positions(part.path.at(at))
            velocity[rows] = _velocity(part.path, at) / unit.counts_per_rad
    return Samples(
        frozen(time_s), frozen(q), frozen(velocity), frozen(jaws), tuple(parts[i].step.name for i in which)
    )


def _velocity(path: CountPath, times: Array) -> Array:
    """Counts/s at times (m,) s; where two segments meet, of the later one."""
    ends = path.knot_times()[1:]
    which = np.minimum(np.searchsorted(ends, times + TICK, side="right"), len(ends) - 1)
    found = np.zeros((len(times), len(path.start)))
    for index in np.unique(which):
        rows, segment = which == index, path.segments[index]
        lasts = segment.duration_ms / 1e3
        if lasts:
            found[rows] = segment.derivative(np.clip((times[rows] - ends[index]) / lasts + 1.0, 0.0, 1.0))
    return found


def joints_of(plan: Plan) -> dict[str, str]:
    """Return the unit of each joint's positions by the joint's name: rad, or m where it slides."""
    if not plan.arm:
        return dict.fromkeys(JOINTS, "rad")
    units = {"revolute": "rad", "prismatic": "m"}
    return {joint["name"]: units[joint["kind"]] for joint in plan.arm["open"]["joints"]}


def csv_of(samples: Samples, joints: Mapping[str, str]) -> str:
    """Return one line per sample; `joints` as of `joints_of`."""
    names = [f"{name}_{unit}{per_s}" for per_s in ("", "_s") for name, unit in joints.items()]
    lines = [",".join(["time_s", *names, "jaws_fraction_closed", "step"])]
    for i, time_s in enumerate(samples.time_s):
        numbers = [f"{v + 0.0:.9f}" for v in np.round([*samples.q[i], *samples.velocity[i]], 9)]
        step = '"' + samples.step[i].replace('"', '""') + '"'
        lines.append(",".join([f"{time_s:.6f}", *numbers, f"{samples.jaws[i]:.4f}", step]))
    return "\n".join(lines) + "\n"


def trajectory_of(plan: Plan, unit: Unit) -> dict[str, Any]:
    """Return a trajectory_msgs/JointTrajectory through the ends of all segments, with the gripper steps.

    Cubic interpolation of its positions and velocities gives the segments, within a count. Velocities are left out if
    they jump at the end of a segment. ``gripper_events`` is not a field of the message.

    Raises:
        InputError: a plan that takes no time.
    """
    events = [
        {
            "time_from_start": stamp(part.begin_s),
            "name": part.step.name,
            "fraction_closed": part.step.fraction_closed,
            "settle_s": part.step.settle_s,
        }
        for part in timed_steps(plan, unit)
        if isinstance(part.step, GripperStep)
    ]
    return {**_trajectory(_lasting(plan, unit), unit, tuple(joints_of(plan))), "gripper_events": events}


def _trajectory(parts: Sequence[TimedStep], unit: Unit, names: Sequence[str]) -> dict[str, Any]:
    """The trajectory of steps that each take time, from the first one's beginning."""
    ends = _at(parts, unit, np.concatenate([part.knots_s() for part in parts]))
    jumps = any(part.path is not None and part.path.has_velocity_jumps for part in parts)
    return joint_trajectory(ends.time_s, ends.q, None if jumps else ends.velocity, parts[0].begin_s, names)


def messages_of(plan: Plan, unit: Unit, period: float) -> list[Message]:
    """Return messages for `cell.export.mcap`: joints and jaws every `period` s, a trajectory per motion, step events.

    Raises:
        InputError: see `sampled`.
    """
    samples, names = sampled(plan, unit, period), tuple(joints_of(plan))
    found: list[Message] = []
    for time, q, velocity, jaws in zip(
        samples.time_s, samples.q, samples.velocity, samples.jaws, strict=True
    ):
        time_s = float(time)
        found.append((nanoseconds(time_s), "/joint_states", joint_state(time_s, q, velocity, names)))
        found.append((nanoseconds(time_s), "/jaws", {"fraction_closed": float(jaws)}))
    parts = timed_steps(plan, unit)
    for motion in plan.motions:
        moving = [p for p in parts[motion.first : motion.first + len(motion.moves)] if p.end_s > p.begin_s]
        if moving:
            found.append((nanoseconds(moving[0].begin_s), "/planned", _trajectory(moving, unit, names)))
    for part in parts:
        event = {"kind": "step", "data": {"name": part.step.name, "step": _KINDS[type(part.step)]}}
        found.append((nanoseconds(part.begin_s), "/events", event))
    return found
