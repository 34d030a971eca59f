"""Certificates of clearance over a whole motion, between samples as well as at them.

**Motion bound.** Let q and q' be two configurations, and p a point fixed to a body on joint i. Then

    |p(q') - p(q)|  <=  sum over k <= i of |q'_k - q_k| r_k,      r_k = distance of p(q) from the axis of joint k at q.

Proof: change the joints one at a time, starting at the base: q^0 = q, and q^k is q^(k-1) with its k-th entry replaced
by q'_k, so p(q^i) = p(q'). From q^(k-1) to q^k only joint k rotates, by q'_k - q_k. So p moves on a circle about that
joint's axis, by a chord 2 r sin(|q'_k - q_k| / 2) <= r |q'_k - q_k|, where r is the distance of p from the axis. Joints
1 to k move p and the axis alike and do not change r; joints k + 1 to i still have their values of q. So r is the
distance r_k at q itself. (A prismatic joint moves p by |q'_k - q_k|: r_k = 1.) The triangle inequality sums the chords.
The bound holds for every path from q to q', so no maximum over the path is needed.

For two bodies, a on joint i and b on joint j >= i, take the frame of joint i. Only joints i + 1 to j move b relative to
a, and the distance of the two drops by at most m = sum over i < k <= j of delta_k R_k, where delta_k bounds
|q'_k - q_k| and R_k is the largest r_k over b's points (`Placed.radii`, `DistanceBounds.motion_of`). Hence, if the
pair has distance d at q, it has at least d - m at every q' with |q'_k - q_k| <= delta_k.

**Subdivision.** A motion is a chain of cubics. Each stays between the least and greatest of its four Bernstein control
points. A piece is a run of whole cubics, or a part of one; q is the configuration in its middle, and delta_k the
largest deviation of a control point from q in joint k. A piece that is not proved for all pairs is cut (a run in two,
a cubic in four); its parts are checked only for the pairs that are still open. `plan.collision.world.DISTANCE_ERROR`
is subtracted from every computed distance.

**Separating planes.** The first-order effect of a small motion is known better than its length. In the frame of
joint i, the motion delta maps p to T_{i+1} .. T_j p, where T_k rotates by delta_k about the axis of joint k at q
(direction a_k, through o_k). Let p' = T_{k+1} .. T_j p; by the motion bound, |p' - p| <= sum over l > k of
|delta_l| r_l. With R_k the rotation of T_k,

    T_k p' - p'  =  (R_k - 1)(p - o_k) + (R_k - 1)(p' - p).

The first term differs from delta_k a_k x (p - o_k) by at most r_k delta_k^2 / 2; the second is at most
|delta_k| |p' - p|. (A prismatic joint adds delta_k a_k exactly.) Summed over k, the motion of p is
sum of delta_k a_k x (p - o_k) up to a remainder of at most

    sum over k of r_k |delta_k| (|delta_k| / 2 + sum over i < l < k of |delta_l|).

For a unit vector n, n . p therefore grows by at least a linear form in delta and p, less that remainder. Over a motion
in the hull of some configurations the form is least at one of them; over a body its minimum is a support function. The
distance of two bodies is at least that minimum, less the support of the inner body along n
(`DistanceBounds.plane_distances`).

**Errors of the joints.** An arm whose joints are off by e is at q + e where it should be at q. By the motion bound, the
distance of a pair is smaller by at most the sum over i < k <= j of |e_k| R_k. If e lies in the ellipsoid
e' inv(C) e <= s^2 (s standard deviations of errors with covariance C), that sum is at most s sqrt(R' |C| R), |C| entry
by entry (Cauchy-Schwarz for every choice of signs). Over a piece R_k grows by at most the motion of the outer body.
`ArmErrors` has C and s; what is proved then holds for every e of the ellipsoid, the same or another at each instant.

Pieces of one depth are processed together. Balls and boxes around the bodies (`plan.collision.bounds`) give a first
lower bound of d for each pair; where it is enough, no distance is computed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm.arguments import finite
from arm.controller.segments import CountPath
from arm.controller.unit import Unit
from arm.errors import InputError
from arm.former import former_names
from arm.numerics.products import mul
from arm.se3 import Array, Indices
from plan.budget import PIECE_CHECKS, spend
from plan.collision.bezier import Curve, curve_of_counts
from plan.collision.subdivision import CurveIntervals, CurveSubdivision
from plan.collision.world import DISTANCE_ERROR, World

# Tight mode stops when the bound is within TIGHT_ABSOLUTE (m) of the smallest distance computed so far, or within
# TIGHT_RELATIVE times that distance, whichever is larger.
TIGHT_ABSOLUTE = 5e-4
TIGHT_RELATIVE = 0.05
RESOLUTION = 2e-5  # m; a piece with less motion than this is not cut any further
_ERROR_PIECES = 8  # of a curve, for each of which the arm's levers are bounded at once
BUDGET = 20_000  # pieces; then the search stops with the bounds that it has


@dataclass(frozen=True, eq=False)
class ArmErrors:
    """Errors of the joints that a certificate allows for.

    Attributes:
        covariance: of the joint positions, (n, n) rad^2 (m^2 for prismatic joints).
        sigmas: standard deviations to allow for.
        shift: further motion of any body, m, such as by errors of the links.
    """

    covariance: Array
    sigmas: float
    shift: float = 0.0

    def motion(self, radii: Array) -> Array:
        """Return the largest displacements (k,) m of points at distances (k, n) m from the joints' axes."""
        square = (mul(radii, np.abs(self.covariance)) * radii).sum(axis=1)
        return np.asarray(self.sigmas * np.sqrt(np.maximum(square, 0.0)) + self.shift)


