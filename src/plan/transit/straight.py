"""The straight joint line between two configurations: clear at samples, or the place where it is blocked."""

from __future__ import annotations

from dataclasses import dataclass

from arm.se3 import Array
from plan.collision.certificate import ClearanceCertificate
from plan.collision.search_margin import MARGIN, searched_clearance
from plan.collision.world import World
from plan.transit.edges import SampledEdges

_DENSE = 0.05  # rad summed over the joints, between samples


@dataclass(frozen=True, eq=False)
class StraightLine:
    """A straight line from a to b, (n,) rad, in one world.

    Attributes:
        clearance: clearance of the search, m: the required one plus a margin.
        clear: whether it keeps its clearance, at samples.
        at: fraction of the line at which it is blocked.
        end: ``from`` or ``to`` if that end itself has less than the required clearance, else None.
        check: its certificate if it was refuted by that, else None.
    """

    a: Array
    b: Array
    clearance: float
    clear: bool
    at: float
    end: str | None = None
    check: ClearanceCertificate | None = None

    def seen(self, world: World) -> ClearanceCertificate:
        """Return its certificate, or the distance where it is blocked.

        This distance is computed only here, because hundreds of lines may be blocked.
        """
        return self.check or sampled(world, self.a + self.at * (self.b - self.a), self.at)


def check_straight(world: World, a: Array, b: Array, asked: float, margin: float = MARGIN) -> StraightLine:
    """Return the straight line from a to b (n,) rad, clear or blocked. It is checked at samples, which prove nothing.

    Args:
        world: bodies to avoid.
        a, b: its ends; they need only the required clearance.
        asked: required clearance, m.
        margin: added to it if the ends allow it, m (`plan.collision.search_margin`).
    """
    for end, at, q in (("from", 0.0, a), ("to", 1.0, b)):
        if world.in_collision(q, asked):
            return StraightLine(a, b, asked, False, at, end)
    clearance = searched_clearance(world, (a, b), asked, margin)
    blocked = SampledEdges(world.too_near(clearance), _DENSE).blocked(a, b)
    return StraightLine(a, b, clearance, blocked is None, blocked or 0.0)


def sampled(world: World, q: Array, at: float) -> ClearanceCertificate:
    """Return the distance at one configuration (n,) rad as a certificate that proves nothing."""
    closest = world.distance(q)
    return ClearanceCertificate(closest.value, closest.value, closest.pair, at, False, 1)
