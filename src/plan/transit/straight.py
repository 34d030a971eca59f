"""The straight joint line between two configurations: certified, or the place where it is blocked."""

from __future__ import annotations

from dataclasses import dataclass

from arm.se3 import Array
from plan.collision.bezier import curve_of_waypoints
from plan.collision.certificate import ClearanceCertificate, certify_curve
from plan.collision.search_margin import MARGIN, searched_clearance
from plan.collision.world import World
from plan.transit.edges import FIRST_SAMPLES


@dataclass(frozen=True, eq=False)
class StraightLine:
    """A straight line from a to b, (n,) rad, in one world.

    Attributes:
        clearance: clearance of the search, m: the required one plus a margin.
        at: fraction of the line at which it is blocked.
        check: its certificate; None if a sample is blocked.
        end: ``from`` or ``to`` if that end itself has less than the required clearance, else None.
    """

    a: Array
    b: Array
    clearance: float
    at: float
    check: ClearanceCertificate | None
    end: str | None = None

    @property
    def proved(self) -> bool:
        """Whether it keeps its clearance."""
        return self.check is not None and self.check.proved

    def seen(self, world: World) -> ClearanceCertificate:
        """Return its certificate, or the distance at the blocked sample.

        This distance is computed only here, because hundreds of lines may be blocked.
        """
        return self.check or sampled(world, self.a + self.at * (self.b - self.a), self.at)


def check_straight(world: World, a: Array, b: Array, asked: float, margin: float = MARGIN) -> StraightLine:
    """Return the straight line from a to b (n,) rad, certified or blocked. A few samples are checked first.

    Args:
        world: bodies to avoid.
        a, b: its ends; they need only the required clearance.
        asked: required clearance, m.
        margin: added to it if the ends allow it, m (`plan.collision.search_margin`).
    """
    for end, at, q in (("from", 0.0, a), ("to", 1.0, b)):
        if world.in_collision(q, asked):
            return StraightLine(a, b, asked, at, None, end)
    clearance = searched_clearance(world, (a, b), asked, margin)
    for u in FIRST_SAMPLES:
        if world.in_collision(a + u * (b - a), clearance):
            return StraightLine(a, b, clearance, u, None)
    check = certify_curve(world, curve_of_waypoints([a, b]), clearance)
    return StraightLine(a, b, clearance, check.time, check)


def sampled(world: World, q: Array, at: float) -> ClearanceCertificate:
    """Return the distance at one configuration (n,) rad as a certificate that proves nothing."""
    closest = world.distance(q)
    return ClearanceCertificate(closest.value, closest.value, closest.pair, at, False, 1)
