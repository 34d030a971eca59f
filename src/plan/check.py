"""Proof of clearance over a whole motion, between the samples as well as at them.

**The bound.** Let q and q' be two configurations, and p a point fixed to a body that moves with joint i. Then

    |p(q') - p(q)|  <=  sum over k <= i of |q'_k - q_k| r_k,      r_k = distance of p(q) from the axis of joint k at q.

Proof: change the joints one after another, the innermost first: q^0 = q, and q^k is q^(k-1) with its k-th entry
replaced by q'_k, so q^i has all that matters to p. From q^(k-1) to q^k only joint k turns, by q'_k - q_k, so p runs on
a circle about that joint's axis and moves by a chord, 2 r sin(|q'_k - q_k| / 2) <= r |q'_k - q_k|, where r is the
distance of p from that axis. That distance does not depend on joints 1 to k, because they carry p and the axis alike;
the outer ones, k + 1 to i, still have their values of q. So r is the distance r_k at q itself. (A prismatic joint moves
p by |q'_k - q_k|: r_k = 1.) The triangle inequality sums the chords. Nothing is assumed about the way from q to q',
and nothing has to be maximised over it.

For two bodies, a on joint i and b on joint j >= i, look from the frame of joint i: only joints i + 1 to j move b
against a, and the distance of the two drops by at most m = sum over i < k <= j of delta_k R_k, where delta_k bounds
|q'_k - q_k| and R_k is the largest r_k over b's points (`World.motion_radii`, `World.pair_motion`). Hence, if d is the
distance of the pair at q, it is at least d - m at every q' with |q'_k - q_k| <= delta_k.

**The pieces.** A motion is a chain of cubics. Each is written by its four Bernstein control points, between whose
least and greatest values it stays. A piece is a run of whole cubics, or a part of one; q is the point on the curve in
its middle, and delta_k the farthest that a control point lies from q in joint k. A piece that is not proved for all
pairs is cut in two; pairs that are proved need not be looked at again in its halves. Every distance is counted as
`plan.world.DISTANCE_ERROR` shorter than it was computed.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from arm.motion import CountPath, Segment
from arm.se3 import Array
from arm.unit import Unit
from plan.world import DISTANCE_ERROR, Indices, World

# Tight mode stops when the bound is this close to the smallest distance seen: the larger of m and a fraction of it.
TIGHT_ABSOLUTE = 5e-4
TIGHT_RELATIVE = 0.05
# A piece in which nothing moves further than this (m) and that is still not proved is at the limit of the arithmetic.
RESOLUTION = 2e-5
# Pieces looked at before giving up; what is proved by then is returned.
BUDGET = 20_000


@dataclass(frozen=True)
class Curve:
    """A joint motion as a chain of cubics.

    Attributes:
        control: Bernstein control points of each cubic, (m, 4, n) rad.
        ends: time at the end of each, (m,) s; or path parameter where the motion is not timed.
    """

    control: Array
    ends: Array


@dataclass(frozen=True)
class MoveCheck:
    """What was found about a motion.

    Attributes:
        clearance: lower bound, proved, of the distance of any checked pair over the whole motion, m.
        seen: smallest distance that was computed on it, m; the truth lies between `clearance` and `seen`.
        pair: the two bodies at `seen`.
        time: where on the motion `seen` was, s.
        proved: whether `clearance` is at least what was asked for.
        evaluations: configurations looked at.
    """

    clearance: float
    seen: float
    pair: tuple[str, str]
    time: float
    proved: bool
    evaluations: int


def curve_of_counts(path: CountPath, unit: Unit) -> Curve:
    """The motion that the controller makes from integer segments."""
    knots = path.knots()
    control = [_bernstein(start, segment) for start, segment in zip(knots, path.segments, strict=False)]
    points = np.array(control or [np.repeat(knots[:1], 4, axis=0)], dtype=float)
    ends = np.cumsum([s.duration_ms for s in path.segments] or [0]) / 1e3
    return Curve(unit.positions(points), ends)


def curve_of_waypoints(waypoints: npt.ArrayLike) -> Curve:
    """Straight joint lines between way-points (m, n) rad; line i ends at parameter i + 1."""
    q = np.asarray(waypoints, dtype=float)
    fractions = np.array([0.0, 1.0, 2.0, 3.0])[:, None] / 3.0
    control = q[:-1, None, :] + (q[1:] - q[:-1])[:, None, :] * fractions
    return Curve(control, np.arange(1.0, len(q)))


def _bernstein(start: npt.NDArray[np.int64], segment: Segment) -> Array:
    """Control points (4, 6) in counts of a segment of order 1 to 3."""
    rows = np.zeros((3, len(start)))
    rows[: len(segment.coefficients)] = segment.coefficients
    a1, a2, a3 = rows
    return np.asarray(
        start + np.stack([0.0 * a1, a1 / 3.0, (2.0 * a1 + a2) / 3.0, a1 + a2 + a3]), dtype=float
    )


def check_move(world: World, path: CountPath, unit: Unit, clearance: float, tight: bool = True) -> MoveCheck:
    """Prove how far the bodies of `world` stay apart while the controller executes `path`.

    Args:
        world: bodies and pairs.
        path: integer segments, as they are sent.
        unit: whose counts they are.
        clearance: asked for, m.
        tight: report the clearance to `TIGHT_RELATIVE` or `TIGHT_ABSOLUTE`; otherwise stop as soon as the asked
            clearance is proved or refuted (the cheap way).
    """
    return check_curve(world, curve_of_counts(path, unit), clearance, tight)


def check_curve(world: World, curve: Curve, clearance: float, tight: bool = False) -> MoveCheck:
    """`check_move` for any chain of cubics in joint space."""
    return _Search(world, curve, clearance, tight).run()


@dataclass(frozen=True)
class _Piece:
    """Part of the curve, still to be proved for `pairs`. `begin` and `end` count cubics from the start of the curve."""

    control: Array  # (m, 4, n)
    begin: float
    end: float
    pairs: Indices

    def middle(self) -> Array:
        """The configuration in the middle of the piece; on the curve."""
        if len(self.control) > 1:
            return np.asarray(self.control[len(self.control) // 2, 0])
        b0, b1, b2, b3 = self.control[0]
        return np.asarray((b0 + 3.0 * (b1 + b2) + b3) / 8.0)

    def cut(self) -> float:
        """Where the middle is, in cubics from the start of the curve."""
        if len(self.control) > 1:
            return self.begin + len(self.control) // 2
        return (self.begin + self.end) / 2.0

    def halves(self, pairs: Indices) -> tuple[_Piece, _Piece]:
        """The parts before and after the middle, to be proved for `pairs`."""
        if len(self.control) > 1:
            m = len(self.control) // 2
            first, second = self.control[:m], self.control[m:]
        else:
            b0, b1, b2, b3 = self.control[0]
            c0, c1, c2 = (b0 + b1) / 2.0, (b1 + b2) / 2.0, (b2 + b3) / 2.0  # de Casteljau
            d0, d1 = (c0 + c1) / 2.0, (c1 + c2) / 2.0
            e = (d0 + d1) / 2.0
            first, second = np.stack([b0, c0, d0, e])[None], np.stack([e, d1, c2, b3])[None]
        at = self.cut()
        return _Piece(first, self.begin, at, pairs), _Piece(second, at, self.end, pairs)


class _Search:
    """Best-first bisection: the piece with the smallest bound is looked at next."""

    def __init__(self, world: World, curve: Curve, clearance: float, tight: bool) -> None:
        self.world, self.curve, self.clearance, self.tight = world, curve, clearance, tight
        self.seen, self.seen_pair, self.seen_at = float("inf"), -1, 0.0
        self.settled = float("inf")  # least bound among pairs and pieces that are not looked at again
        self.evaluations = 0

    def enough(self) -> float:
        """A bound of at least this needs no more work."""
        if not self.tight:
            return self.clearance
        if np.isinf(self.seen):
            return float("inf")
        near = self.seen - max(TIGHT_ABSOLUTE, TIGHT_RELATIVE * self.seen)
        # near is not enough where it leaves open whether the asked clearance is kept
        return max(near, self.clearance) if self.seen >= self.clearance else near

    def refuted(self) -> bool:
        """Whether more work cannot change the verdict."""
        if self.tight:
            return self.seen < 0.0
        return min(self.seen, self.settled) < self.clearance

    def run(self) -> MoveCheck:
        root = _Piece(
            self.curve.control, 0.0, float(len(self.curve.control)), np.arange(len(self.world.pairs))
        )
        heap = [(-float("inf"), 0, root)]
        number = 1  # breaks ties, so that the order is the same each time
        while heap and heap[0][0] < self.enough() and not self.refuted() and self.evaluations < BUDGET:
            _, _, piece = heapq.heappop(heap)
            bound, left = self.look(piece)
            if len(left):
                for half in piece.halves(left):
                    heapq.heappush(heap, (bound, number, half))
                    number += 1
        unfinished = heap[0][0] if heap else float("inf")
        lower = min(self.settled, unfinished, self.seen)
        return MoveCheck(
            clearance=lower,
            seen=self.seen,
            pair=self.world.pair_names(self.seen_pair) if self.seen_pair >= 0 else ("", ""),
            time=self.time(self.seen_at),
            proved=lower >= self.clearance,
            evaluations=self.evaluations,
        )

    def look(self, piece: _Piece) -> tuple[float, Indices]:
        """Distances in the middle of a piece; the bound and the pairs that it does not settle."""
        self.evaluations += 1
        q = piece.middle()
        delta = np.abs(piece.control - q).max(axis=(0, 1))
        motion = self.world.pair_motion(self.world.motion_radii(q), delta)[piece.pairs]
        distances = self.world.pair_distances(q, piece.pairs)
        if len(distances) and distances.min() < self.seen:
            closest = int(np.argmin(distances))
            self.seen, self.seen_pair, self.seen_at = (
                float(distances[closest]),
                int(piece.pairs[closest]),
                piece.cut(),
            )
        bounds = distances - DISTANCE_ERROR - motion
        open_ = (bounds < self.enough()) & (motion > RESOLUTION)
        self.settled = min(self.settled, float(bounds[~open_].min(initial=np.inf)))
        return float(bounds[open_].min(initial=np.inf)), piece.pairs[open_]

    def time(self, at: float) -> float:
        """Time (or path parameter) at a place counted in cubics."""
        index = min(int(at), len(self.curve.ends) - 1)
        begin = float(self.curve.ends[index - 1]) if index else 0.0
        return begin + (at - index) * (float(self.curve.ends[index]) - begin)