@dataclass(frozen=True)
class ClearanceCertificate:
    """Proved clearance of a motion.

    Attributes:
        clearance: proved lower bound on the distance of every checked pair over the whole motion, m.
        seen: smallest computed distance on the motion, m; the true minimum lies between `clearance` and `seen`.
        pair: the two bodies at `seen`.
        time: time of `seen` on the motion, s.
        proved: whether `clearance` is at least the required clearance.
        evaluations: number of configurations evaluated.
        bounds: proved lower bound for every cubic (segment), m; it need not be tight where bodies are far apart.
    """

    clearance: float
    seen: float
    pair: tuple[str, str]
    time: float
    proved: bool
    evaluations: int
    bounds: tuple[float, ...] = ()


def certify_move(
    world: World,
    path: CountPath,
    unit: Unit,
    clearance: float,
    tight: bool = True,
    errors: ArmErrors | None = None,
) -> ClearanceCertificate:
    """Prove the clearance of the bodies of `world` while the controller executes `path`.

    Args:
        world: bodies and pairs.
        path: integer segments, as sent to the controller.
        unit: unit that the counts belong to.
        clearance: required clearance, m.
        tight: find the clearance to within `TIGHT_RELATIVE` or `TIGHT_ABSOLUTE`; otherwise stop as soon as the
            required clearance is proved or refuted, which is cheaper.
        errors: of the joints; all distances are smaller by what they may move the arm. None: the arm is exact.
    """
    return certify_curve(world, curve_of_counts(path, unit), clearance, tight, errors)


def certify_curve(
    world: World, curve: Curve, clearance: float, tight: bool = False, errors: ArmErrors | None = None
) -> ClearanceCertificate:
    """`certify_move` for any chain of cubics in joint space.

    The search stops after `BUDGET` pieces. A line of thousands of revolutions, or one that grazes a body along its
    whole length, reaches this limit after 1 to 10 s. `proved` is then False, which means "not proved", not "in
    collision"; `seen` shows how near the bodies came. Certify such a curve in shorter parts.

    Args:
        world: bodies and pairs.
        curve: see `curve_of_waypoints`.
        clearance: required clearance, m.
        tight, errors: as in `certify_move`.

    Raises:
        InputError: the curve has no cubics, another number of joints than the arm, or a number that is not finite.
    """
    finite("clearance", clearance, "m")
    n, control, ends = int(world.robot.model.nq), np.asarray(curve.control), np.asarray(curve.ends)
    fits = control.ndim == 3 and control.shape[1:] == (4, n) and ends.shape == control.shape[:1]
    if not fits or not len(control):
        why = (
            f"curve: control points of shape {control.shape} with {ends.shape} ends: must be (m, 4, {n}) and (m,), "
            f"m at least 1, for an arm of {n} joints"
        )
        raise InputError(why, shape=list(control.shape), joints=n)
    if not np.isfinite(control).all():
        why = "curve: a control point is not finite; must be rad (m for prismatic joints)"
        raise InputError(why, name="curve")
    if errors is not None and errors.covariance.shape != (n, n):
        shape = errors.covariance.shape
        raise InputError(
            f"errors: covariance of shape {shape}: must be ({n}, {n})", shape=list(shape), joints=n
        )
    return _Search(world, curve, clearance, tight, errors).run()


