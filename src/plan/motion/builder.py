"""Motions from rest to rest, as they will be sent: lines and transits, joined without stops where the targets allow it.

The joined path is timed, converted to integer segments and certified phase by phase, each in its own world and with its
own clearance. A line and a transit are joined at speed (`plan.trajectory.joint_path.chained`). The corner between two
lines is rounded if its target allows it: both lines are shortened, and a straight joint motion connects them. Two
transits that meet at a target become one, if the rounded corner passes the target closely enough.

Longer blends save time but come nearer to bodies, so the longest blends that can be certified are used. If none can,
the arm stops between the phases and at every way-point.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise

import numpy as np

from arm.controller.segments import CountPath
from arm.controller.unit import Limits, Unit
from arm.errors import ImpossibleError
from arm.plan_file import Move
from arm.robot.model import Robot
from arm.robot.shapes import Box
from arm.se3 import Array, frozen
from plan.cartesian.line import JointPath
from plan.collision.certificate import ClearanceCertificate, certify_move
from plan.kinematics.product_of_exponentials import product_of_exponentials
from plan.kinematics.straight_line import Line
from plan.motion.phase import Join, LinearPath, MotionPhase
from plan.options import PlanOptions
from plan.trajectory.extremes import segment_extremes
from plan.trajectory.integer_segments import LineTolerance, MarksTooNear, to_marked_segments, to_segments
from plan.trajectory.jerk_limited import time_smooth
from plan.trajectory.joint_path import Stretch, chained, polyline
from plan.trajectory.rounding import vertex_jump
from plan.trajectory.timing import time_curve, time_path
from plan.trajectory.virtual_unit import is_virtual

_BLENDS = (1.0, 0.4, 0.15, 0.05)  # factors on the duration of blends, in the order of the attempts
_SMALLER, _CUTS = 0.7, 4  # factor on a cut whose corner passes too far from its target, and the most attempts
OFF_LINE = 1e-4  # m, largest distance of the tool as it is sent from its line or path
# Largest deviation of a joint from the planned motion, rad. Lines at the ends of a motion also have a tolerance at the
# tool; other lines need the smaller deviation. With a virtual unit's fine counts the deviation may be much smaller.
_DEVIATION, _ON_LINES, _VIRTUAL = 2e-4, 5e-5, 1e-6
_BEYOND = 1e-9  # rad or m, excess beyond a position limit that is accepted as an error of arithmetic
_NOWHERE = 1e-6  # rad, length below which a transit is not blended
_SAMPLES = 60  # configurations of a blended transit that are looked at before it is timed


@dataclass(frozen=True, eq=False)
class _Part:
    """One part of a motion: a line, perhaps shortened, or way-points.

    Attributes:
        move: index of its move.
        shape: the line, or the way-points (m, n) rad.
        via: tool positions (3,) m of targets that the path passes, each with the largest allowed distance, m.
    """

    move: int
    shape: Stretch | Array
    via: tuple[tuple[Array, float], ...] = ()


class MotionBuilder:
    """Converts phases to certified moves.

    Args:
        robot: the arm, for the tool on lines.
        unit: unit that defines the counts.
        planned: limits for time parametrisation.
        sent: limits of the segments that are sent.
        options: clearances, segments, certificate.
    """

    def __init__(self, robot: Robot, unit: Unit, planned: Limits, sent: Limits, options: PlanOptions) -> None:
        self.robot, self.unit, self.planned, self.sent, self.options = robot, unit, planned, sent, options
        self.virtual = is_virtual(unit)

    def run(self, phases: Sequence[MotionPhase], joins: Sequence[Join]) -> list[Move]:
        """Return the moves of consecutive phases; an empty list if they go nowhere.

        Args:
            phases: in order; each begins where the one before ends.
            joins: (k - 1) between the k phases.

        Raises:
            ImpossibleError: a phase cannot be certified, not even from rest to rest; data: step, role, pair,
                distance_m, proved_m, clearance_m, time_s.
        """
        rests = [i + 1 for i, join in enumerate(joins) if not _flow(phases[i], phases[i + 1], join)]
        moves: list[Move] = []
        for first, last in pairwise([0, *rests, len(phases)]) if phases else ():
            moves += self._motion(phases[first:last], joins[first : last - 1])
        return moves

    def stopping(self, phases: Sequence[MotionPhase]) -> list[Move]:
        """Return the moves with a stop between all phases and at every way-point.

        Raises:
            ImpossibleError: one of them cannot be certified.
        """
        moves = []
        for phase in phases:
            path = self._alone(phase)
            if path is None:
                continue
            check = self._check(phase, path)
            if not check.proved:
                raise _unproved(phase, check, self.unit.positions(path.at([check.time]))[0])
            beyond = self._beyond_limits(path)
            if beyond.max() > _BEYOND:
                raise _past_limit(phase, self.robot.joint_names[int(np.argmax(beyond))], float(beyond.max()))
            moves.append(_move([phase], path, check))
        return moves

    def _motion(self, phases: Sequence[MotionPhase], joins: Sequence[Join]) -> list[Move]:
        alone = len(phases) == 1 and phases[0].line is not None
        for blend in () if alone or self.options.jerk_time else _BLENDS:
            moves = self._flowing(phases, joins, blend)
            if moves is not None:
                return moves
        return self.stopping(phases)

    def _flowing(
        self, phases: Sequence[MotionPhase], joins: Sequence[Join], blend: float
    ) -> list[Move] | None:
        """Return the moves without stops between them, or None if they cannot be certified."""
        if any(p.waypoints is not None and _length(p.waypoints) < _NOWHERE for p in phases):
            return None
        groups = [list(group) for _, group in groupby(phases, key=lambda phase: phase.line is not None)]
        parts = self._parts(groups, joins)
        if parts is None:
            return None
        chain = chained([part.shape for part in parts], self.planned, blend)
        for part, begin, end in zip(parts, chain.edges, chain.edges[1:], strict=False):
            for place, radius in part.via:
                passed = self._tool(chain.path(np.linspace(begin, end, 400)))
                if np.linalg.norm(passed[:, :3, 3] - place, axis=1).min() > radius:
                    return None
            phase = groups[part.move][0]
            if phase.line is None and phase.meets(chain.path(np.linspace(begin, end, _SAMPLES))):
                return None  # far cheaper than by the certificate, after timing and rounding
        changes = [i for i, (a, b) in enumerate(pairwise(parts), start=1) if a.move != b.move]
        first_tolerance, last_tolerance = (self._tolerance(group) for group in (groups[0], groups[-1]))
        # lines that have no tolerance of their own
        careful = any(group[0].line is not None for group in groups[1:-1]) or any(
            group[0].line is not None and self._tolerance(group) is None for group in groups
        )
        try:
            sent = to_marked_segments(
                time_curve(chain.path, self.planned, chain.caps, self.options.by_toppra),
                self.unit,
                self.options.segment_ms,
                limits=self.sent,
                marks=[float(chain.edges[i]) for i in changes],
                lines=(first_tolerance, last_tolerance),
                late=[isinstance(parts[i].shape, Stretch) for i in changes],
                deviation=self._deviation(careful),
                jump=self._jump,
            )
        except MarksTooNear:  # phases so short that no join has room, such as out of a hole and back into it
            return None
        moves, start = [], sent.path.start
        joined = pairwise([0, *sent.first, len(sent.path.segments)])
        for (first, last), group in zip(joined, groups, strict=True):
            path = CountPath(start, sent.path.segments[first:last])
            start = path.end
            check = self._check(group[0], path)
            if not check.proved or (careful and self._off_lines(group, joins, path)):
                return None
            if self._beyond_limits(path).max() > _BEYOND:  # a blend at the end of a line may overshoot
                return None
            moves.append(_move(group, path, check))
        return moves

    def _alone(self, phase: MotionPhase) -> CountPath | None:
        """Return the segments of one phase from rest to rest, or None if it goes nowhere."""
        tolerance = self._tolerance([phase])
        if isinstance(phase.path, LinearPath):
            path, speed = phase.path.path, phase.path.speed
            trajectory = (
                time_curve(path.spline, self.planned, speed, self.options.by_toppra)
                if self.jerk is None
                else time_smooth(path.spline, self.planned, self.jerk, speed)
            )
        else:
            q = self.unit.positions(self.unit.counts(phase.path))
            if (q == q[0]).all():
                return None
            trajectory = (
                time_path(q, self.planned)
                if self.jerk is None
                else time_smooth(polyline(q), self.planned, self.jerk)
            )
        on_lines = phase.line is not None and tolerance is None
        return to_segments(
            trajectory,
            self.unit,
            self.options.segment_ms,
            limits=self.sent,
            deviation=self._deviation(on_lines),
            line=tolerance,
            jump=self._jump,
        )

    @property
    def _jump(self) -> Array:
        """Largest jump of velocity at a join, (n,) rad/s."""
        return vertex_jump(self.sent.acceleration, self.options.speed)

    def _parts(self, groups: Sequence[Sequence[MotionPhase]], joins: Sequence[Join]) -> list[_Part] | None:
        """Return what a motion is joined from, or None if a corner cannot be cut as closely as required.

        Each group is one move: lines with rounded corners, or transits through the targets between them.
        """
        parts: list[_Part] = []
        first = 0
        for move, group in enumerate(groups):
            inner = joins[first : first + len(group) - 1]
            first += len(group)
            lines = [phase.line for phase in group if phase.line is not None]
            if not lines:
                parts.append(
                    self._through(
                        move, [phase.waypoints for phase in group if phase.waypoints is not None], inner
                    )
                )
                continue
            rounded = self._with_corners(move, lines, inner)
            if rounded is None:
                return None
            parts += rounded
        return parts

    def _through(self, move: int, transits: Sequence[Array], joins: Sequence[Join]) -> _Part:
        """Return transits as one, which leads past the targets between them."""
        via = [
            (self.robot.T_base_tool(after[0])[:3, 3], join.blend_radius)
            for after, join in zip(transits[1:], joins, strict=True)
        ]
        waypoints = np.concatenate([transits[0], *(transit[1:] for transit in transits[1:])])
        return _Part(move, frozen(waypoints), tuple(via))

    def _with_corners(
        self, move: int, lines: Sequence[LinearPath], joins: Sequence[Join]
    ) -> list[_Part] | None:
        """Return lines that are cut short at their common corners, and the moves across; None as for `_parts`."""
        parts: list[_Part] = []
        cut = 0.0  # what the corner before takes of a line
        for line, after, join in zip(lines, [*lines[1:], None], [*joins, None], strict=True):
            taken, cut, across = cut, 0.0, None
            if after is not None and join is not None:
                rounded = self._rounded(line, after, join)
                if rounded is None:
                    return None
                cut, across = rounded
            parts.append(_Part(move, Stretch(_shortened(line.path, taken, cut), line.speed)))
            if across is not None:
                parts.append(_Part(move, across))
        return parts

    def _rounded(self, before: LinearPath, after: LinearPath, join: Join) -> tuple[float, Array] | None:
        """Return what a corner takes of both lines, m, and the move across (2, n) rad; None if it passes too far."""
        corner, length = before.line.T_end[:3, 3], join.cut
        one, two = (line.path.spline for line in (before, after))
        for _ in range(_CUTS):
            ends = np.stack([one(before.path.s[-1] - length), two(length)])
            across = ends[0] + np.linspace(0.0, 1.0, 33)[:, None] * (ends[1] - ends[0])
            if np.linalg.norm(self._tool(across)[:, :3, 3] - corner, axis=1).min() <= join.blend_radius:
                return length, frozen(ends)
            length *= _SMALLER
        return None

    def _off_lines(self, group: Sequence[MotionPhase], joins: Sequence[Join], path: CountPath) -> bool:
        """Return whether the tool as it is sent leaves the lines that it follows by more than is allowed."""
        lines = [phase.line for phase in group if phase.line is not None]
        if not lines:
            return False
        poses = self._tool(self.unit.positions(path.sample(0.01)))
        away = np.stack([line.line.deviation(poses, line.free_axis).distance for line in lines])
        rounded = max((join.blend_radius for join in joins if join.cut), default=0.0)
        return bool(away.min(axis=0).max() > OFF_LINE + (rounded if len(lines) > 1 else 0.0))

    def _tool(self, q: Array) -> Array:
        """Return the poses (m, 4, 4) of the tool."""
        return product_of_exponentials(self.robot).tool_poses(q)

    def _check(self, phase: MotionPhase, path: CountPath) -> ClearanceCertificate:
        """Certify a phase as it will be sent."""
        tight = self.options.certificate == "tight"
        return certify_move(phase.world, path, self.unit, phase.clearance, tight)

    def _beyond_limits(self, path: CountPath) -> Array:
        """Return the largest excess of each joint beyond its position limits, (n,) rad; negative within them."""
        extremes = segment_extremes(path, self.unit)
        beyond = np.maximum(self.sent.lower - extremes.lower, extremes.upper - self.sent.upper)
        return np.asarray(beyond.max(axis=0))

    @property
    def jerk(self) -> Array | None:
        """Jerk limits (n,) rad/s^3, or None."""
        time = self.options.jerk_time
        return self.planned.acceleration / time if time else None

    def _deviation(self, on_lines: bool) -> float:
        return _VIRTUAL if self.virtual else _ON_LINES if on_lines else _DEVIATION

    def _tolerance(self, group: Sequence[MotionPhase]) -> LineTolerance | None:
        """Return the tolerance of the tool on a single line; None for a transit, rounded lines or one that may turn."""
        line = group[0].line
        if len(group) > 1 or line is None or line.free_axis is not None or not isinstance(line.line, Line):
            return None
        return LineTolerance(self.robot, line.line)


def _flow(before: MotionPhase, after: MotionPhase, join: Join) -> bool:
    """Return whether two phases may meet at speed."""
    if (before.line is None) != (after.line is None):
        return True
    rounded = join.cut if before.line is not None else join.blend_radius
    return rounded > 0.0 and before.world is after.world


def _length(waypoints: Array) -> float:
    return float(np.ptp(waypoints, axis=0).max())


def _shortened(path: JointPath, first: float, last: float) -> JointPath:
    """Return a line without its first and last metres."""
    if first == last == 0.0:
        return path
    s = np.linspace(first, path.s[-1] - last, len(path.s))
    return JointPath(frozen(path.spline(s)), frozen(s - first))


def _move(group: Sequence[MotionPhase], path: CountPath, check: ClearanceCertificate) -> Move:
    phase, last = group[0], group[-1]
    return Move(
        name=phase.name if len(group) == 1 else f"{phase.name} .. {last.name}",
        role=phase.role,
        cube=phase.cube,
        path=path,
        held=phase.held,
        jaw_opening=_jaw_opening(phase.world.robot),
        clearance=rounded_down(check.clearance),
        closest=check.pair,
        certified=True,
        allowed_collisions=tuple(sorted(phase.allowed_collisions)),
        clearances=tuple(rounded_down(min(bound, check.seen)) for bound in check.bounds),
        allowed_pairs=tuple(sorted((min(pair), max(pair)) for pair in phase.allowed_pairs)),
        threaded=phase.threaded,
    )


def _unproved(phase: MotionPhase, check: ClearanceCertificate, q: Array) -> ImpossibleError:
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
        **phase.world.state(q),
    )


def _past_limit(phase: MotionPhase, joint: str, beyond: float) -> ImpossibleError:
    return ImpossibleError(
        f"step {phase.name!r}: joint {joint} would exceed its position limits by {beyond:.2g} rad (m); move the goals "
        "away from these limits",
        step=phase.name,
        role=phase.role,
        joint=joint,
        beyond=beyond,
    )


def rounded_down(clearance: float) -> float:
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
