"""Transfers of cubes: order, places and grasps are chosen together, and the motions timed and certified as sent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import combinations, islice

import numpy as np

from arm.arguments import shown
from arm.errors import ImpossibleError, InputError
from arm.plan_file import GripperStep, Move, Step
from arm.se3 import Array
from plan.budget import BudgetSpent, Meter, budget_words
from plan.cartesian.reachability import ReachTable, reach_stations
from plan.failure import failure_in
from plan.program.assignment.cause import find_cause
from plan.program.assignment.found import Found
from plan.program.assignment.legs import Site
from plan.program.assignment.search import TaskSearch
from plan.program.assignment.sequence import sequence_steps, task_targets
from plan.program.assignment.sequencing import best_order
from plan.program.assignment.worlds import TaskWorlds
from plan.program.goals.attachments import AttachmentState, AttachmentWorlds
from plan.program.goals.line_chains import LineChains
from plan.program.planned import Planned, unfinished
from plan.program.setting import Setting
from plan.program.writer import ClearanceLost, MotionWriter
from plan.scene import Station, Transfer

# If a sequence cannot be certified after timing, a line or leg of it is excluded and the search is repeated: once for
# each grasp candidate, but at most this often.
_ATTEMPTS = 100
_MOST_SUBSETS = 200  # largest number of subsets of the cubes that are compared if there are too few places


@dataclass(frozen=True)
class Transfers:
    """Several cubes to move, whose order and places may be free (`PlanOptions.order`, `assignment`, `look`).

    Attributes:
        transfers: cube, source and target of each; with free `assignment` the targets are chosen among all places.
        places: additional places that cubes may go to.
        skip: whether a cube may stay where it is if its source is out of reach or blocked, or no place is left for it
            that is in reach and not blocked (several transfers may then name the same place). At least one cube moves.
    """

    transfers: tuple[Transfer, ...]
    places: tuple[Station, ...] = ()
    skip: bool = False


class AssignmentPlanner:
    """Plans transfers from `q_start`, and the return to it.

    Args:
        setting: arm, unit, limits.
        goals: the transfers; at least one.
        q_start: configuration at rest, from which images are taken, at whole counts, (n,) rad.
        state: poses of bodies that were moved before.
        first_cube: index of the first cube in the whole program.

    Raises:
        InputError: no transfers, or an unknown cube.
    """

    def __init__(
        self,
        setting: Setting,
        goals: Transfers,
        q_start: Array,
        state: AttachmentState | None = None,
        first_cube: int = 0,
    ) -> None:
        self.setting, self.options, self.first_cube = setting, setting.options, first_cube
        # the first step opens the jaws
        self.state = AttachmentState(None, None, () if state is None else state.moved)
        self.scene = setting.scene.with_moved(dict(self.state.moved))
        self.transfers, self.q_start = goals.transfers, q_start
        if not self.transfers:
            raise InputError("a task needs at least one cube to move", transfers=0)
        for transfer in self.transfers:
            if not isinstance(transfer, Transfer):
                raise InputError(f"transfers: {shown(transfer)}: must be a Transfer", value=shown(transfer))
            self.scene.cube(transfer.cube)
        self.goals, self.skip, self.skipped = goals, goals.skip, list[dict[str, str]]()
        self.without_place: tuple[Transfer, ...] = ()
        self.stations = list({t.place.name: t.place for t in self.transfers}.values())
        if len(self.stations) < len(self.transfers) and not (self.skip and self.options.assignment == "free"):
            why = "two transfers name the same place, which only the option skip with free assignment allows"
            raise InputError(why, places=[t.place.name for t in self.transfers])
        if self.options.assignment == "free":
            known = {station.name for station in self.stations}
            self.stations += [station for station in goals.places if station.name not in known]

    def planned(self, meter: Meter) -> Planned:
        """Return the plan.

        Raises:
            ImpossibleError: a place is out of reach, or no collision-free path was found; data: failure
                (`plan.failure`). Or the budget was spent before a sequence was complete; data: budget.
            PlanningInterrupted: Ctrl-C was pressed before a sequence was complete.
        """
        while True:
            try:
                return self._planned(meter)
            except ImpossibleError as error:
                if not self._leave_out(error):
                    raise

    def _leave_out(self, error: ImpossibleError) -> bool:
        """Leave out the cube, or else the place, of an error; return whether there was one to leave out."""
        failure = failure_in(error)
        if not self.skip or failure is None:
            return False
        asked = [t for t in self.goals.transfers if t in self.transfers or t in self.without_place]
        given = self.options.assignment == "given"
        about = [t for t in asked if t.pick.name in failure.stations]
        about = about or [t for t in asked if given and t.place.name in failure.stations]
        if about:
            if len(asked) == 1:
                return False
            reason = {"cube": about[0].cube, "from": about[0].pick.name, "reason": str(error)}
            self.skipped.append(reason)
            # a cube that had no place may take the place that is now free
            self.transfers = tuple(t for t in asked if t is not about[0])
            return True
        left = [station for station in self.stations if station.name not in failure.stations]
        fewer = 0 < len(left) < len(self.stations)
        self.transfers, self.stations = tuple(asked), left if fewer else self.stations
        return fewer

    def _planned(self, meter: Meter) -> Planned:
        search: TaskSearch | None = None
        try:
            search = self.search()
            steps, found = self.steps(search, meter)
        except ImpossibleError as error:
            with meter.lifted():
                table = self.reach((*(t.pick for t in self.transfers), *self.stations))
                raise find_cause(
                    error, self.scene, self.transfers, self.q_start, self.options, table
                ) from error
        except (BudgetSpent, KeyboardInterrupt) as stop:
            rejected = [] if search is None else list(search.rejected)
            seen = f"; so far: {'; '.join(rejected[:2])}" if rejected else ""
            raise unfinished(stop, f"sequence was found{seen}", rejected=rejected) from stop
        return self._result(search, found, steps)

    def search(self) -> TaskSearch:
        """Return the search.

        Raises:
            ImpossibleError: a source, or too many places, are out of reach.
        """
        self.without_place = ()
        picks, places = (self.reach(some) for some in ([t.pick for t in self.transfers], self.stations))
        picks.require()
        served = [station for station in self.stations if places[station.name].ok]
        too_few = len(served) < len(self.transfers)
        if self.options.assignment != "free" or (too_few and not (self.skip and served)):
            ReachTable((*picks.holes, *places.holes)).require()

        def search(transfers: tuple[Transfer, ...]) -> TaskSearch:
            grasps = {Site(False, i): picks[t.pick.name].feasible() for i, t in enumerate(transfers)}
            grasps |= {Site(True, j): places[station.name].feasible() for j, station in enumerate(served)}
            worlds = TaskWorlds(self.scene, transfers, served)
            return TaskSearch(self.setting, worlds, grasps, self.q_start)

        if not too_few:
            return search(self.transfers)
        searches = [search(some) for some in islice(combinations(self.transfers, len(served)), _MOST_SUBSETS)]
        # the fastest by the estimates without obstacles
        best = min(searches, key=lambda some: round(best_order(some.choices, some.costs.now()).time, 6))
        self.without_place = tuple(t for t in self.transfers if t not in best.worlds.transfers)
        self.transfers = best.worlds.transfers
        return best

    def reach(self, stations: Sequence[Station]) -> ReachTable:
        """Return the reach of these places."""
        return reach_stations(self.setting.robot, self.setting.planned, stations, self.options)

    def steps(self, search: TaskSearch, meter: Meter) -> tuple[list[Step], Found]:
        """Return the steps, timed and certified, and the assignment that they implement."""
        left = min(sum(map(len, search.grasps.values())), _ATTEMPTS)
        while True:
            found = search.best()
            try:
                with meter.lifted():
                    return self.written(search, found), found
            except ClearanceLost as error:
                with meter.lifted():
                    confirmed = search.stopped is not None or search.confirm(found)
                if not confirmed:
                    continue
                left -= 1
                if left <= 0 or search.stopped is not None:
                    raise error.why from error
                # the lines of a goal end the leg to it and begin the next one
                leg = error.step + (error.data.get("role") == "retract")
                search.forbid(found.legs, min(leg, len(found.legs) - 1), error.why)

    def written(self, search: TaskSearch, found: Found) -> list[Step]:
        """Return the steps of an assignment.

        Raises:
            ClearanceLost: a motion does not keep its clearance after timing.
        """
        setting, options = self.setting, self.options
        targets = task_targets(found, search.worlds, self.q_start, options, self.first_cube)
        worlds = AttachmentWorlds(setting.scene, targets, self.state)
        chains, writer = LineChains(setting, worlds), MotionWriter(setting, worlds)
        first = GripperStep("open the gripper", "open", None, 0.0, options.settle_s)
        steps = [first, *writer.steps(sequence_steps(found, chains))]
        self.state = writer.state
        return steps

    def _result(self, search: TaskSearch, found: Found, steps: Sequence[Step]) -> Planned:
        worlds, bound_s = search.worlds, float(np.floor(found.bound * 1e3)) / 1e3
        cubes, touching = [], set()
        for source, place_site in (planned.leg.sites for planned in found.legs if planned.leg.carries):
            transfer, place = worlds.transfers[source.number], worlds.places[place_site.number]
            cubes.append({"cube": transfer.cube, "from": transfer.pick.name, "to": place.name})
            touching |= {frozenset((transfer.cube, name)) for name in transfer.pick.touches | place.touches}
        reason = f"only {len(worlds.places)} places are free and in reach"
        no_place = [{"cube": t.cube, "from": t.pick.name, "reason": reason} for t in self.without_place]
        stopped = ""
        if search.stopped is not None:
            stopped = (
                f"{budget_words(search.stopped)}: this is the best complete sequence found by then; "
                f"no plan takes less than {bound_s:.1f} s"
            )
        return Planned(
            setting=self.setting,
            q_start=self.q_start,
            q_end=self.q_start,
            steps=tuple(steps),
            reached=(),
            lower_bound_s=bound_s,
            state=self.state,
            cubes=tuple(cubes),
            touching=frozenset(touching),
            stopped=stopped,
            above_bound_s=_above(found, steps),
            skipped=(*self.skipped, *no_place),
            interrupted=isinstance(search.stopped, KeyboardInterrupt),
        )


def _above(found: Found, steps: Sequence[Step]) -> dict[str, float]:
    """Return the excess of a plan's motion over its lower bound by cause, s."""
    gap = asdict(found.gap)
    gap["sent"] = sum(step.path.duration_s for step in steps if isinstance(step, Move)) - found.time
    return {name: round(seconds, 3) + 0.0 for name, seconds in gap.items()}
