"""Blends at corners of the tool's path: the length that a blend removes from each of two lines."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm.numerics.angles import arccos
from arm.numerics.products import mul
from arm.se3 import Array
from plan.kinematics.straight_line import Line
from plan.motion.phase import Join, LinearPath
from plan.program.goals.linear_move import LinearMove
from plan.program.goals.target import Target

_MOST = 0.4  # largest fraction of a line that a blend may remove at either end
_BACK = -0.98  # cosine of the change of direction beyond which the tool reverses, and no blend is possible
_FLATTEST = 0.05  # least sine of half the change of direction in the formula of the blend distance


def join_of(
    before: LinearPath | Array, after: LinearPath | Array, at: Target | None, targets: Sequence[Target]
) -> Join:
    """Return how a phase meets the one before it.

    Args:
        before, after: the paths of both phases: lines of chains, or way-points of transits.
        at: target between them, or None.
        targets: those of the program.
    """
    if isinstance(before, LinearMove) and isinstance(after, LinearMove):
        return Join(
            blend_radius=_corner(before, after, targets).blend_radius,
            cut=blend_distance(before, after, targets),
        )
    if at is None or isinstance(before, LinearMove) or isinstance(after, LinearMove):
        return Join()
    return Join(blend_radius=at.blend_radius)


def _corner(before: LinearMove, after: LinearMove, targets: Sequence[Target]) -> Target:
    """Return the target of a corner; the far end of an approach or retract belongs to the same target as the line."""
    return targets[before.target if after.role != "approach" else after.target]


def blend_distance(before: LinearMove, after: LinearMove, targets: Sequence[Target]) -> float:
    """Return the length that a blend removes from each of two lines, m; 0 if their corner is not blended.

    A straight segment between the points at distance r before and after the corner passes the corner at a distance of
    r sin(change of direction / 2), at most the target's `blend_radius`. There is no blend where the tool only rotates,
    stops or reverses, where the allowed collisions change, or at the end of a path.
    """
    if not (isinstance(before.line, Line) and isinstance(after.line, Line)):
        return 0.0
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
