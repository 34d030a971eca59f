"""A whole task: every cube fetched, carried and set down, timed, turned into segments, and certified as it is sent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import cache
from importlib.metadata import version
from typing import Any

import numpy as np
import numpy.typing as npt
from plan.pick_place.motions import ClearanceLost, MotionWriter

from arm.arguments import shown
from arm.controller.unit import Limits, Unit
from arm.errors import ImpossibleError, InputError
from arm.plan_file import GripperStep, LookStep, Move, Plan, Step
from arm.se3 import Array
from plan.budget import BudgetSpent, Meter, PlanningInterrupted, SearchBudget, allowed, budget_words
from plan.cartesian.reachability import ReachTable, reach_stations
from plan.kinematics.configuration import check_configuration
from plan.options import PlanOptions
from plan.program.assignment.cause import find_cause
from plan.program.assignment.search import Found, TaskSearch
from plan.program.assignment.worlds import TaskWorlds
from plan.scene import Scene, Station, Transfer

_LIBRARIES = ("pin", "coal", "numpy", "scipy")
# The search may be asked again, where what it chose could not be timed and proved, as often as there are ways to serve
# all places (each time one of them, or a leg, is given up), but so often at most.
_ATTEMPTS = 100
# What rounding to counts may move a joint, rad, at the most.
ROUNDING = 1e-4


def plan_task(
    scene: Scene,
    transfers: Sequence[Transfer],
    q_start: npt.ArrayLike,
    unit: Unit,
    limits: Limits | None = None,
    options: PlanOptions | None = None,
    provenance: Mapping[str, Any] | None = None,
    task: Mapping[str, Any] | None = None,
    places: Sequence[Station] = (),
    budget: SearchBudget | None = None,
) -> Plan:
    """Plan all transfers, from `q_start` back to `q_start`.

    Order and target of the cubes, the way of gripping each and the branch of the arm are chosen together for the least
    time (`plan.program.assignment.search`), unless the options give them. Reach of every place is checked before
    anything is planned. Motion stops only where the gripper acts, at home and to look. Each move of the plan
    is proved to keep the asked clearance after it was timed and rounded to counts.

    Args:
        scene: bodies, cubes, and the arm with open and with closed jaws.
        transfers: which cube from where to where; with ``assignment`` free, where to is chosen among all places.
        q_start: where the arm stands, and looks from, (6,) rad.
        unit: the arm's counts and registers.
        limits: at speed 1; default: those of the unit's default registers.
        options: see `PlanOptions`.
        provenance: what else the plan rests on (calibration, files); JSON types. Its key `notes` becomes the
            plan's notes.
        task: name and kind of the task, for the plan file; JSON types.
        places: more places that cubes may go to.
        budget: what the search may cost. Where effort is spent, the best complete sequence by then is planned, and the
            plan's notes tell of it (`search`).

    Raises:
        InputError: no transfers, an unknown cube, or a start outside limits.
        ImpossibleError: a place is out of reach, or no clear way was found; says which and by how much; data: failure,
            see `plan.failure`. What would help is found by `plan.advice.search`. Or the budget was spent
            before a sequence was complete; data: budget.
        PlanningInterrupted: by Ctrl-C; with the best plan that was complete by then, if one was.
    """
    options = options or PlanOptions()
    limits = limits or unit.limits()
    planner = Planner(scene, q_start, unit, limits, options)
    planner.check_input(transfers)
    search: TaskSearch | None = None
    with allowed(budget) as meter:
        try:
            search = planner.search(transfers, places)
            steps, found = planner.steps(search, meter)
        except ImpossibleError as error:
            with meter.lifted():
                table = planner.reach((*(t.pick for t in transfers), *planner.stations(transfers, places)))
                raise find_cause(error, scene, transfers, planner.q_start, options, table) from error
        except (BudgetSpent, KeyboardInterrupt) as stop:
            raise _ended(stop, search) from stop
    stated = dict(provenance or {})
    told = ""
    if search.stopped is not None:
        told = (
            f"{budget_words(search.stopped)}: this is the best sequence that was complete by then; "
            f"no plan takes less than {_rounded_down(found.bound):.1f} s"
        )
        stated["notes"] = {**stated.get("notes", {}), "search": told}
    touching = scene.allowed | {
        frozenset((search.stages.cubes[s.visit.pick].name, name))
        for s in found.stops
        for name in search.stages.transfers[s.visit.pick].pick.touches
        | search.stages.places[s.visit.place].touches
    }
    cubes = [
        {
            "cube": search.stages.cubes[s.visit.pick].name,
            "from": search.stages.transfers[s.visit.pick].pick.name,
            "to": search.stages.places[s.visit.place].name,
        }
        for s in found.stops
    ]
    plan = plan_of(
        scene.allowing(touching),
        steps,
        unit,
        limits,
        options,
        stated,
        {
            **(task or {}),
            "cubes": cubes,
            "no_plan_is_faster_than_s": _rounded_down(found.bound),
            "above_that_s": _above(found, steps),
        },
    )
    if isinstance(search.stopped, KeyboardInterrupt):
        raise PlanningInterrupted(told, plan) from search.stopped
    return plan


def _above(found: Found, steps: Sequence[Step]) -> dict[str, float]:
    """What the motion of a plan takes more than its bound, by cause; s."""
    gap = asdict(found.gap)
    gap["sent"] = sum(step.path.duration_s for step in steps if isinstance(step, Move)) - found.time
    return {name: round(seconds, 3) + 0.0 for name, seconds in gap.items()}


def _ended(stop: BudgetSpent | KeyboardInterrupt, search: TaskSearch | None) -> BaseException:
    """What to raise where a search ended before a sequence was complete."""
    rejected = [] if search is None else list(search.rejected)
    seen = f"; so far: {'; '.join(rejected[:2])}" if rejected else ""
    text = f"{budget_words(stop)}: no sequence that moves all cubes was complete{seen}"
    if isinstance(stop, KeyboardInterrupt):
        return PlanningInterrupted(text)
    return ImpossibleError(
        text, budget=stop.by, budget_s=stop.allowed_s, effort_s=stop.effort_s, rejected=rejected
    )


def plan_of(
    scene: Scene,
    steps: Sequence[Step],
    unit: Unit,
    limits: Limits,
    options: PlanOptions,
    provenance: Mapping[str, Any] | None,
    task: Mapping[str, Any],
) -> Plan:
    """Steps as a plan, with what they rest on; the key `notes` of `provenance` becomes the plan's notes."""
    registers = _registers(unit, limits)
    stated = dict(provenance or {})
    notes = stated.pop("notes", {})
    return Plan(
        task=dict(task),
        unit=unit.name,
        speed=options.speed,
        speed_registers=registers["speed"],
        acceleration_registers=registers["acceleration"],
        steps=tuple(steps),
        provenance={**stated, **resting_on(scene, unit, options)},
        scene=scene.to_json(),
        notes={**notes, "versions": dict(_versions())},
    )


