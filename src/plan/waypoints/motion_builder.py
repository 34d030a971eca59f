"""The motions of a found sequence: from stop to stop, joined, timed, in whole counts, and proved phase by phase.

A motion is made of pieces, lines and ways. Where a line meets a way they are joined at speed by
`plan.trajectory.joint_path.chained`.
Two lines meet at a corner: the arm stops there, or where the target allows it both are cut short and a straight joint
way goes across. Two ways that meet at a target become one through it, if the rounded corner passes it near enough.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from arm.controller.segments import CountPath
from arm.controller.unit import Limits, Unit
from arm.errors import ImpossibleError
from arm.plan_file import Move
from arm.robot.model import Robot
from arm.se3 import Array, frozen
from plan.cartesian.line import JointPath
from plan.collision.certificate import certify_move
from plan.collision.world import World
from plan.kinematics.product_of_exponentials import product_of_exponentials
from plan.options import PlanOptions
from plan.trajectory.integer_segments import MarksTooNear, to_marked_segments, to_segments
from plan.trajectory.joint_path import Stretch, chained, smooth_path
from plan.trajectory.timing import time_curve, time_line, time_path
from plan.trajectory.virtual_unit import PER_RAD
from plan.waypoints.blending import blend_distance
from plan.waypoints.line_chains import LinearMove
from plan.waypoints.target import Target

_BLENDS = (1.0, 0.4, 0.15, 0.05)  # parts of a full blend, the fastest first
_SMALLER = 0.7  # each time a cut corner passes too far
_CUTS = 4  # sizes of a cut that are tried
_OFF_LINE = 1e-4  # of the tool as it is sent, m


@dataclass(frozen=True, eq=False)
class PoseMotionPhase:
    """A stretch of the arm's way with one purpose.

    Attributes:
        name: for people.
        role: transit, approach, line or retract.
        world: it is made in.
        clearance: asked for, m.
        held: name of the body that moves with the tool, or None.
        allowed_collisions: names of bodies that the held one may touch.
        way: (m, n) rad, way-points of a transit; or
        line: what it follows.
    """

    name: str
    role: str
    world: World
    clearance: float
    held: str | None
    allowed_collisions: frozenset[str]
    way: Array | None = None
    line: LinearMove | None = None


@dataclass(frozen=True)
class Join:
    """How a piece meets the one before it: the target between them or None, and whether the arm rests there."""

    target: int | None
    stop: bool


@dataclass(frozen=True, eq=False)
class _Part:
    """What is timed: a line, perhaps cut short, or way-points; and the index of its phase."""

    phase: int
    shape: Stretch | Array
    via: tuple[tuple[int, Array], ...] = ()  # targets that way-points lead past, with their places


class PoseMotionBuilder:
    """Makes pieces into moves.

    Args:
        robot: the arm.
        unit: whose counts.
        planned, sent: limits that motion is timed with, and that hold on what is sent.
        options: segments, certificate.
        targets: the list.
    """

    def __init__(
        self,
        robot: Robot,
        unit: Unit,
        planned: Limits,
        sent: Limits,
        options: PlanOptions,
        targets: Sequence[Target],
    ) -> None:
        self.robot, self.unit, self.planned, self.sent = robot, unit, planned, sent
        self.options, self.targets = options, targets
        # on a fine grid the motion is followed to what lines are asked to keep
        self.deviation = 1e-6 if unit.counts_per_rad[0] == PER_RAD else 5e-5

    def run(self, pieces: Sequence[PoseMotionPhase], joins: Sequence[Join]) -> list[list[Move]]:
        """Moves of each motion, from rest to rest; `joins` (k - 1) are between the k pieces.

        Raises:
            ImpossibleError: a piece cannot be proved even from rest to rest; data: piece, pair, distance_m.
        """
        motions = []
        for first, last in self.motions(pieces, joins):
            motions += self.motion(pieces[first:last], joins[first : last - 1])
        return motions

    def motion(self, pieces: Sequence[PoseMotionPhase], joins: Sequence[Join]) -> list[list[Move]]:
        """Moves without a stop between them; with stops everywhere where that cannot be proved."""
        for blend in _BLENDS if len(pieces) > 1 or _corners(pieces) else ():
            moves = self.flowing(pieces, joins, blend)
            if moves is not None:
                return [moves]
        return [[self.alone(piece)] for piece in pieces]

    def motions(self, pieces: Sequence[PoseMotionPhase], joins: Sequence[Join]) -> list[tuple[int, int]]:
        """First and one past the last piece of each motion."""
        stops = [0]
        for i, (join, (a, b)) in enumerate(zip(joins, pairwise(pieces), strict=True)):
            if join.stop or not self.flows(a, b, join):
                stops.append(i + 1)
        return list(pairwise([*stops, len(pieces)]))

    def flows(self, a: PoseMotionPhase, b: PoseMotionPhase, join: Join) -> bool:
        """Whether two pieces may meet at speed."""
        if a.line is not None and b.line is not None:
            return blend_distance(a.line, b.line, self.targets) > 0.0 and a.world is b.world
        if a.way is not None and b.way is not None:
            within = 0.0 if join.target is None else self.targets[join.target].blend_radius
            return within > 0.0 and a.world is b.world
        return True

    def flowing(
        self, pieces: Sequence[PoseMotionPhase], joins: Sequence[Join], blend: float
    ) -> list[Move] | None:
        """Moves of a motion, or None where it cannot be proved as fast as this."""
        parts = self.parts(pieces, joins)
        if parts is None:
            return None
        chain = chained([part.shape for part in parts], self.planned, blend)
        for part, begin, end in zip(parts, chain.edges, chain.edges[1:], strict=False):
            for target, place in part.via:
                passed = product_of_exponentials(self.robot).tool_poses(
                    chain.path(np.linspace(begin, end, 400))
                )
                if np.linalg.norm(passed[:, :3, 3] - place, axis=1).min() > self.targets[target].blend_radius:
                    return None
        changes = [i for i, (a, b) in enumerate(pairwise(parts), start=1) if a.phase != b.phase]
        try:
            sent = to_marked_segments(
                time_curve(chain.path, self.planned, chain.caps),
                self.unit,
                self.options.segment_ms,
                limits=self.sent,
                marks=[float(chain.edges[i]) for i in changes],
                late=[isinstance(parts[i].shape, Stretch) for i in changes],
                deviation=self.deviation,
            )
        except MarksTooNear:  # phases so short that no join has room
            return None
        edges = [0, *sent.first, len(sent.path.segments)]
        moves, start = [], sent.path.start
        for index, (first, last) in enumerate(pairwise(edges)):
            some = [p for p, part in _of_phase(pieces, parts, index) if part]
            path = CountPath(start, sent.path.segments[first:last])
            start = path.end
            move = self.proved(some[0], path)
            if move is None or self.off_lines(some, path) > 1.0:
                return None
            moves.append(move if len(some) == 1 else replace(move, name=f"{some[0].name} .. {some[-1].name}"))
        return moves

    def alone(self, piece: PoseMotionPhase) -> Move:
        """One piece from rest to rest."""
        if piece.line is not None:
            trajectory = time_line(piece.line.path, self.planned, piece.line.speed)
        else:
            q = self.unit.positions(self.unit.counts([] if piece.way is None else piece.way))
            trajectory = time_path(q, self.planned)
        path = to_segments(
            trajectory, self.unit, self.options.segment_ms, limits=self.sent, deviation=self.deviation
        )
        move = self.proved(piece, path)
        if move is None:
            check = certify_move(piece.world, path, self.unit, piece.clearance, tight=True)
            raise ImpossibleError(
                f"{piece.name}: {check.pair[0]} comes within {check.seen * 1e3:.2f} mm of {check.pair[1]} after "
                f"{check.time:.2f} s, {piece.clearance * 1e3:g} mm are asked for (proved: "
                f"{check.clearance * 1e3:.2f} mm); ask for less clearance or move the bodies apart",
                piece=piece.name,
                pair=list(check.pair),
                distance_m=check.seen,
                clearance_m=piece.clearance,
            )
        return move

    def proved(self, piece: PoseMotionPhase, path: CountPath) -> Move | None:
        """The move with its certificate, or None."""
        tight = self.options.certificate == "tight"
        check = certify_move(piece.world, path, self.unit, piece.clearance, tight)
        if not check.proved:
            return None
        bounds = tuple(_rounded_down(min(bound, check.seen)) for bound in check.bounds)
        return Move(
            name=piece.name,
            role=piece.role,
            cube=None,
            path=path,
            held=piece.held,
            jaw_opening=0.0,
            clearance=_rounded_down(check.clearance),
            closest=check.pair,
            certified=True,
            allowed_collisions=tuple(sorted(piece.allowed_collisions)),
            clearances=bounds,
        )

    def parts(self, pieces: Sequence[PoseMotionPhase], joins: Sequence[Join]) -> list[_Part] | None:
        """What a motion is timed from; None where a corner cannot be cut as closely as asked."""
        parts: list[_Part] = []
        phase = 0
        cut = 0.0  # what the corner before took of the line
        for i, piece in enumerate(pieces):
            before = pieces[i - 1] if i else None
            after = pieces[i + 1] if i + 1 < len(pieces) else None
            if piece.way is not None and before is not None and before.way is not None:
                target = joins[i - 1].target
                last = parts[-1]
                if target is None or not isinstance(last.shape, np.ndarray):
                    return None
                place = self.robot.T_base_tool(piece.way[0])[:3, 3]
                points = np.concatenate([last.shape, piece.way[1:]])
                parts[-1] = _Part(last.phase, points, (*last.via, (target, place)))
                continue
            if before is not None and not (before.line and piece.line):
                phase += 1
            if piece.line is None:
                parts.append(_Part(phase, frozen(piece.way if piece.way is not None else [])))
                continue
            first, cut = cut, 0.0
            across: Array | None = None
            if after is not None and after.line is not None:
                found = self.cut(piece.line, after.line)
                if found is None:
                    return None
                cut, across = found
            parts.append(_Part(phase, Stretch(_shortened(piece.line.path, first, cut), piece.line.speed)))
            if across is not None:
                parts.append(_Part(phase, across))
        return parts

    def cut(self, before: LinearMove, after: LinearMove) -> tuple[float, Array] | None:
        """How far from its corner two lines are cut, and the way across (2, n); None where it passes too far."""
        corner = before.line.T_end[:3, 3]
        target = self.targets[before.target if after.role != "approach" else after.target]
        length = blend_distance(before, after, self.targets)
        for _ in range(_CUTS):
            ends = np.stack(
                [
                    smooth_path(before.path.q, before.path.s)(before.path.s[-1] - length),
                    smooth_path(after.path.q, after.path.s)(length),
                ]
            )
            way = ends[0] + np.linspace(0.0, 1.0, 33)[:, None] * (ends[1] - ends[0])
            away = np.linalg.norm(
                product_of_exponentials(self.robot).tool_poses(way)[:, :3, 3] - corner, axis=1
            ).min()
            if away <= target.blend_radius:
                return length, frozen(ends)
            length *= _SMALLER
        return None

    def off_lines(self, pieces: Sequence[PoseMotionPhase], path: CountPath) -> float:
        """Largest distance of the tool as it is sent from the lines it follows, over what is allowed."""
        lines = [piece.line for piece in pieces if piece.line is not None]
        if not lines:
            return 0.0
        poses = product_of_exponentials(self.robot).tool_poses(self.unit.positions(path.sample(0.01)))
        away = np.stack([line.line.deviation(poses, line.free_axis).distance for line in lines])
        cuts = [self.targets[line.target].blend_radius for line in lines] if len(lines) > 1 else [0.0]
        return float(away.min(axis=0).max()) / (_OFF_LINE + max(cuts))


def _corners(pieces: Sequence[PoseMotionPhase]) -> bool:
    return any(piece.way is not None and len(piece.way) > 2 for piece in pieces)


def _of_phase(
    pieces: Sequence[PoseMotionPhase], parts: Sequence[_Part], index: int
) -> list[tuple[PoseMotionPhase, bool]]:
    """The pieces, and whether each belongs to a phase."""
    phases: list[int] = []
    for i, piece in enumerate(pieces):
        before = pieces[i - 1] if i else None
        same = before is not None and (before.line is None) == (piece.line is None)
        phases.append(0 if before is None else phases[-1] + (0 if same else 1))
    return [(piece, phase == index) for piece, phase in zip(pieces, phases, strict=True)]


def _shortened(path: JointPath, first: float, last: float) -> JointPath:
    """A line without its first and last metres."""
    if first == last == 0.0:
        return path
    s = np.linspace(first, path.s[-1] - last, len(path.s))
    return JointPath(frozen(smooth_path(path.q, path.s)(s)), frozen(s - first))


def _rounded_down(clearance: float) -> float:
    return float(np.floor(clearance * 1e7)) / 1e7
