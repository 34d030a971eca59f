"""What would help where a task cannot be planned, each piece of advice tried with the planner before it is offered.

Candidates come from the cause (`plan.advice.candidates`). Cheap looks sort out those that cannot help: reach
of all places, lines sampled at the place that failed, bodies that would overlap. What is left is planned,
whole, until the budget of plans is used up. Budgets are counted, never timed: the same request gives the same advice.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import coal
import numpy as np

from arm.errors import ImpossibleError, InputError
from arm.numerics.products import mul
from arm.robot.shapes import Body, Box
from plan.advice.candidates import Family, families, skipped_for
from plan.advice.changes import Change, Displaced, Groups, Request, Skipped, groups_of
from plan.cartesian.reachability import LineChoice, ReachTable
from plan.collision.world import World, coal_shape
from plan.failure import AFTER_TIMING, LINE_BLOCKED, NO_WAY_ACROSS, START_BLOCKED, Failure, failure_in
from plan.pick_place.cause import worlds_at
from plan.scene import Scene, Station

BUDGET, WANTED = 12, 3
# Overlap that is let pass: bodies that stand on each other touch, m.
_TOUCHING = 5e-4
# Plans that the changes of one rank may cost, so that the others have their turn.
_PLANS_A_RANK = 4


@dataclass(frozen=True)
class Advice:
    """One change that was tried, and with which the task can be planned.

    Attributes:
        change: what to do; ``change.apply(request)`` is the request that was planned.
        motion_s: duration of that plan's motion, s; 0 where there was nothing to move.
        left: how many cubes it moves.
        whole: whether these are all that were asked for.
    """

    change: Change
    motion_s: float
    left: int
    whole: bool

    @property
    def text(self) -> str:
        """What to do, and what was checked."""
        if not self.left:
            return f"{self.change.text} (checked: all holes are then in reach)"
        what = "the whole task then plans" if self.whole else _others(self.left)
        return f"{self.change.text} (checked: {what}, {self.motion_s:.1f} s of motion)"

    def to_json(self) -> dict[str, Any]:
        """JSON types."""
        return {
            "text": self.text,
            **self.change.to_json(),
            "motion_s": round(self.motion_s, 3),
            "cubes_moved": self.left,
        }


def advise(
    request: Request,
    error: ImpossibleError,
    budget: int = BUDGET,
    groups: Groups | None = None,
    spare: Sequence[Station] = (),
    fits: Callable[[Request], bool] | None = None,
    tell: Callable[[str], None] | None = None,
    wanted: int = WANTED,
) -> tuple[Advice, ...]:
    """Changes that make the task possible, the cheapest for a person first; none if none was found in the budget.

    Args:
        request: that was refused.
        error: with which `plan.pick_place.planner.plan_task` refused it.
        budget: how many plans may be tried.
        groups: per name, the bodies that move together; default: `plan.advice.changes.groups_of`.
        spare: places that could be given to the task too.
        fits: the caller's own rule for a changed request, such as where boards may stand.
        tell: called before each plan with what is tried.
        wanted: how many pieces of advice are enough.

    Returns:
        at most one for each sort of change.
    """
    failure = failure_in(error)
    if failure is None or budget < 1:
        return ()
    if groups is None:
        groups = groups_of(request.scene, request.stations())
    trial = _Trial(request, failure, budget, fits, tell)
    found: list[Advice] = []
    for _, rank in groupby(families(request, failure, groups, spare), key=lambda f: f.rank):
        advice = trial.rank(list(rank))
        if advice is not None:
            found.append(advice)
        if len(found) >= wanted or trial.budget <= 0:
            break
    return tuple(found)


class _Trial:
    def __init__(
        self,
        request: Request,
        failure: Failure,
        budget: int,
        fits: Callable[[Request], bool] | None,
        tell: Callable[[str], None] | None,
    ) -> None:
        self.request, self.failure, self.budget = request, failure, budget
        self.fits, self.tell = fits, tell
        # where a cheap look cannot tell a small change from one that helps
        self.blind = failure.kind in (NO_WAY_ACROSS, AFTER_TIMING)

    def rank(self, some: Sequence[Family]) -> Advice | None:
        """The smallest change of these families that plans, as far as a few tries tell."""
        left = min(_PLANS_A_RANK, self.budget)
        firsts = [(self.next_good(family, 0), family) for family in some]
        for first, family in sorted(((i, f) for i, f in firsts if i is not None), key=lambda x: x[0]):
            before = self.budget
            advice = self.family(family, first, left)
            left -= before - self.budget
            if advice is not None or left <= 0:
                return advice
        return None

    def next_good(self, family: Family, index: int) -> int | None:
        """Number of the first change from `index` on that no cheap look speaks against."""
        changes = family.changes
        return next((i for i in range(index, len(changes)) if self.looks_good(changes[i])), None)

    def looks_good(self, change: Change) -> bool:
        if isinstance(change, Skipped):
            return True
        changed, kind = change.apply(self.request), self.failure.kind
        if isinstance(change, Displaced) and not _stands_free(
            self.request.scene, changed.scene, change.bodies
        ):
            return False
        if self.fits is not None and not self.fits(changed):
            return False
        if kind == START_BLOCKED and not _start_free(changed):
            return False
        table = changed.planner().reach(changed.stations())
        if not self.reaches(changed, table):
            return False
        failing = self.failure.stations if kind in (LINE_BLOCKED, NO_WAY_ACROSS) else ()
        if len(changed.places) > len(self.request.places):
            failing = ()
        lines = [*failing]
        if isinstance(change, Displaced):  # what moves may be in the way elsewhere
            on_it = [s.name for s in changed.stations() if s.touches & change.bodies]
            lines += [*on_it, *(s.name for s in changed.stations())]
        return all(_line_open(changed, table[name].serving(), name) for name in dict.fromkeys(lines))

    def reaches(self, request: Request, table: ReachTable) -> bool:
        """Whether the cubes' places are in reach, or as many places as there are cubes where they may be chosen."""
        required = {s.name for s in request.required} | {t.pick.name for t in request.transfers}
        places = {t.place.name for t in request.transfers}
        if request.options.assignment != "free":
            required |= places
        places |= {s.name for s in request.places}
        return all(table[name].ok for name in required) and sum(table[name].ok for name in places) >= len(
            request.transfers
        )

    def family(self, family: Family, first: int, most: int) -> Advice | None:
        """The smallest change that plans, from number `first` on, by at most so many plans."""
        changes = family.changes
        if isinstance(changes[first], Skipped):
            return self.skipping(changes[first])
        if family.anchors:
            return self.by_halves(family, first, most)
        if self.blind:
            return self.from_the_largest(changes, first, most)
        index: int | None = first
        for _ in range(most):
            if index is None:
                break
            advice = self.plan(changes[index])
            if advice is not None:
                return advice
            index = self.next_good(family, 2 * index + 1)
        return None

    def by_halves(self, family: Family, first: int, most: int) -> Advice | None:
        """The smallest change that plans, if more of it always helps more: an anchor that does, then halving."""
        best: Advice | None = None
        fails, plans = first - 1, len(family.changes)
        trials = [i for i in family.anchors if i >= first] or [len(family.changes) - 1]
        left = most
        while left > 0 and plans - fails > 1:
            if best is None:
                index = next((i for i in trials if fails < i < plans), None)
                if index is None:
                    return None
            else:
                index = (fails + plans) // 2
            if not self.looks_good(family.changes[index]):
                fails = index
                continue
            left -= 1
            advice = self.plan(family.changes[index])
            if advice is None:
                fails = index
            else:
                best, plans = advice, index
        return best

    def from_the_largest(self, changes: Sequence[Change], first: int, most: int) -> Advice | None:
        """The largest change shows whether the sort helps at all; then smaller ones are tried."""
        good = [i for i in range(first, len(changes)) if self.looks_good(changes[i])]
        best = self.plan(changes[good[-1]])
        if best is None:
            return None
        smaller = dict.fromkeys(good[len(good) * part // 4] for part in (0, 1, 2))
        for index in [i for i in smaller if i != good[-1]][: most - 1]:
            advice = self.plan(changes[index])
            if advice is not None:
                return advice
        return best

    def skipping(self, change: Change | None) -> Advice | None:
        """Cubes left out, and more of them where that shows another place that fails."""
        while isinstance(change, Skipped):
            advice, failure = self.tried(change)
            if advice is not None or failure is None:
                return advice
            change = skipped_for(self.request, failure, change.cubes)
        return None

    def plan(self, change: Change) -> Advice | None:
        return self.tried(change)[0]

    def tried(self, change: Change) -> tuple[Advice | None, Failure | None]:
        """The advice if the changed request plans, or why it does not."""
        if self.budget <= 0:
            return None, None
        self.budget -= 1
        if self.tell is not None:
            self.tell(change.text)
        changed = change.apply(self.request)
        try:
            if changed.required:
                changed.planner().reach(changed.required).require()
            plan = changed.plan()
        except ImpossibleError as error:
            return None, failure_in(error)
        except InputError:  # the change leaves what a request may be, such as another start
            return None, None
        left = len(changed.transfers)
        whole = left == len(self.request.transfers)
        return Advice(change, plan.duration_s if plan else 0.0, left, whole), None


def _others(count: int) -> str:
    return "the other cube then plans" if count == 1 else f"the other {count} cubes then plan"


def _start_free(request: Request) -> bool:
    world = World(request.scene.robot_open, (*request.scene.bodies, *request.scene.cubes))
    return not world.in_collision(request.q_start, request.options.clearance)


def _line_open(request: Request, choices: Sequence[LineChoice], station: str) -> bool:
    """Whether some way to serve a place keeps its clearance at the samples of reach, and at its outer end."""
    worlds, options = worlds_at(request.scene, request.transfers, station), request.options

    def keeps(choice: LineChoice) -> bool:
        outer = any(w.in_collision(choice.q_offset, options.clearance) for w in worlds)
        return not outer and not any(
            w.in_collision(q, options.line_clearance) for w in worlds for q in choice.q_line
        )

    return any(map(keeps, choices))


def _stands_free(before: Scene, after: Scene, moved: frozenset[str]) -> bool:
    """Whether bodies that were moved overlap nothing that they did not overlap before, and still stand on a table."""
    fixed = [
        b for b in after.robot_open.bodies_at(np.zeros(after.robot_open.model.nq)) if b.name in _base(after)
    ]
    were = {b.name: b for b in (*before.bodies, *before.cubes)}
    others = [b for b in (*after.bodies, *after.cubes, *fixed) if b.name not in moved]
    for body in (b for b in (*after.bodies, *after.cubes) if b.name in moved):
        was = were[body.name]
        if not _on_a_table(was, before) <= _on_a_table(body, after):
            return False
        for other in others:
            if frozenset((body.name, other.name)) in after.allowed:
                continue
            if _overlap(body, other) and not _overlap(was, other):
                return False
    return True


def _base(scene: Scene) -> set[str]:
    return {b.name for b in scene.robot_open.bodies if b.joint == 0}


def _overlap(a: Body, b: Body) -> bool:
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    shapes = [(coal_shape(x.shape), coal.Transform3s(*_parts(x))) for x in (a, b)]
    return bool(coal.distance(*shapes[0], *shapes[1], request, result) < -_TOUCHING)


def _parts(body: Body) -> tuple[Any, Any]:
    return np.array(body.T_base_body[:3, :3]), np.array(body.T_base_body[:3, 3])


def _on_a_table(body: Body, scene: Scene) -> bool:
    """Whether the body's centre is above a table."""
    for table in scene.bodies:
        if table.kind == "table" and isinstance(table.shape, Box):
            at = mul(table.T_base_body[:3, :3].T, body.T_base_body[:3, 3] - table.T_base_body[:3, 3])
            if abs(at[0]) <= table.shape.size[0] / 2 and abs(at[1]) <= table.shape.size[1] / 2:
                return True
    return False