def resting_on(scene: Scene, unit: Unit, options: PlanOptions) -> dict[str, Any]:
    """The part of a plan's provenance that planning itself states; JSON types.

    Args:
        scene: of the plan, with all contacts that it allows.
        unit: whose counts it is in.
        options: that it was planned with.
    """
    return {
        "scene": scene.digest,
        "robot_open": scene.robot_open.digest,
        "robot_holding": scene.robot_holding.digest,
        "unit": unit.digest,
        "options": options.to_json(),
    }


@cache
def _versions() -> dict[str, str]:
    return {name: version(name) for name in _LIBRARIES}


def _registers(unit: Unit, limits: Limits) -> dict[str, tuple[int, ...]]:
    """The controller's registers that `limits` came from."""
    scale = np.abs(unit.counts_per_rad) * 256.0
    return {
        "speed": tuple(int(v) for v in np.rint(limits.velocity * scale / 1e3)),
        "acceleration": tuple(int(v) for v in np.rint(limits.acceleration * scale / 1e6)),
    }


def planned_limits(limits: Limits, options: PlanOptions) -> Limits:
    """The part of the limits (at speed 1) that motion is planned under."""
    sent = limits.scaled(options.speed)
    return Limits(
        limits.lower,
        limits.upper,
        sent.velocity * options.velocity_fraction,
        sent.acceleration * options.acceleration_fraction,
    )


