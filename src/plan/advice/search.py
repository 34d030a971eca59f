"""Search for changes that make a task possible; the planner verifies each before it is offered.

Candidates follow from the cause (`plan.advice.candidates`). Cheap checks discard those that cannot help: reachability
of all places, samples of the lines at the place that failed, bodies that would overlap. The planner tries the others on
the whole task until the budget of plans is spent. The budget is a count, so the same request gives the same advice.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np

from arm.errors import ImpossibleError, InputError
from arm.numerics.products import mul
from arm.robot.shapes import Body, Box
from plan.advice.candidates import Family, families, skipped_for
from plan.advice.changes import Change, Groups, MoveBodies, Request, SkipCubes, groups_of
from plan.cartesian.reachability import GraspCandidate, ReachTable
from plan.collision.world import World, distance_of
from plan.failure import AFTER_TIMING, LINE_BLOCKED, START_BLOCKED, TRANSIT_BLOCKED, Failure, failure_in
from plan.program.assignment.cause import worlds_at
from plan.scene import Scene

BUDGET, WANTED = 12, 3
_TOUCHING = 5e-4  # m, accepted overlap of bodies that stand on each other
_PLANS_A_RANK = 4  # largest number of plans for the changes of one rank


@dataclass(frozen=True)
class Advice:
    """A change with which the task can be planned.

    Attributes:
        change: the change; ``change.apply(request)`` was planned.
        motion_s: duration of that plan's motion, s; 0 if there was nothing to move.
        left: number of cubes that it moves.
        whole: whether these are all cubes of the request.
        of_list: whether the request has goals in a given order instead.
    """

    change: Change
    motion_s: float
    left: int
    whole: bool
    of_list: bool = False

    @property
    def text(self) -> str:
        """What to do, and what was verified."""
        if self.of_list:
            return f"{self.change.text} (checked: all goals can then be planned, {self.motion_s:.1f} s of motion)"
        if not self.left:
            return f"{self.change.text} (checked: all holes are then in reach)"
        others = "the other cube" if self.left == 1 else f"the other {self.left} cubes"
        what = "the whole task can then be planned" if self.whole else f"{others} can then be moved"
        return f"{self.change.text} (checked: {what}, {self.motion_s:.1f} s of motion)"

    def to_json(self) -> dict[str, Any]:
        """Return the advice as JSON types."""
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
    fits: Callable[[Request], bool] | None = None,
    tell: Callable[[str], None] | None = None,
    wanted: int = WANTED,
) -> tuple[Advice, ...]:
    """Return changes that make the task possible, the least work for the user first; () if the budget ends before.

    Args:
        request: the request that failed.
        error: the error of planning it.
        budget: largest number of plans.
        groups: for each board, the names of the bodies that move with it; default: `plan.advice.changes.groups_of`.
        fits: returns whether a changed request is acceptable, such as where boards may stand; or None.
        tell: called before each plan with the text of the change; or None.
        wanted: number of changes after which the search ends.

    Returns:
        At most one change of each rank.
    """
    failure = failure_in(error)
    if failure is None or budget < 1:
        return ()
    if groups is None:
        groups = groups_of(request.scene, request.stations())
    trial = _Trial(request, failure, budget, fits, tell)
    found: list[Advice] = []
    for _, rank in groupby(families(request, failure, groups), key=lambda f: f.rank):
        advice = trial.rank(list(rank))
        if advice is not None:
            found.append(advice)
        if len(found) >= wanted or trial.budget <= 0:
            break
    return tuple(found)


@dataclass(eq=False)
class _Trial:
    request: Request
    failure: Failure
    budget: int
    fits: Callable[[Request], bool] | None
    tell: Callable[[str], None] | None

    def rank(self, some: Sequence[Family]) -> Advice | None:
        """Return the smallest change of these families that makes the task possible, within a few plans."""
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
        """Return the index of the first change from `index` on that passes the cheap checks."""
        changes = family.changes
        return next((i for i in range(index, len(changes)) if self.looks_good(changes[i])), None)

    def looks_good(self, change: Change) -> bool:
        if isinstance(change, SkipCubes):
            return True
        changed, kind = change.apply(self.request), self.failure.kind
        before, after = self.request.scene, changed.scene
        if isinstance(change, MoveBodies) and not _stands_free(before, after, change.bodies):
            return False
        if self.fits is not None and not self.fits(changed):
            return False
        if kind == START_BLOCKED:
            world = World(changed.scene.robot_open, changed.scene.present)
            if world.in_collision(changed.q_start, changed.options.clearance):
                return False
        table = changed.reach(changed.stations())
        if not self.reaches(changed, table):
            return False
        failing = self.failure.stations if kind in (LINE_BLOCKED, TRANSIT_BLOCKED) else ()
        lines = [name for name in failing if name in {s.name for s in changed.stations()}]
        if isinstance(change, MoveBodies):  # a moved body may obstruct other lines
            on_it = [s.name for s in changed.stations() if s.touches & change.bodies]
            lines += [*on_it, *(s.name for s in changed.stations())]
        return all(_line_open(changed, table[name].feasible(), name) for name in dict.fromkeys(lines))

    def reaches(self, request: Request, table: ReachTable) -> bool:
        """Return whether the cubes' places are in reach, or enough places if the planner may choose them."""
        required = {s.name for s in request.required} | {t.pick.name for t in request.transfers}
        places = {t.place.name for t in request.transfers}
        if request.options.assignment != "free":
            required |= places
        places |= {s.name for s in request.places}
        return all(table[name].ok for name in required) and sum(table[name].ok for name in places) >= len(
            request.transfers
        )

    def family(self, family: Family, first: int, most: int) -> Advice | None:
        """Return the smallest change from index `first` on that makes the task possible, within `most` plans."""
        changes = family.changes
        if isinstance(changes[first], SkipCubes):
            return self.skipping(changes[first])
        if family.anchors:
            return self.by_halves(family, first, most)
        if self.failure.kind in (TRANSIT_BLOCKED, AFTER_TIMING):
            # for these failures cheap checks do not show whether a change is large enough
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
        """Bisect below the first anchor that makes the task possible; larger changes always help more."""
        best: Advice | None = None
        fails, plans = first - 1, len(family.changes)
        trials = [i for i in family.anchors if i >= first] or [len(family.changes) - 1]
        left = most
        while left > 0 and plans - fails > 1:
            index = (fails + plans) // 2 if best else next((i for i in trials if fails < i < plans), None)
            if index is None:
                return None
            advice: Advice | None = None
            if self.looks_good(family.changes[index]):
                left -= 1
                advice = self.plan(family.changes[index])
            if advice is None:
                fails = index
            else:
                best, plans = advice, index
        return best

    def from_the_largest(self, changes: Sequence[Change], first: int, most: int) -> Advice | None:
        """Try the largest change to see whether this kind helps at all, then smaller ones."""
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
        """Skip cubes, and more of them if the plan then fails at another place."""
        while isinstance(change, SkipCubes):
            advice, failure = self.tried(change)
            if advice is not None or failure is None:
                return advice
            change = skipped_for(self.request, failure, change.cubes)
        return None

    def plan(self, change: Change) -> Advice | None:
        return self.tried(change)[0]

    def tried(self, change: Change) -> tuple[Advice | None, Failure | None]:
        """Plan the changed request; return the advice, or the failure."""
        if self.budget <= 0:
            return None, None
        self.budget -= 1
        if self.tell is not None:
            self.tell(change.text)
        changed = change.apply(self.request)
        try:
            if changed.required:
                changed.reach(changed.required).require()
            plan = changed.plan()
        except ImpossibleError as error:
            return None, failure_in(error)
        except InputError:  # the changed request is invalid
            return None, None
        left = len(changed.transfers)
        whole = left == len(self.request.transfers)
        motion_s = plan.duration_s if plan else 0.0
        return Advice(change, motion_s, left, whole, bool(changed.goals)), None


