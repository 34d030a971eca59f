"""Checks of the lines and transits of a task, each valid for as many moments of the task as possible.

The placements of the cubes change from step to step. So a line or transit is first checked with a cube at every place
where one could ever be: if it is clear, it is clear at every moment. If such a cube blocks it, it is checked again with
the cubes that are there at that moment.

All of this is checked at samples, because most of what a search looks at is not used. The motions of the best sequence
are certified as they will be sent. If one cannot be, its transit is certified itself (`EdgeChecks.confirm`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm.controller.unit import Limits
from arm.errors import ImpossibleError
from arm.se3 import Array, Indices, frozen
from plan.budget import TransitBudget
from plan.cartesian.reachability import GraspCandidate
from plan.collision.bezier import curve_of_waypoints
from plan.collision.certificate import ClearanceCertificate, certify_curve
from plan.collision.search_margin import MARGIN, searched_clearance
from plan.collision.world import World
from plan.failure import nearness, short_of
from plan.options import PlanOptions
from plan.program.assignment.leg_costs import TransitEdge
from plan.program.assignment.worlds import CubePlacement, TaskWorlds
from plan.transit.optimise import Ends
from plan.transit.planner import TransitPlanner
from plan.transit.straight import check_straight, sampled

# Fraction of the search margin that the certificate of a path may lack, because the search checks samples.
_SLACK = 0.5
# Nodes of RRT-Connect while other sequences may do.
_FEW_SAMPLES = 150
# Optimisation steps for a detour, and for one that will be used; the least useful saving of the latter, s.
_ROUGH, _POLISH, _WORTH_S = 2, 6, 0.02
# Steps of the first joint for the check of bodies that only this joint moves, rad.
_PASSING = np.radians(0.25)
_UNCHANGED = 1e-5  # m, largest change of a distance that counts as none
# Search margin that is tried if no detour is found with the whole margin, m.
_LEAST_MARGIN = 1e-4

Moment = frozenset[CubePlacement]


@dataclass(frozen=True)
class Blocked:
    """What blocks a line or transit.

    Attributes:
        by: a cube that may be elsewhere at another time; None for a fixed body.
        check: the pair of bodies, their distance and the place.
        end: whether no detour can exist: an end is itself too near, or a body that only the first joint moves has to
            pass there.
    """

    by: CubePlacement | None
    check: ClearanceCertificate
    end: bool = False


@dataclass(frozen=True)
class TransitQuery:
    """A transit to plan: between two configurations, with or without a cube.

    Attributes:
        q_from, q_to: (n,) rad.
        ends: velocities at both ends.
        pick: number of the transfer whose cube is carried, or None.
        own: cubes at its own stations, which are there whenever it is used.
    """

    q_from: Array
    q_to: Array
    ends: Ends
    pick: int | None
    own: frozenset[CubePlacement]


class EdgeChecks:
    """Checks of one task, with their results kept.

    Args:
        stages: its collision worlds.
        limits: limits for planning.
        options: clearances, seed, budgets.
    """

    def __init__(self, stages: TaskWorlds, limits: Limits, options: PlanOptions) -> None:
        self.stages, self.limits, self.options = stages, limits, options
        places = (CubePlacement(True, j) for j in range(len(stages.places)))
        self.everywhere: Moment = frozenset(
            CubePlacement(False, i) for i in range(len(stages.cubes))
        ) | frozenset(places)
        self._clear_lines: set[tuple[object, ...]] = set()
        self._straight: dict[tuple[TransitEdge, Moment], Blocked] = {}
        self._ways: dict[tuple[TransitEdge, Moment], Array] = {}
        self._polished: set[tuple[TransitEdge, Moment]] = set()
        self._doubted: set[tuple[TransitEdge, Moment]] = set()  # their detours are certified
        self.margin = MARGIN

    def least_margin(self) -> None:
        """Search with the least margin from now on, and check blocked transits again."""
        self.margin = _LEAST_MARGIN
        self._straight.clear()

    def line(self, choice: GraspCandidate, station: CubePlacement, pick: int, now: Moment) -> Blocked | None:
        """Return what blocks a line, with the cube of `pick` in the jaws or without it; None if it is clear.

        A line is checked at samples: it is short, its samples are dense, and what is sent is certified later.

        Args:
            choice: the grasp with its line.
            station: the cube at the line's end: at its source, or at its place after the release.
            pick: number of the transfer.
            now: placements while the jaws are open, this cube included.
        """
        blocked: Blocked | None = None
        for moment in self._moments(now, frozenset()):
            key = (station, choice.yaw, choice.branch, pick, moment)
            if key in self._clear_lines:
                return None
            blocked = None
            for world in self._line_worlds(station, pick, moment):
                check = _blocking(world, choice.q_line, self.options.line_clearance)
                if check is not None:
                    blocked = Blocked(self._by(check, moment - {station}), check)
                    break
            if blocked is None:
                self._clear_lines.add(key)
                return None
            if blocked.by is None:
                return blocked
        return blocked

    def _line_worlds(self, station: CubePlacement, pick: int, moment: Moment) -> Iterator[World]:
        stages = self.stages
        touches = stages.places[station.number] if station.placed else stages.transfers[pick].pick
        yield stages.empty(moment)
        without = moment - {station, CubePlacement(False, pick)}
        yield stages.holding(pick, without, touches.touches)

    def _moments(self, now: Moment, absent: Moment) -> Iterator[Moment]:
        """Yield all placements that could ever be, then the present ones."""
        widest = self.everywhere - absent
        yield widest
        if widest != now:
            yield now

    def straight(self, leg: TransitEdge, crossing: TransitQuery, now: Moment) -> Array | Blocked:
        """Return the straight motion (2, n), or what blocks it; a fixed body blocks it at every moment."""
        blocked: Blocked | None = None
        for moment in self._moments(now, self._absent(crossing)):
            known = (leg, moment)
            if known in self._ways:
                return self._ways[known]
            blocked = self._straight.get(known) or self._straight_check(crossing, moment)
            if blocked is None:
                self._ways[known] = frozen([crossing.q_from, crossing.q_to])
                return self._ways[known]
            self._straight[known] = blocked
            if blocked.by is None:
                break
        if blocked is None:
            why = "a transit was requested at no moment; this is a bug of the planner"
            raise ImpossibleError(why, leg=str(leg))
        return blocked

    def around(
        self, leg: TransitEdge, crossing: TransitQuery, now: Moment, known: Sequence[Array], thorough: bool
    ) -> Array | None:
        """Return a detour (m, n), or None.

        Args:
            leg, crossing, now: as in `straight`.
            known: corners (c, n) of detours around the same body, the most promising last.
            thorough: whether to use the whole budget.
        """
        for moment in self._moments(now, self._absent(crossing)):
            asked = (leg, moment)
            if asked in self._ways:
                return self._ways[asked]
            blocked = self._straight.get(asked)
            if blocked is None or blocked.end:
                continue
            budget = replace(self.options.transit, steps=min(self.options.transit.steps, _ROUGH))
            if not thorough:
                budget = replace(budget, rrt=min(budget.rrt, _FEW_SAMPLES))
            detours = self._planner(crossing, moment, budget, list(known), asked in self._doubted)
            way = detours.around(crossing.q_from, crossing.q_to, blocked.check.time)
            if way is not None:
                self._ways[asked] = frozen(way)
                return self._ways[asked]
        return None

    def polish(
        self, way: Array, crossing_of: Callable[[TransitEdge], TransitQuery]
    ) -> tuple[TransitEdge, Array, float]:
        """Optimise a detour with more effort; return its leg, the new path and the time saved, s.

        Args:
            way: a detour returned by `around`.
            crossing_of: returns the query of a leg.
        """
        leg, moment = asked = self._asked(way)
        if asked in self._polished:
            return leg, way, 0.0
        self._polished.add(asked)
        planner = self._planner(crossing_of(leg), moment, self.options.transit, [], asked in self._doubted)
        better = planner.optimiser.shorten(way, _POLISH)
        saved = 0.0 if better is None else planner.time(way) - planner.time(better)
        if better is None or saved < _WORTH_S or (planner.prove and not planner.proved(better)):
            return leg, way, 0.0
        self._ways[asked] = frozen(better)
        return leg, self._ways[asked], saved

    def confirm(self, way: Array, crossing_of: Callable[[TransitEdge], TransitQuery]) -> bool:
        """Certify a transit that was checked at samples; return whether it is certified.

        If not, it is forgotten: from now on a straight motion counts as blocked, and a detour is certified when it is
        planned again.

        Args:
            way: (m, n) rad, returned by `straight`, `around` or `polish`.
            crossing_of: returns the query of a leg.
        """
        leg, moment = asked = self._asked(way)
        if asked in self._doubted:  # certified when it was planned
            return True
        crossing = crossing_of(leg)
        check = certify_curve(self._world(crossing, moment), curve_of_waypoints(way), self.options.clearance)
        if check.proved:
            return True
        del self._ways[asked]
        if len(way) == 2:
            self._straight[asked] = Blocked(self._by(check, moment - crossing.own), check)
        self._doubted.add(asked)
        return False

    def _asked(self, way: Array) -> tuple[TransitEdge, Moment]:
        return next(asked for asked, known in self._ways.items() if known is way)

    def clearance(self, crossing: TransitQuery, world: World) -> float:
        """Return the clearance of the search, m; see `plan.collision.search_margin.searched_clearance`."""
        ends = (crossing.q_from, crossing.q_to)
        return searched_clearance(world, ends, self.options.clearance, self.margin)

    def _absent(self, crossing: TransitQuery) -> Moment:
        return frozenset() if crossing.pick is None else frozenset((CubePlacement(False, crossing.pick),))

    def _world(self, crossing: TransitQuery, moment: Moment) -> World:
        if crossing.pick is None:
            return self.stages.empty(moment)
        return self.stages.holding(crossing.pick, moment)

    def _straight_check(self, crossing: TransitQuery, moment: Moment) -> Blocked | None:
        """Return what blocks the straight motion; None if it is clear at samples."""
        world, asked = self._world(crossing, moment), self.options.clearance
        line = check_straight(world, crossing.q_from, crossing.q_to, asked, self.margin)
        if line.clear:
            return None
        check = line.seen(world)
        by = self._by(check, moment - crossing.own)
        if line.end is not None:
            return Blocked(by, check, end=True)
        passed = None if by is not None else self._passed(crossing, world, check)
        return Blocked(by, check) if passed is None else Blocked(None, passed, end=True)

    def _passed(
        self, crossing: TransitQuery, world: World, check: ClearanceCertificate
    ) -> ClearanceCertificate | None:
        """Return where every path is blocked, because a body that only the first joint moves has to pass another one.

        The first joint passes all values between its ends, whatever the others do. A body on the second joint counts
        too if that joint does not change the distance, such as a cylinder about its axis.
        """
        if sorted(map(world.joint_of, check.pair))[0] > 0 or max(map(world.joint_of, check.pair)) > 2:
            return None
        names = [world.pair_names(i) for i in range(len(world.pairs))]
        pairs = np.flatnonzero([set(pair) == set(check.pair) for pair in names])
        way = crossing.q_to - crossing.q_from
        worst, at = np.inf, 0.0
        for u in np.linspace(0.0, 1.0, 2 + int(abs(way[0]) / _PASSING)):
            distance = float(world.pair_distances(crossing.q_from + u * way, pairs).min())
            if distance < worst:
                worst, at = distance, float(u)
        if worst >= self.options.clearance or not self._whatever_the_others(
            world, crossing.q_from + at * way, pairs, worst
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
        self, crossing: TransitQuery, moment: Moment, budget: TransitBudget, known: list[Array], prove: bool
    ) -> TransitPlanner:
        world = self._world(crossing, moment)
        clearance = self.clearance(crossing, world)
        return TransitPlanner(
            world,
            self.limits,
            clearance,
            np.random.default_rng(self.options.seed),
            budget,
            crossing.ends,
            known,
            slack=_SLACK * (clearance - self.options.clearance),
            prove=prove,
        )

    def _by(self, check: ClearanceCertificate, others: Moment) -> CubePlacement | None:
        for standing in sorted(others):
            if self.stages.body(standing).name in check.pair:
                return standing
        return None


def _blocking(world: World, q_line: Array, clearance: float) -> ClearanceCertificate | None:
    """Return the closest pair at the first and last blocked samples (m, n) rad of a line; None if it is clear."""
    hits = [i for i, q in enumerate(q_line) if world.in_collision(q, clearance)]
    found = [sampled(world, q_line[i], float(i)) for i in sorted({*hits[:1], *hits[-1:]})]
    return min(found, key=lambda check: check.seen, default=None)


def line_error(choice: GraspCandidate, check: ClearanceCertificate, clearance: float) -> ImpossibleError:
    """Return the refusal of a line."""
    return ImpossibleError(
        f"on the line at {choice.hole} (yaw {choice.yaw}, {choice.branch}) "
        f"{nearness(check.pair, check.seen, clearance)}",
        station=choice.hole,
        yaw=choice.yaw,
        branch=choice.branch,
        pair=list(check.pair),
        distance_m=check.seen,
    )


def leg_error(leg: TransitEdge, blocked: Blocked, clearance: float, stages: TaskWorlds) -> ImpossibleError:
    """Return the refusal of a leg."""
    check = blocked.check
    picks, places = [t.pick.name for t in stages.transfers], [p.name for p in stages.places]
    match leg.kind:
        case "begin":
            origin, goal = "the start", picks[leg.numbers[0]]
        case "carry":
            origin, goal = picks[leg.numbers[0]], places[leg.numbers[1]]
        case "go on":
            origin, goal = places[leg.numbers[0]], picks[leg.numbers[1]]
        case _:
            origin, goal = places[leg.numbers[0]], "the start"
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
        ways=list(leg.ways),
        pair=list(names),
        distance_m=check.seen,
    )