class Planner:
    """Searches, then writes the steps.

    Raises:
        InputError: a start that is not one finite number per joint, or beyond limits by more than what rounding does.

    Attributes:
        q_start: a whole number of counts, (6,) rad.
        sent: limits that hold on what is sent.
        planned: the part of them that motion is timed with.
    """

    def __init__(
        self, scene: Scene, q_start: npt.ArrayLike, unit: Unit, limits: Limits, options: PlanOptions
    ) -> None:
        self.scene, self.unit, self.options = scene, unit, options
        # a configuration that is a whole number of counts, so that moves meet to the count
        at = check_configuration("q_start", q_start, scene.robot_open, limits, ROUNDING)
        if unit.counts_per_rad.shape != at.shape:
            raise InputError(
                f"unit {unit.name}: has {len(unit.counts_per_rad)} axes, the arm has {len(at)} joints",
                name=unit.name,
            )
        self.q_start = unit.positions(unit.counts(at))
        self.sent = limits.scaled(options.speed)
        self.planned = planned_limits(limits, options)

    def check_input(self, transfers: Sequence[Transfer]) -> None:
        if not transfers:
            raise InputError("a task needs at least one cube to move", transfers=0)
        for transfer in transfers:
            if not isinstance(transfer, Transfer):
                raise InputError(f"transfers: {shown(transfer)}: must be a Transfer", value=shown(transfer))
            self.scene.cube(transfer.cube)
        self.check_standing("q_start", self.q_start)

    def check_standing(self, name: str, q: npt.ArrayLike) -> Array:
        """A configuration (n,) rad as counts have it, refused beyond limits.

        Raises:
            InputError: as `plan.kinematics.configuration.check_configuration`.
        """
        robot, limits = self.scene.robot_open, self.planned
        at = check_configuration(name, q, robot, limits, ROUNDING)
        return check_configuration(name, self.unit.positions(self.unit.counts(at)), robot, limits)

    def search(self, transfers: Sequence[Transfer], more: Sequence[Station]) -> TaskSearch:
        """The search for the task; refused here if a pick, or too many places, cannot be served."""
        stations = self.stations(transfers, more)
        picks, places = (self.reach(some) for some in ([t.pick for t in transfers], stations))
        picks.require()
        served = [station for station in stations if places[station.name].ok]
        if self.options.assignment != "free" or len(served) < len(transfers):
            ReachTable((*picks.holes, *places.holes)).require()
        stages = TaskWorlds(self.scene, transfers, served)
        return TaskSearch(
            stages,
            [picks[t.pick.name].feasible() for t in transfers],
            [places[station.name].feasible() for station in served],
            self.q_start,
            self.planned,
            self.options,
        )

    def stations(self, transfers: Sequence[Transfer], more: Sequence[Station]) -> list[Station]:
        """Places where cubes may go."""
        stations = [t.place for t in transfers]
        if self.options.assignment == "free":
            known = {station.name for station in stations}
            stations += [station for station in more if station.name not in known]
        return stations

    def reach(self, stations: Sequence[Station]) -> ReachTable:
        """Reach of these places."""
        return reach_stations(self.scene.robot_open, self.planned, stations, self.options)

    def steps(self, search: TaskSearch, meter: Meter) -> tuple[list[Step], Found]:
        """The task's steps, timed and certified, and the sequence that they follow."""
        ways = sum(map(len, (*search.picks, *search.places)))
        left = min(ways, _ATTEMPTS)
        while True:
            found = search.best()
            try:
                with meter.lifted():
                    return self.written(search, found), found
            except ClearanceLost as error:
                left -= 1
                if left <= 0 or search.stopped is not None:
                    raise error.why from error
                search.forbid(found.stops, error.stop, error.which, error.why)

    def written(self, search: TaskSearch, found: Found) -> list[Step]:
        """Steps of a sequence.

        Raises:
            Unprovable: a leg of it does not keep its clearance once it is timed.
        """
        options = self.options
        script = MotionWriter(self.scene, self.unit, self.planned, self.sent, options, self.q_start)
        steps: list[Step] = [GripperStep("open the gripper", "open", None, 0.0, options.settle_s)]
        # home again and a look where they are asked for
        for index, stop in enumerate(found.stops):
            steps += script.stop(index, stop, search.stages)
            if stop.home is not None and options.look != "never":
                steps.append(LookStep(f"look after {search.stages.cubes[stop.visit.pick].name}"))
        return steps


def _rounded_down(seconds: float) -> float:
    return float(np.floor(seconds * 1e3)) / 1e3