def _line_open(request: Request, choices: Sequence[GraspCandidate], station: str) -> bool:
    """Return whether some grasp of a place keeps its clearance at samples of its line and at the outer end."""
    worlds, options = worlds_at(request.scene, request.transfers, station), request.options

    def keeps(choice: GraspCandidate) -> bool:
        outer = any(w.in_collision(choice.q_offset, options.clearance) for w in worlds)
        return not outer and not any(
            w.in_collision(q, options.line_clearance) for w in worlds for q in choice.q_line
        )

    return any(map(keeps, choices))


def _stands_free(before: Scene, after: Scene, moved: frozenset[str]) -> bool:
    """Return whether moved bodies have no new overlap and still stand on a table."""
    robot = after.robot_open
    base = {b.name for b in robot.bodies if b.joint == 0}
    fixed = [b for b in robot.bodies_at(np.zeros(robot.model.nq)) if b.name in base]
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


def _overlap(a: Body, b: Body) -> bool:
    return distance_of(a, b).value < -_TOUCHING


def _on_a_table(body: Body, scene: Scene) -> bool:
    """Return whether the body's centre is above a table."""
    for table in scene.bodies:
        if table.kind == "table" and isinstance(table.shape, Box):
            at = mul(table.T_base_body[:3, :3].T, body.T_base_body[:3, 3] - table.T_base_body[:3, 3])
            if abs(at[0]) <= table.shape.size[0] / 2 and abs(at[1]) <= table.shape.size[1] / 2:
                return True
    return False
