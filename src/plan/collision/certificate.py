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
pairs is cut (a run in two, a cubic in four); pairs that are proved need not be looked at again in its parts. Every
distance is counted as `plan.collision.world.DISTANCE_ERROR` shorter than it was computed.

**The planes.** What a small motion does to first order is known better than its length. From the frame of joint i,
the motion delta takes p to T_{i+1} .. T_j p, where T_k turns by delta_k about the axis of joint k (direction a_k,
through o_k) as it stands at q. Let p' = T_{k+1} .. T_j p; by the bound, |p' - p| <= sum over l > k of |delta_l| r_l.
With R_k the rotation of T_k,

    T_k p' - p'  =  (R_k - 1)(p - o_k) + (R_k - 1)(p' - p),

and the second term is at most |delta_k| |p' - p|, the first differs from delta_k a_k x (p - o_k) by at most
r_k delta_k^2 / 2. (A sliding joint adds delta_k a_k exactly.) The sum over k: p moves by
sum of delta_k a_k x (p - o_k), and by no more than

    sum over k of r_k |delta_k| (|delta_k| / 2 + sum over i < l < k of |delta_l|)

besides. For a unit vector n, n . p then grows by a linear form in delta and p less that remainder: over a motion in the
hull of some configurations the least of it is at one of these, and over a body it is its support in a direction. The
distance of two bodies is at least that least, less what the inner body reaches along n (`Volumes.plane_distances`).

Pieces of one depth are looked at together. For each pair, balls and boxes around the bodies
(`plan.collision.bounds`) give a first lower bound of d; where that is enough, no distance is computed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from arm.arguments import finite
from arm.controller.segments import CountPath
from arm.controller.unit import Unit
from arm.errors import InputError
from arm.se3 import Array
from plan.budget import PROOF_LOOKS, spend
from plan.collision.bezier import Curve, curve_of_counts
from plan.collision.subdivision import Chain, Pieces
from plan.collision.world import DISTANCE_ERROR, Indices, World

# Tight mode stops when the bound is this close to the smallest distance seen: the larger of m and a fraction of it.
TIGHT_ABSOLUTE = 5e-4
TIGHT_RELATIVE = 0.05
# A piece in which nothing moves further than this (m) and that is still not proved is at the limit of the arithmetic.
RESOLUTION = 2e-5
# Pieces looked at before giving up; what is proved by then is returned.
BUDGET = 20_000


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
        bounds: of every cubic (segment), lower bounds that were proved, m; those that nothing comes near may be as low
            as what was enough for the verdict.
    """

    clearance: float
    seen: float
    pair: tuple[str, str]
    time: float
    proved: bool
    evaluations: int
    bounds: tuple[float, ...] = ()


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
    """`check_move` for any chain of cubics in joint space.

    The work is bounded: after `BUDGET` pieces (seconds to ten, on lines of thousands of turns or that graze along their
    whole length) the search ends with what is proved by then. That is never a wrong answer: `proved` is then False,
    which means "not proved", not "collides"; `seen` tells whether something really came too near. Cut such a curve
    into shorter ones and check each.

    Args:
        world: bodies and pairs.
        curve: see `curve_of_waypoints`.
        clearance: asked for, m.
        tight: as in `check_move`.

    Raises:
        InputError: no cubics, of another number of joints than the arm's, or a number that is not finite.
    """
    finite("clearance", clearance, "m")
    n, control, ends = int(world.robot.model.nq), np.asarray(curve.control), np.asarray(curve.ends)
    if (
        control.ndim != 3
        or not len(control)
        or control.shape[1:] != (4, n)
        or ends.shape != control.shape[:1]
    ):
        raise InputError(
            f"curve: control points of shape {control.shape} with {ends.shape} ends: must be (m, 4, {n}) and (m,), "
            f"m at least 1, for an arm of {n} joints",
            shape=list(control.shape),
            joints=n,
        )
    if not np.isfinite(control).all():
        raise InputError(
            "curve: a control point is not finite; must be rad (m for sliding joints)", name="curve"
        )
    return _Search(world, curve, clearance, tight).run()


class _Search:
    """Bisection, all pieces of a depth together."""

    def __init__(self, world: World, curve: Curve, clearance: float, tight: bool) -> None:
        self.world, self.curve, self.clearance, self.tight = world, curve, clearance, tight
        self.seen, self.seen_pair, self.seen_at = float("inf"), -1, 0.0
        self.bounds = np.full(len(curve.control), np.inf)  # of each cubic, over what is settled
        self.evaluations = 0

    def enough(self) -> float:
        """A bound of at least this needs no more work."""
        if not self.tight:
            return self.clearance
        near = self.seen - max(TIGHT_ABSOLUTE, TIGHT_RELATIVE * self.seen)
        # near is not enough where it leaves open whether the asked clearance is kept
        return max(near, self.clearance) if self.seen >= self.clearance else near

    def refuted(self) -> bool:
        """Whether more work cannot change the verdict."""
        if self.tight:
            return self.seen < 0.0
        return min(self.seen, float(self.bounds.min(initial=np.inf))) < self.clearance

    def run(self) -> MoveCheck:
        chain, world = Chain(self.curve), self.world
        pieces = chain.first_pieces(len(world.pairs))
        if self.tight and len(world.pairs):
            # a first distance that was really seen; without one, nothing is enough
            some = len(pieces) // 2
            every = np.arange(len(world.pairs))
            at = np.full(len(every), pieces.cuts()[some])
            self.note(world.pair_distances(pieces.middle[some], every), every, at)
        first = True
        while len(pieces) and not self.refuted() and self.evaluations < BUDGET:
            pieces, first = self.look(pieces, first), False
            if len(pieces) and not self.refuted():
                pieces = chain.finer(pieces)
        self.settle(pieces, pieces.bound)
        lower = min(float(self.bounds.min(initial=np.inf)), self.seen)
        return MoveCheck(
            clearance=lower,
            seen=self.seen,
            pair=world.pair_names(self.seen_pair) if self.seen_pair >= 0 else ("", ""),
            time=self.time(self.seen_at),
            proved=lower >= self.clearance,
            evaluations=self.evaluations,
            bounds=tuple(self.bounds.tolist()),
        )

    def look(self, pieces: Pieces, first: bool) -> Pieces:
        """Bounds around the middle of each piece; what they do not settle is returned.

        Balls and boxes are asked the first time only: what they left open then, they rarely settle in smaller pieces.
        """
        spend(PROOF_LOOKS * len(pieces))
        world, volumes, enough = self.world, self.world.volumes, self.enough()
        at = volumes.placed(pieces.middle)
        settled = np.full(len(pieces), np.inf)
        if first:
            rough = volumes.distances(at) - (volumes.motion(at, pieces.reach) + world.paddings)
            open_ = rough < enough
            settled = np.where(open_, np.inf, rough).min(axis=1, initial=np.inf)
        else:
            open_ = pieces.open
        row, pair = np.nonzero(open_)
        bound = rough[row, pair] if first else np.full(len(row), -np.inf)
        motion = volumes.motion_of(at, pieces.reach, row, pair)
        seen = world.witnesses(pieces.middle, row, pair, -np.inf if self.tight else self.clearance)
        self.evaluations += len(pieces)
        count = len(seen.distance)
        self.note(seen.distance, pair[:count], pieces.cuts()[row[:count]])
        proved = seen.distance - DISTANCE_ERROR - motion[:count]
        bound[:count] = np.maximum(bound[:count], proved)
        if not self.refuted():
            enough = self.enough()
            wanting = np.flatnonzero((bound < enough) & (seen.distance > 0.0))
            planes = volumes.plane_distances(
                at, row[wanting], pair[wanting], seen.normal[wanting], pieces.control, pieces.spread
            )
            bound[wanting] = np.maximum(bound[wanting], planes - world.paddings[pair[wanting]])
        left = (bound < enough) & (motion > RESOLUTION)
        np.minimum.at(settled, row[~left], bound[~left])
        self.settle(pieces, settled)
        least, open_ = np.full(len(pieces), np.inf), np.zeros_like(open_)
        np.minimum.at(least, row[left], bound[left])
        open_[row[left], pair[left]] = True
        return replace(pieces, bound=least, open=open_).where(np.asarray(open_.any(axis=1)))

    def note(self, distances: Array, pairs: Indices, at: Array) -> None:
        """Remember the smallest distance."""
        if not len(distances):
            return
        closest = int(np.argmin(distances))
        if distances[closest] < self.seen:
            self.seen, self.seen_pair = float(distances[closest]), int(pairs[closest])
            self.seen_at = float(at[closest])

    def settle(self, pieces: Pieces, bound: Array) -> None:
        """Lower the bounds (m,) of the cubics that the pieces are of."""
        parts = ~pieces.runs()
        np.minimum.at(self.bounds, pieces.first[parts], bound[parts])
        for first, last, least in zip(pieces.first[~parts], pieces.last[~parts], bound[~parts], strict=True):
            np.minimum(self.bounds[first:last], least, out=self.bounds[first:last])

    def time(self, at: float) -> float:
        """Time (or path parameter) at a place counted in cubics."""
        index = min(int(at), len(self.curve.ends) - 1)
        begin = float(self.curve.ends[index - 1]) if index else 0.0
        return begin + (at - index) * (float(self.curve.ends[index]) - begin)