def moved_by_errors(world: World, curves: Sequence[Curve], errors: ArmErrors) -> list[Array]:
    """Return how far errors may move any body of the arm during each cubic, (m,) m for each curve of m cubics.

    What is proved of an exact arm less this holds for the erring one. It is cheaper than a certificate with errors and
    less tight: every pair is taken to lose what the body loses that the errors move most.

    Args:
        world: with the arm and the held body; others are not used.
        curves: motions of this arm.
        errors: of the joints.
    """
    sizes = [len(curve.control) for curve in curves]
    cuts = [np.linspace(0, n, min(n, _ERROR_PIECES) + 1).astype(np.intp) for n in sizes]
    first = np.concatenate([start + of[:-1] for start, of in zip(np.cumsum([0, *sizes]), cuts, strict=False)])
    control = np.concatenate([curve.control for curve in curves])
    low = np.minimum.reduceat(control.min(axis=1), first)
    high = np.maximum.reduceat(control.max(axis=1), first)
    radii = world.volumes.placed((low + high) / 2.0).radii
    motion = (radii * ((high - low) / 2.0)[:, None, :]).sum(axis=2, keepdims=True)
    levers = radii + motion * (radii > 0.0)
    moved = errors.motion(levers.reshape(-1, levers.shape[2])).reshape(levers.shape[:2])
    each = np.repeat(moved.max(axis=1, initial=0.0), np.diff([*first, sum(sizes)]))
    return np.split(each, np.cumsum(sizes)[:-1])


