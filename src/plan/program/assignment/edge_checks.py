"""Lines and ways across of a task, proved once for as many moments of it as possible.

Which cubes stand where changes from step to step. So a line or a way is first proved with a cube standing wherever one
ever could: then it is clear at every moment. Only where such a cube is in the way is it looked at again with the cubes
that really stand there by then.
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
from plan.collision.certificate import ClearanceCertificate
from plan.collision.search_margin import MARGIN, searched_clearance
from plan.collision.world import World
from plan.failure import nearness, short_of
from plan.options import PlanOptions
from plan.program.assignment.leg_costs import TransitEdge
from plan.program.assignment.worlds import CubePlacement, TaskWorlds
from plan.transit.optimise import Ends
from plan.transit.planner import TransitPlanner
from plan.transit.straight import check_straight, sampled

# Part of the margin that the proof of a way may lack: it is searched by samples.
_SLACK = 0.5
# Samples of RRT-Connect as long as other ways may do.
_FEW_SAMPLES = 150
# Steps in which a way that will be used is made faster, and what that must save, s.
_POLISH, _WORTH_S = 12, 0.02
# Steps of the first joint at which bodies that move with it alone are looked at, rad.
_PASSING = np.radians(0.25)
_UNCHANGED = 1e-5  # m
# Where nothing leads around with the whole margin, this much of it is tried, m.
_LEAST_MARGIN = 1e-4

Moment = frozenset[CubePlacement]


@dataclass(frozen=True)
class Blocked:
    """What is in the way.

    Attributes:
        by: a cube that may be gone another time, or None for what is always there.
        check: where it was found.
        end: whether nothing leads around: an end of the way is itself too near, or what moves with the first joint
            alone has to pass there.
    """

    by: CubePlacement | None
    check: ClearanceCertificate
    end: bool = False


@dataclass(frozen=True)
class TransitQuery:
    """A way across to be had: between two configurations, with or without a cube.

    Attributes:
        q_from, q_to: (n,) rad.
        ends: velocities with which it is entered and left.
        pick: number of the transfer whose cube is carried, or None.
        own: cubes that stand wherever it is used, at its own stations.
    """

    q_from: Array
    q_to: Array
    ends: Ends
    pick: int | None
    own: frozenset[CubePlacement]


class EdgeChecks:
    """What was proved of a task, and what was found in the way.

    Args:
        stages: its collision worlds.
        limits: that motion is planned under.
        options: clearances, seed, budgets.
    """

    def __init__(self, stages: TaskWorlds, limits: Limits, options: PlanOptions) -> None:
        self.stages, self.limits, self.options = stages, limits, options
        places = (CubePlacement(True, j) for j in range(len(stages.places)))
        self.everywhere: Moment = frozenset(
            CubePlacement(False, i) for i in range(len(stages.cubes))
        ) | frozenset(places)
        self._clear_lines: set[tuple[object, ...]] = set()
        self._straight: dict[tuple[object, ...], ClearanceCertificate | Blocked] = {}
        self._ways: dict[tuple[TransitEdge, Moment], Array] = {}
        self._polished: set[tuple[TransitEdge, Moment]] = set()
        self.margin = MARGIN

    def least_margin(self) -> None:
        """From now on ways are searched with hardly more than the asked clearance; what was blocked is asked again."""
        self.margin = _LEAST_MARGIN
        self._straight.clear()

    def line(self, choice: GraspCandidate, station: CubePlacement, pick: int, now: Moment) -> Blocked | None:
        """What is in the way of a line that is run with the cube of `pick` and without it; None if nothing is.

        A line is short and its samples are near each other: they are enough to choose by. What is sent is proved.

        Args:
            choice: the line.
            station: where it is: the pick, or the place as it is once the cube stands there.
            pick: number of the transfer.
            now: what stands there with the jaws open: the cube included.
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
        """All that could ever stand, then what does."""
        widest = self.everywhere - absent
        yield widest
        if widest != now:
            yield now

    def straight(self, leg: TransitEdge, crossing: TransitQuery, now: Moment) -> Array | Blocked:
        """The straight way (2, n), or what is in it; for every moment if it is blocked by what always stands."""
        found: ClearanceCertificate | Blocked | None = None
        for moment in self._moments(now, self._absent(crossing)):
            known = (leg, moment)
            if known in self._ways:
                return self._ways[known]
            found = self._straight.get(known)
            if found is None:
                found = self._straight[known] = self._straight_check(crossing, moment)
            if isinstance(found, ClearanceCertificate):
                self._ways[known] = frozen([crossing.q_from, crossing.q_to])
                return self._ways[known]
            if found.by is None:
                return found
        if not isinstance(found, Blocked):
            raise ImpossibleError("a way across was asked for at no moment", leg=str(leg))
        return found

    def around(
        self, leg: TransitEdge, crossing: TransitQuery, now: Moment, known: Sequence[Array], thorough: bool
    ) -> Array | None:
        """A way around what is in the straight one, or None.

        Args:
            leg, crossing, now: as `straight`.
            known: corners (c, n) of ways around the same body, the most promising last.
            thorough: whether to spend more where none is found soon.
        """
        for moment in self._moments(now, self._absent(crossing)):
            asked = (leg, moment)
            if asked in self._ways:
                return self._ways[asked]
            blocked = self._straight.get(asked)
            if not isinstance(blocked, Blocked) or blocked.end:
                continue
            way = self._around(crossing, moment, blocked, known, thorough)
            if way is not None:
                self._ways[asked] = frozen(way)
                return self._ways[asked]
        return None

    def polish(
        self, way: Array, crossing_of: Callable[[TransitEdge], TransitQuery]
    ) -> tuple[TransitEdge, Array, float]:
        """The leg of a way around that was returned, the way made faster with more effort, and the s that this saves.

        Args:
            way: as `around` returned it.
            crossing_of: what was asked for, by its leg.
        """
        leg, moment = next(asked for asked, known in self._ways.items() if known is way)
        if (leg, moment) in self._polished:
            return leg, way, 0.0
        self._polished.add((leg, moment))
        crossing = crossing_of(leg)
        planner = self._planner(crossing, self._world(crossing, moment), self.options.transit, [])
        better = planner.optimiser.shorten(way, _POLISH)
        saved = planner.time(way) - planner.time(better)
        if saved < _WORTH_S or not planner.proved(better):
            return leg, way, 0.0
        self._ways[leg, moment] = frozen(better)
        return leg, self._ways[leg, moment], saved

    def clearance(self, crossing: TransitQuery, world: World) -> float:
        """What a way is searched with, m: the asked clearance and a margin, or half of what the ends leave of it."""
        ends = (crossing.q_from, crossing.q_to)
        return searched_clearance(world, ends, self.options.clearance, self.margin)

    def _absent(self, crossing: TransitQuery) -> Moment:
        return frozenset() if crossing.pick is None else frozenset((CubePlacement(False, crossing.pick),))

    def _world(self, crossing: TransitQuery, moment: Moment) -> World:
        if crossing.pick is None:
            return self.stages.empty(moment)
        return self.stages.holding(crossing.pick, moment)

    def _straight_check(self, crossing: TransitQuery, moment: Moment) -> ClearanceCertificate | Blocked:
        world = self._world(crossing, moment)
        line = check_straight(world, crossing.q_from, crossing.q_to, self.options.clearance, self.margin)
        check = line.seen(world)
        if line.proved:
            return check
        by = self._by(check, moment - crossing.own)
        if line.end is not None:
            return Blocked(by, check, end=True)
        passed = None if by is not None else self._passed(crossing, world, check)
        return Blocked(by, check) if passed is None else Blocked(None, passed, end=True)

    def _passed(
        self, crossing: TransitQuery, world: World, check: ClearanceCertificate
    ) -> ClearanceCertificate | None:
        """Where every way is blocked: a body that only the first joint moves has to pass by what stands.

        The first joint goes through all values between its two, whatever the others do. A body behind the second
        joint counts too where turning that makes no difference, such as a cylinder about its axis.
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
        """Whether a distance stays the same as the joints behind the first turn."""
        for second in np.linspace(self.limits.lower[1], self.limits.upper[1], 7):
            turned = np.array(q)
            turned[1] = second
            if abs(float(world.pair_distances(turned, pairs).min()) - distance) > _UNCHANGED:
                return False
        return True

    def _around(
        self,
        crossing: TransitQuery,
        moment: Moment,
        blocked: Blocked,
        known: Sequence[Array],
        thorough: bool,
    ) -> Array | None:
        world = self._world(crossing, moment)
        budget = self.options.transit
        if not thorough:
            budget = replace(budget, rrt=min(budget.rrt, _FEW_SAMPLES))
        detours = self._planner(crossing, world, budget, list(known))
        return detours.around(crossing.q_from, crossing.q_to, blocked.check.time)

    def _planner(
        self, crossing: TransitQuery, world: World, budget: TransitBudget, known: list[Array]
    ) -> TransitPlanner:
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
        )

    def _by(self, check: ClearanceCertificate, others: Moment) -> CubePlacement | None:
        for standing in sorted(others):
            if self.stages.body(standing).name in check.pair:
                return standing
        return None


def _blocking(world: World, q_line: Array, clearance: float) -> ClearanceCertificate | None:
    """What is too near at samples (m, n) rad of a line, where that begins or ends; None where nothing is."""
    hits = [i for i, q in enumerate(q_line) if world.in_collision(q, clearance)]
    found = [sampled(world, q_line[i], float(i)) for i in sorted({*hits[:1], *hits[-1:]})]
    return min(found, key=lambda check: check.seen, default=None)


def line_error(choice: GraspCandidate, check: ClearanceCertificate, clearance: float) -> ImpossibleError:
    """What is in the way of a line, as an error."""
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
    """What is in the way of a leg, as an error."""
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
        text = f"no path around {names[1]} from {origin} to {goal}: {names[0]} {near} on the straight move"
    elif 0.0 < check.time < 1.0:
        near = f"is {seen} from" if check.seen > 0.0 else "is inside"
        text = (
            f"nothing leads from {origin} to {goal}: joint 1 has to pass where {names[0]} {near} {names[1]}"
        )
    else:
        at, data["end"] = (origin, "from") if check.time == 0.0 else (goal, "to")
        near = f"are {seen} apart" if check.seen > 0.0 else "overlap"
        text = f"{at} is itself too near for a move from or to it: {names[0]} and {names[1]} {near} there"
    return ImpossibleError(
        f"{text} (required: {clearance * 1e3:g} mm)",
        **data,
        ways=list(leg.ways),
        pair=list(names),
        distance_m=check.seen,
    )
