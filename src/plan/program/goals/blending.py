"""Corners of the tool's way that may be cut: how much of two straight lines a cut takes away."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm.numerics.angles import arccos
from arm.numerics.products import mul
from plan.motion.phase import Join
from plan.program.goals.line_chains import LinearMove
from plan.program.goals.target import Target

_MOST = 0.4  # of a line that a cut may take at each end
_BACK = -0.98  # cosine of a change of direction that is a way back, where there is no corner to cut
_FLATTEST = 0.05  # sine of half the change of direction below which a corner is taken for one of this


def join_of(
    before: LinearMove | None, after: LinearMove | None, at: Target | None, targets: Sequence[Target]
) -> Join:
    """Return how a phase meets the one before it.

    Args:
        before, after: the lines of both phases; None for a transit.
        at: target between them, or None.
        targets: of the program.
    """
    if before is not None and after is not None:
        return Join(
            blend_radius=_corner(before, after, targets).blend_radius,
            cut=blend_distance(before, after, targets),
        )
    if before is None and after is None and at is not None:
        return Join(blend_radius=at.blend_radius)
    return Join()


def _corner(before: LinearMove, after: LinearMove, targets: Sequence[Target]) -> Target:
    """The target of a corner; the one at the far end of an approach or a retract belongs to its target."""
    return targets[before.target if after.role != "approach" else after.target]


def blend_distance(before: LinearMove, after: LinearMove, targets: Sequence[Target]) -> float:
    """How far from the corner of two lines a straight way across passes it at its `blend_radius`; m, 0 for none.

    From a point's distance r before the corner to one r after it the way passes the corner at r sin(turn / 2).
    A corner at which the tool only turns is not cut, nor one at which it has to be at rest or
    turns back, or what may touch changes.
    """
    target = _corner(before, after, targets)
    at_target = after.role == "retract" or after.role == "line"
    if before.role == "retract":
        at_target = False
    if target.blend_radius == 0.0 or (at_target and target.stops):
        return 0.0
    if targets[before.target].pairs != targets[after.target].pairs:
        return 0.0
    if min(before.line.length, after.line.length) < 1e-6:
        return 0.0
    one = (before.line.T_end - before.line.T_start)[:3, 3] / before.line.length
    two = (after.line.T_end - after.line.T_start)[:3, 3] / after.line.length
    if mul(one, two) < _BACK:
        return 0.0
    sine = float(np.sin(0.5 * arccos(mul(one, two))))
    return float(
        min(target.blend_radius / max(sine, _FLATTEST), _MOST * before.line.length, _MOST * after.line.length)
    )