class _Search:
    """Bisection that processes all pieces of a depth together."""

    def __init__(
        self, world: World, curve: Curve, clearance: float, tight: bool, errors: ArmErrors | None
    ) -> None:
        self.world, self.curve, self.clearance, self.tight = world, curve, clearance, tight
        self.errors = errors
        self.seen, self.seen_pair, self.seen_at = float("inf"), -1, 0.0
        self.bounds = np.full(len(curve.control), np.inf)  # of each cubic, over its settled pieces
        self.evaluations = 0

    def enough(self) -> float:
        """Return the lower bound, m, at which a pair needs no further subdivision."""
        if not self.tight:
            return self.clearance
        near = self.seen - max(TIGHT_ABSOLUTE, TIGHT_RELATIVE * self.seen)
        # a tight bound does not suffice while the verdict is open
        return max(near, self.clearance) if self.seen >= self.clearance else near

    def refuted(self) -> bool:
        """Return whether further subdivision cannot change the verdict."""
        if self.tight:
            return self.seen < 0.0
        return min(self.seen, float(self.bounds.min(initial=np.inf))) < self.clearance

    def run(self) -> ClearanceCertificate:
        chain, world = CurveSubdivision(self.curve), self.world
        pieces = chain.first_pieces(len(world.pairs))
        if self.tight and len(world.pairs):
            # start from one computed distance; `enough` needs it
            some = len(pieces) // 2
            every = np.arange(len(world.pairs))
            at = np.full(len(every), pieces.cuts()[some])
            distances = world.pair_distances(pieces.middle[some], every)
            if self.errors is not None:
                placed = world.volumes.placed(pieces.middle[some : some + 1])
                distances -= self.errors.motion(world.volumes.levers(placed, np.zeros_like(every), every))
            self.note(distances, every, at)
        first = True
        while len(pieces) and not self.refuted() and self.evaluations < BUDGET:
            pieces, first = self.look(pieces, first), False
            if len(pieces) and not self.refuted():
                pieces = chain.finer(pieces)
        self.settle(pieces, pieces.bound)
        lower = min(float(self.bounds.min(initial=np.inf)), self.seen)
        return ClearanceCertificate(
            clearance=lower,
            seen=self.seen,
            pair=world.pair_names(self.seen_pair) if self.seen_pair >= 0 else ("", ""),
            time=self.time(self.seen_at),
            proved=lower >= self.clearance,
            evaluations=self.evaluations,
            bounds=tuple(self.bounds.tolist()),
        )

    def look(self, pieces: CurveIntervals, first: bool) -> CurveIntervals:
        """Bound the distances around the middle of each piece; return the pieces that stay open.

        Balls and boxes bound the first pieces only. On smaller pieces they rarely settle a pair that they left open.
        """
        spend(PIECE_CHECKS * len(pieces))
        world, volumes, enough = self.world, self.world.volumes, self.enough()
        at = volumes.placed(pieces.middle)
        if first:
            box, shift = self._largest_errors()
            found = volumes.open_pairs(at, enough + shift, pieces.reach + box)
            row, pair, bound, settled = found.row, found.pair, found.bound - shift, found.least - shift
        else:
            row, pair = np.nonzero(pieces.open)
            bound, settled = np.full(len(row), -np.inf), np.full(len(pieces), np.inf)
        levers = volumes.levers(at, row, pair)
        motion = (levers * pieces.reach[row]).sum(axis=1)
        here, there = self._displaced(levers), self._displaced(levers + motion[:, None] * (levers > 0.0))
        seen = world.witnesses(pieces.middle, row, pair, -np.inf if self.tight else self.clearance)
        self.evaluations += len(pieces)
        count = len(seen.distance)
        self.note(seen.distance - here[:count], pair[:count], pieces.cuts()[row[:count]])
        proved = seen.distance - DISTANCE_ERROR - motion[:count] - there[:count]
        bound[:count] = np.maximum(bound[:count], proved)
        if not self.refuted():
            enough = self.enough()
            wanting = np.flatnonzero((bound < enough) & (seen.distance > 0.0))
            planes = volumes.plane_distances(
                at, row[wanting], pair[wanting], seen.normal[wanting], pieces.control, pieces.spread
            )
            planes -= world.paddings[pair[wanting]] + there[wanting]
            bound[wanting] = np.maximum(bound[wanting], planes)
        left = (bound < enough) & (motion > RESOLUTION)
        np.minimum.at(settled, row[~left], bound[~left])
        self.settle(pieces, settled)
        least, open_ = np.full(len(pieces), np.inf), np.zeros_like(pieces.open)
        np.minimum.at(least, row[left], bound[left])
        open_[row[left], pair[left]] = True
        return replace(pieces, bound=least, open=open_).where(np.asarray(open_.any(axis=1)))

    def _largest_errors(self) -> tuple[Array | float, float]:
        """Largest error of each joint, (n,) rad (the box around the ellipsoid), and further motion of any body, m."""
        if self.errors is None:
            return 0.0, 0.0
        return self.errors.sigmas * np.sqrt(np.diag(self.errors.covariance)), self.errors.shift

    def _displaced(self, levers: Array) -> Array:
        """Displacement (k,) m of pairs with levers (k, n) m per rad by the joints' errors."""
        return np.zeros(len(levers)) if self.errors is None else self.errors.motion(levers)

    def note(self, distances: Array, pairs: Indices, at: Array) -> None:
        """Keep the smallest distance."""
        if not len(distances):
            return
        closest = int(np.argmin(distances))
        if distances[closest] < self.seen:
            self.seen, self.seen_pair = float(distances[closest]), int(pairs[closest])
            self.seen_at = float(at[closest])

    def settle(self, pieces: CurveIntervals, bound: Array) -> None:
        """Lower the bounds of the pieces' cubics to `bound` (m,)."""
        parts = ~pieces.runs()
        np.minimum.at(self.bounds, pieces.first[parts], bound[parts])
        for first, last, least in zip(pieces.first[~parts], pieces.last[~parts], bound[~parts], strict=True):
            np.minimum(self.bounds[first:last], least, out=self.bounds[first:last])

    def time(self, at: float) -> float:
        """Return time (or path parameter) at `at` cubics from the start of the curve."""
        index = min(int(at), len(self.curve.ends) - 1)
        begin = float(self.curve.ends[index - 1]) if index else 0.0
        return begin + (at - index) * (float(self.curve.ends[index]) - begin)


former_names(
    __name__,
    __name__,
    MoveCheck="ClearanceCertificate",
    check_move="certify_move",
    check_curve="certify_curve",
)
