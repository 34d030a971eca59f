"""Checks of the lines and transits of a task, each valid for as many arrangements of the cubes as possible.

The arrangement changes from step to step. So a line or transit is first checked with a cube at every site: if it is
clear, it is clear in every arrangement. If a cube that may be elsewhere blocks it, it is checked again in the present
arrangement.

All of this is checked at samples, because most of what a search looks at is not used. The motions of the best sequence
are certified as they will be sent. If one cannot be, its transit is certified itself (`EdgeChecks.confirm`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm.errors import ImpossibleError
from arm.se3 import Array, Indices, frozen
from plan.budget import TransitBudget
from plan.cartesian.reachability import GraspCandidate
from plan.collision.bezier import curve_of_waypoints
from plan.collision.certificate import ClearanceCertificate, certify_curve
from plan.collision.search_margin import MARGIN, searched_clearance
from plan.collision.world import World
from plan.failure import nearness, short_of
from plan.program.assignment.legs import HOME, Arrangement, Leg, Site
from plan.program.assignment.worlds import TaskWorlds
from plan.program.goals.leg_times import LineEnds
from plan.program.setting import Setting
from plan.transit.edges import SampledEdges
from plan.transit.optimise import Ends
from plan.transit.planner import TransitPlanner
from plan.transit.straight import check_straight, sampled

# Fraction of the search margin that the certificate of a path may lack, because the search checks samples.
_SLACK = 0.5
# Nodes of RRT-Connect while other sequences may do.
_FEW_SAMPLES = 150
# Further optimisation steps for a detour that will be used, and the least useful saving, s.
_POLISH, _WORTH_S = 6, 0.02
_KNOWN_TRAVEL = 0.2  # rad summed over the joints, between samples of a path over known corners
# Steps of the first joint for the check of bodies that only this joint moves, rad.
_PASSING = np.radians(0.25)
_UNCHANGED = 1e-5  # m, largest change of a distance that counts as none
# Search margin that is tried if no detour is found with the whole margin, m.
_LEAST_MARGIN = 1e-4


@dataclass(frozen=True)
class Blocked:
    """What blocks a line or transit.

    Attributes:
        by: the site of a cube that may be elsewhere at another time; None for a fixed body.
        check: the pair of bodies, their distance and the place.
        world, q: where `check` was computed, q (n,) rad.
        end: whether no detour can exist: an end is itself too near, or a body that only the first joint moves has to
            pass there.
    """

    by: Site | None
    check: ClearanceCertificate
    world: World
    q: Array
    end: bool = False


class EdgeChecks:
    """Checks of one task, with their results kept.

    Args:
        setting: limits, clearances, seed, budgets.
        worlds: its collision worlds.
        lines: the lines of every grasp, of each site, and home.
        alike: whether the detour of one leg is assumed for others (`LegCosts.assume_alike`). A detour may then begin
            with the corners of any other.
    """

    def __init__(
        self, setting: Setting, worlds: TaskWorlds, lines: Mapping[Site, LineEnds], alike: bool = False
    ) -> None:
        self.worlds, self.lines, self.alike = worlds, lines, alike
        self.limits, self.options = setting.planned, setting.options
        self._clear_lines: set[tuple[object, ...]] = set()
        self._blocked: dict[tuple[Leg, Arrangement], Blocked] = {}
        self._paths: dict[tuple[Leg, Arrangement], Array] = {}
        self._polished: set[tuple[Leg, Arrangement]] = set()
        self._doubted: set[tuple[Leg, Arrangement]] = set()  # their detours are certified
        self.margin = MARGIN

    def least_margin(self) -> None:
        """Search with the least margin from now on, and check blocked transits again."""
        self.margin = _LEAST_MARGIN
        self._blocked.clear()

    def line(self, grasp: GraspCandidate, site: Site, pick: int, now: Arrangement) -> Blocked | None:
        """Return what blocks a line, with the cube of `pick` in the jaws or without it; None if it is clear.

        A line is checked at samples: it is short, its samples are dense, and what is sent is certified later.

        Args:
            grasp: the grasp with its line.
            site: where the line ends.
            pick: number of the transfer.
            now: arrangement while the jaws are open, this cube included.
        """
        for there in _widest_first(self.worlds.everywhere, now):
            key = (site, grasp.yaw, grasp.branch, pick, there)
            blocked = None if key in self._clear_lines else self._line_check(grasp, site, pick, there)
            if blocked is None:
                self._clear_lines.add(key)
            if blocked is None or blocked.by is None:
                break
        return blocked

    def _line_check(self, grasp: GraspCandidate, site: Site, pick: int, there: Arrangement) -> Blocked | None:
        for world in self._line_worlds(site, pick, there):
            check = _blocking(world, grasp.q_line, self.options.line_clearance)
            if check is not None:
                q = grasp.q_line[int(check.time)]
                return Blocked(self._by(check, there - {site}), check, world, q)
        return None

    def _line_worlds(self, site: Site, pick: int, there: Arrangement) -> Iterator[World]:
        yield self.worlds.empty(there)
        without = there - {site, Site(False, pick)}
        yield self.worlds.holding(pick, without, self.worlds.station(site).touches)

    def straight(self, leg: Leg, now: Arrangement) -> Array | Blocked:
        """Return the straight motion (2, n), or what blocks it; a fixed body blocks it at every time."""
        for there in self._arrangements(leg, now):
            found = self._straight_motion(leg, there)
            if not isinstance(found, Blocked) or found.by is None:
                break
        return found

    def _straight_motion(self, leg: Leg, there: Arrangement) -> Array | Blocked:
        key = leg, there
        if key in self._paths:
            return self._paths[key]
        if key not in self._blocked:
            blocked = self._straight_check(leg, there)
            if blocked is None:
                self._paths[key] = frozen(self._ends(leg))
                return self._paths[key]
            self._blocked[key] = blocked
        return self._blocked[key]

    def around(self, leg: Leg, now: Arrangement, known: Sequence[Array], thorough: bool) -> Array | None:
        """Return a detour (m, n), or None.

        Args:
            leg, now: as in `straight`.
            known: corners (c, n) of detours around the same body, the most promising last.
            thorough: whether to use the whole budget.
        """
        budget = self.options.transit
        if not thorough:
            budget = replace(budget, rrt=min(budget.rrt, _FEW_SAMPLES))
        for there in self._arrangements(leg, now):
            key = leg, there
            if key in self._paths:
                return self._paths[key]
            blocked = self._blocked.get(key)
            if blocked is None or blocked.end:
                continue
            planner = self._planner(leg, there, budget, known)
            if self.alike:
                planner.known = self._first_clear(leg, planner)
            path = planner.around(*self._ends(leg), blocked.check.time)
            if path is not None:
                self._paths[key] = frozen(path)
                return self._paths[key]
        return None

    def _first_clear(self, leg: Leg, planner: TransitPlanner) -> list[Array]:
        """Return the most promising known corners over which a path is clear at samples, or an empty list.

        Without them corners are drawn and trees are grown, which costs far more than these checks.
        """
        edges, (q_from, q_to) = SampledEdges(planner.too_near, _KNOWN_TRAVEL), self._ends(leg)
        for corners in reversed(planner.known):
            if edges.path_clear(np.concatenate([q_from[None], corners, q_to[None]])):
                return [corners]
        return []

    def polish(self, leg: Leg, now: Arrangement, path: Array) -> tuple[Array, float]:
        """Optimise a detour with more effort; return the new path and the time saved, s.

        Args:
            leg, now: as in `around`.
            path: the detour that it returned.
        """
        key = self._key(leg, now, path)
        if key in self._polished:
            return path, 0.0
        self._polished.add(key)
        planner = self._planner(*key, self.options.transit, ())
        better = planner.optimiser.shorten(path, _POLISH)
        saved = 0.0 if better is None else planner.time(path) - planner.time(better)
        if better is None or saved < _WORTH_S or (planner.prove and not planner.proved(better)):
            return path, 0.0
        self._paths[key] = frozen(better)
        return self._paths[key], saved

    def confirm(self, leg: Leg, now: Arrangement, path: Array) -> bool:
        """Certify a transit that was checked at samples; return whether it is certified.

        If not, it is forgotten: from now on a straight motion counts as blocked, and a detour is certified when it is
        planned again.

        Args:
            leg, now: as in `straight`.
            path: (m, n) rad, returned by `straight`, `around` or `polish`.
        """
        key = _, there = self._key(leg, now, path)
        if key in self._doubted:  # certified when it was planned
            return True
        check = certify_curve(self._world(leg, there), curve_of_waypoints(path), self.options.clearance)
        if check.proved:
            return True
        del self._paths[key]
        if len(path) == 2:
            q = path[0] + check.time * (path[1] - path[0])
            self._blocked[key] = Blocked(self._by(check, there - leg.own), check, self._world(leg, there), q)
        self._doubted.add(key)
        return False

    def _key(self, leg: Leg, now: Arrangement, path: Array) -> tuple[Leg, Arrangement]:
        """Return the leg, and the arrangement in which this path of it was found."""
        known = ((leg, there) for there in self._arrangements(leg, now))
        return next(key for key in known if self._paths.get(key) is path)

    def _arrangements(self, leg: Leg, now: Arrangement) -> Iterator[Arrangement]:
        """Yield the arrangement with a cube at every site where one may rest during a leg, then the present one."""
        every = self.worlds.everywhere
        return _widest_first(every - {leg.origin.site} if leg.carries else every, now)

    def _ends(self, leg: Leg) -> tuple[Array, Array]:
        """Return the configurations (n,) rad at the ends of a leg."""
        q_from, q_to = (self.lines[stop.site].offset[stop.grasp] for stop in leg)
        return q_from, q_to

    def _world(self, leg: Leg, there: Arrangement) -> World:
        pick = leg.origin.site.number
        return self.worlds.holding(pick, there) if leg.carries else self.worlds.empty(there)

    def _straight_check(self, leg: Leg, there: Arrangement) -> Blocked | None:
        world, (q_from, q_to) = self._world(leg, there), self._ends(leg)
        line = check_straight(world, q_from, q_to, self.options.clearance, self.margin)
        if line.clear:
            return None
        check = line.seen(world)
        by = self._by(check, there - leg.own)
        passed = None if by is not None or line.end is not None else self._passed(q_from, q_to, world, check)
        check = passed or check
        q = q_from + check.time * (q_to - q_from)
        return Blocked(by, check, world, q, end=line.end is not None or passed is not None)

    def _passed(
        self, q_from: Array, q_to: Array, world: World, check: ClearanceCertificate
    ) -> ClearanceCertificate | None:
        """Return where every path is blocked, because a body that only the first joint moves has to pass another one.

        The first joint passes all values between its ends, whatever the others do. A body on the second joint counts
        too if that joint does not change the distance, such as a cylinder about its axis.
        """
        if sorted(map(world.joint_of, check.pair))[0] > 0 or max(map(world.joint_of, check.pair)) > 2:
            return None
        names = [world.pair_names(i) for i in range(len(world.pairs))]
        pairs = np.flatnonzero([set(pair) == set(check.pair) for pair in names])
        across = q_to - q_from
        worst, at = np.inf, 0.0
        for u in np.linspace(0.0, 1.0, 2 + int(abs(across[0]) / _PASSING)):
            distance = float(world.pair_distances(q_from + u * across, pairs).min())
            if distance < worst:
                worst, at = distance, float(u)
        if worst >= self.options.clearance or not self._whatever_the_others(
            world, q_from + at * across, pairs, worst
        ):
            return None
        return ClearanceCertificate(worst, worst, check.pair, at, False, 1)

    def _whatever_the_others(self, world: World, q: Array, pairs: Indices, distance: float) -> bool:
        """Return whether the second joint leaves a distance unchanged."""
        for second in np.linspace(self.limits.lower[1], self.limits.upper[1], 7):
            turned = np.array(q)
            turned[1] = second
            if abs(float(world.pair_distances(turned, pairs).min()) - distance) > _UNCHANGED:
                return False
        return True

    def _planner(
        self, leg: Leg, there: Arrangement, budget: TransitBudget, known: Sequence[Array]
    ) -> TransitPlanner:
        world, ends = self._world(leg, there), self._ends(leg)
        clearance = searched_clearance(world, ends, self.options.clearance, self.margin)
        enter, leave = (self.lines[stop.site].velocity[stop.grasp] for stop in leg)
        return TransitPlanner(
            world,
            self.limits,
            clearance,
            np.random.default_rng(self.options.seed),
            budget,
            Ends(enter, -leave),
            list(known),
            slack=_SLACK * (clearance - self.options.clearance),
            prove=(leg, there) in self._doubted,
        )

    def _by(self, check: ClearanceCertificate, others: Arrangement) -> Site | None:
        """Return the site of the cube of a pair that is too near; None if it is at none of these sites."""
        return next((site for site in sorted(others) if self.worlds.body(site).name in check.pair), None)


def _widest_first(widest: Arrangement, now: Arrangement) -> Iterator[Arrangement]:
    yield widest
    if widest != now:
        yield now


def _blocking(world: World, q_line: Array, clearance: float) -> ClearanceCertificate | None:
    """Return the closest pair at the first and last blocked samples (m, n) rad of a line; None if it is clear."""
    hits = [i for i, q in enumerate(q_line) if world.in_collision(q, clearance)]
    found = [sampled(world, q_line[i], float(i)) for i in sorted({*hits[:1], *hits[-1:]})]
    return min(found, key=lambda check: check.seen, default=None)


def line_error(grasp: GraspCandidate, blocked: Blocked, clearance: float) -> ImpossibleError:
    """Return the refusal of a line."""
    check = blocked.check
    return ImpossibleError(
        f"on the line at {grasp.hole} (yaw {grasp.yaw}, {grasp.branch}) "
        f"{nearness(check.pair, check.seen, clearance)}",
        station=grasp.hole,
        yaw=grasp.yaw,
        branch=grasp.branch,
        pair=list(check.pair),
        distance_m=check.seen,
        **blocked.world.state(blocked.q),
    )


def leg_error(leg: Leg, blocked: Blocked, clearance: float, worlds: TaskWorlds) -> ImpossibleError:
    """Return the refusal of a leg."""
    check = blocked.check
    origin, goal = ("the start" if site == HOME else worlds.station(site).name for site in leg.sites)
    names, seen = check.pair, f"{short_of(check.seen, clearance)} mm"
    data: dict[str, object] = {"from": origin, "to": goal}
    if not blocked.end:
        near = f"is {seen} from it" if check.seen > 0.0 else "would go through it"
        text = f"no path around {names[1]} from {origin} to {goal}: {names[0]} {near} on the straight motion"
    elif 0.0 < check.time < 1.0:
        near = f"is {seen} from" if check.seen > 0.0 else "is inside"
        text = (
            f"no path from {origin} to {goal} exists: joint 1 has to pass where {names[0]} {near} {names[1]}"
        )
    else:
        at, data["end"] = (origin, "from") if check.time == 0.0 else (goal, "to")
        near = f"are {seen} apart" if check.seen > 0.0 else "overlap"
        text = f"{at} is itself too near to a body: {names[0]} and {names[1]} {near} there"
    return ImpossibleError(
        f"{text} (required: {clearance * 1e3:g} mm)",
        **data,
        ways=list(leg.grasps),
        pair=list(names),
        distance_m=check.seen,
        **blocked.world.state(blocked.q),
    )
