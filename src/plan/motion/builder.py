"""One motion from rest to rest, as it will be sent: retract, transit and approach, joined without a stop.

The joined path is timed, converted to integer segments and certified phase by phase, each in its own world and with its
own clearance. Longer blends save time but come nearer to bodies, so the longest ones that are certified are used. If
none are, the arm stops at the way-points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.controller.segments import CountPath
from arm.controller.unit import Limits, Unit
from arm.errors import ImpossibleError
from arm.plan_file import Move
from arm.robot.model import Robot
from arm.robot.shapes import Box
from arm.se3 import Array, frozen
from plan.cartesian.line import JointPath, Line
from plan.collision.certificate import ClearanceCertificate, certify_move
from plan.collision.world import World
from plan.options import PlanOptions
from plan.trajectory.integer_segments import LineTolerance, MarksTooNear, to_marked_segments, to_segments
from plan.trajectory.jerk_limited import time_smooth
from plan.trajectory.joint_path import Stretch, chained, polyline, smooth_path
from plan.trajectory.timing import time_curve, time_line, time_path

_BLENDS = (1.0, 0.4, 0.15)  # factors on the duration of blends, in the order of the attempts


@dataclass(frozen=True, eq=False)
class MotionPhase:
    """A phase of a motion.

    Attributes:
        name: name of the step.
        role: home, transit, approach or retract.
        cube: index of the cube that it serves, or None.
        world: its collision world.
        clearance: required clearance, m.
        held: name of the body in the jaws, or None.
        allowed_collisions: names of bodies that the held one may touch.
    """

    name: str
    role: str
    cube: int | None
    world: World
    clearance: float
    held: str | None = None
    allowed_collisions: frozenset[str] = frozenset()


@dataclass(frozen=True)
class ApproachLine:
    """A line at a station; `path` runs from the station outwards."""

    line: Line
    path: JointPath

    def inwards(self) -> JointPath:
        """Return the path towards the station."""
        return JointPath(frozen(self.path.q[::-1]), frozen(self.path.s[-1] - self.path.s[::-1]))


@dataclass(frozen=True)
class RestToRestPath:
    """The parts of a motion.

    Attributes:
        retract: first phase and its line, or None.
        transit: transit phase.
        waypoints: (m, n) rad, of the transit.
        approach: last phase and its line, or None.
    """

    retract: tuple[MotionPhase, ApproachLine] | None
    transit: MotionPhase
    waypoints: Array
    approach: tuple[MotionPhase, ApproachLine] | None

    def phases(self) -> list[MotionPhase]:
        """Return all phases in order."""
        ends = [self.retract[0]] if self.retract else [], [self.approach[0]] if self.approach else []
        return [*ends[0], self.transit, *ends[1]]


class MotionBuilder:
    """Converts paths to certified moves.

    Args:
        robot: the arm, for the tool on lines.
        unit: unit that defines the counts.
        planned: limits for time parametrisation.
        sent: limits of the segments that are sent.
        options: clearances, speeds.
    """

    def __init__(self, robot: Robot, unit: Unit, planned: Limits, sent: Limits, options: PlanOptions) -> None:
        self.robot, self.unit, self.planned, self.sent, self.options = robot, unit, planned, sent, options

    def run(self, leg: RestToRestPath) -> list[Move]:
        """Return the moves of a motion; an empty list if it goes nowhere.

        Raises:
            ImpossibleError: it cannot be certified; data: step, role, pair, distance_m, time_s.
        """
        for blend in () if self.options.jerk_time else _BLENDS:
            moves = self.flowing(leg, blend)
            if moves is not None:
                return moves
        return self.stopping(leg)

    def flowing(self, leg: RestToRestPath, blend: float) -> list[Move] | None:
        """Return the moves without stops between them, or None if they cannot be certified."""
        if np.abs(leg.waypoints[-1] - leg.waypoints[0]).max() < 1e-6:
            return None
        before, after = leg.retract, leg.approach
        retract = [Stretch(before[1].path, self.tool_speed)] if before else []
        approach = [Stretch(after[1].inwards(), self.tool_speed)] if after else []
        chain = chained([*retract, leg.waypoints, *approach], self.planned, blend)
        trajectory = time_curve(chain.path, self.planned, chain.caps)
        try:
            sent = to_marked_segments(
                trajectory,
                self.unit,
                self.options.segment_ms,
                limits=self.sent,
                marks=chain.edges[1:-1].tolist(),
                lines=(self.tolerance(before), self.tolerance(after)),
            )
        except MarksTooNear:  # a very short transit, such as out of a hole and back into it
            return None
        edges = [0, *sent.first, len(sent.path.segments)]
        moves = []
        start = sent.path.start
        for phase, first, last in zip(leg.phases(), edges, edges[1:], strict=False):
            part = CountPath(start, sent.path.segments[first:last])
            start = part.end
            check = self.check(phase, part)
            if not check.proved:
                return None
            moves.append(_move(phase, part, check))
        return moves

    def stopping(self, leg: RestToRestPath) -> list[Move]:
        """Return the moves with a stop at every way-point.

        Raises:
            ImpossibleError: one of them cannot be certified.
        """
        parts: list[tuple[MotionPhase, CountPath]] = []
        if leg.retract:
            parts.append((leg.retract[0], self.line(leg.retract[1].path, leg.retract[1])))
        q = self.unit.positions(self.unit.counts(leg.waypoints))
        if len(q) > 2 or not np.array_equal(q[0], q[-1]):
            trajectory = (
                time_path(q, self.planned)
                if self.jerk is None
                else time_smooth(polyline(q), self.planned, self.jerk)
            )
            across = to_segments(trajectory, self.unit, self.options.segment_ms, limits=self.sent)
            parts.append((leg.transit, across))
        if leg.approach:
            parts.append((leg.approach[0], self.line(leg.approach[1].inwards(), leg.approach[1])))
        moves = []
        for phase, path in parts:
            check = self.check(phase, path)
            if not check.proved:
                raise _unproved(phase, check)
            moves.append(_move(phase, path, check))
        return moves

    def line(self, path: JointPath, grip: ApproachLine) -> CountPath:
        """Convert a single line, from rest to rest."""
        trajectory = (
            time_line(path, self.planned, self.tool_speed)
            if self.jerk is None
            else time_smooth(smooth_path(path.q, path.s), self.planned, self.jerk, self.tool_speed)
        )
        return to_segments(
            trajectory,
            self.unit,
            self.options.segment_ms,
            limits=self.sent,
            line=LineTolerance(self.robot, grip.line),
        )

    def check(self, phase: MotionPhase, path: CountPath) -> ClearanceCertificate:
        """Certify a phase as it will be sent."""
        tight = self.options.certificate == "tight"
        return certify_move(phase.world, path, self.unit, phase.clearance, tight)

    @property
    def jerk(self) -> Array | None:
        """Jerk limits (n,) rad/s^3, or None."""
        time = self.options.jerk_time
        return self.planned.acceleration / time if time else None

    @property
    def tool_speed(self) -> float:
        """Cap on the tool speed on lines, m/s."""
        return self.options.approach_speed * self.options.speed

    def tolerance(self, end: tuple[MotionPhase, ApproachLine] | None) -> LineTolerance | None:
        """Tolerance of the tool on the line at an end of a motion; None for an end without a line."""
        return LineTolerance(self.robot, end[1].line) if end else None


def _move(phase: MotionPhase, path: CountPath, check: ClearanceCertificate) -> Move:
    clearances = tuple(_rounded_down(min(bound, check.seen)) for bound in check.bounds)
    return Move(
        name=phase.name,
        role=phase.role,
        cube=phase.cube,
        path=path,
        held=phase.held,
        jaw_opening=_jaw_opening(phase.world.robot),
        clearance=_rounded_down(check.clearance),
        closest=check.pair,
        certified=True,
        allowed_collisions=tuple(sorted(phase.allowed_collisions)),
        clearances=clearances,
    )


def _unproved(phase: MotionPhase, check: ClearanceCertificate) -> ImpossibleError:
    return ImpossibleError(
        f"step {phase.name!r}: {check.pair[0]} comes within {check.seen * 1e3:.2f} mm of {check.pair[1]} after "
        f"{check.time:.2f} s (required: {phase.clearance * 1e3:g} mm, proved: {check.clearance * 1e3:.2f} mm); "
        "lower the required clearance or move the bodies apart",
        step=phase.name,
        role=phase.role,
        pair=list(check.pair),
        distance_m=check.seen,
        proved_m=check.clearance,
        clearance_m=phase.clearance,
        time_s=check.time,
    )


def _rounded_down(clearance: float) -> float:
    """Round down to 0.1 um: the last bits differ between processors and must not change the file."""
    return float(np.floor(clearance * 1e7)) / 1e7


def _jaw_opening(robot: Robot) -> float:
    """Return the distance of the inner faces of finger_l and finger_r, m; 0 for an arm without them."""
    fingers = {b.name: b for b in robot.bodies if b.name in ("finger_l", "finger_r")}
    if len(fingers) < 2:
        return 0.0
    faces = []
    for finger in fingers.values():
        thickness = finger.shape.size[1] if isinstance(finger.shape, Box) else 0.0
        faces.append(abs(float(finger.T_joint_body[1, 3])) - thickness / 2.0)
    return round(sum(faces), 9)
