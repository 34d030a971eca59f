"""Ends of a transit with less than the required clearance: the line at such an end is certified with what it has."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.controller.unit import Limits
from arm.se3 import Array, frozen
from plan.collision.bezier import curve_of_waypoints
from plan.collision.certificate import certify_curve
from plan.collision.world import World
from plan.transit.edges import SampledEdges

_ATTEMPTS = 400
_OFFSET = 2e-3  # rad, by which the standard deviation of a way-point from the end grows with each attempt
_FEW_JOINTS = 0.5  # share of the way-points that keep a joint where it is at the end
_RESOLUTION = 0.05  # rad summed over the joints, of samples before a proof
_ROUNDING = 1e-4  # m, by which the certified clearance of the line may be less than the end's distance


@dataclass(frozen=True)
class NearEnd:
    """An end with less than the required clearance.

    Attributes:
        end: ``from`` or ``to``.
        pair: the bodies that are too near there.
        distance: between them, m.
        clearance: certified on the straight joint line between the end and `waypoint`, m.
        waypoint: (n,) rad, the next way-point, which has the required clearance.
    """

    end: str
    pair: tuple[str, str]
    distance: float
    clearance: float
    waypoint: Array


def leave_near_end(
    world: World, limits: Limits, end: str, q: Array, clearance: float, rng: np.random.Generator
) -> NearEnd | None:
    """Return a certified straight joint line from an end; None if bodies touch there, or none was found.

    Args:
        world: bodies to avoid.
        limits: joint limits.
        end: ``from`` or ``to``.
        q: (n,) rad, the end.
        clearance: required clearance, m; the way-point has it, the line has only that of the end.
        rng: source of all random choices.
    """
    closest, too_near = world.distance(q), world.too_near(clearance)
    through = SampledEdges(world.too_near(0.0), _RESOLUTION)  # cheaper than a proof that fails
    kept = closest.value - _ROUNDING
    if kept < 0.0:
        return None
    for attempt in range(1, _ATTEMPTS + 1):
        offset = attempt * _OFFSET * rng.normal(size=len(q)) * (rng.random(len(q)) >= _FEW_JOINTS)
        away = np.clip(q + offset, limits.lower, limits.upper)
        if too_near(away) or not through.clear(q, away):
            continue
        if certify_curve(world, curve_of_waypoints([q, away]), kept).proved:
            return NearEnd(end, closest.pair, closest.value, kept, frozen(away))
    return None
