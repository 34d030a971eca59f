"""A whole task: every cube fetched, carried and set down, timed, turned into segments, and certified as it is sent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from typing import Any

import numpy as np
import numpy.typing as npt

from arm.bodies import Box
from arm.errors import ImpossibleError, InputError
from arm.motion import CountPath
from arm.planfile import GripperStep, LookStep, Move, Plan, Step
from arm.robot import Robot
from arm.se3 import Array, frozen
from arm.unit import Limits, Unit
from plan.check import check_move
from plan.line import JointPath
from plan.options import PlanOptions
from plan.reach import ReachTable, reach
from plan.scene import Scene, Station, Transfer
from plan.segments import LineTolerance, to_segments
from plan.stages import Stages
from plan.timing import time_line, time_path
from plan.transfer import Grip, Route, TransferSearch
from plan.world import World

# How far a motion may round the corners of its way-points, rad; the first that keeps its clearance is taken.
_BLENDS = (0.1, 0.03, 0.01)
_LIBRARIES = ("pin", "coal", "toppra", "numpy", "scipy")


def plan_task(
    scene: Scene,
    transfers: Sequence[Transfer],
    q_start: npt.ArrayLike,
    unit: Unit,
    limits: Limits | None = None,
    options: PlanOptions | None = None,
    provenance: Mapping[str, Any] | None = None,
    task: Mapping[str, Any] | None = None,
) -> Plan:
    """Plan all transfers in the order given, from `q_start` back to `q_start`.

    Reach of every place is checked before anything is planned. Each move of the plan is proved to keep the asked
    clearance after it was timed and rounded to counts.

    Args:
        scene: bodies, cubes, and the arm with open and with closed jaws.
        transfers: which cube from where to where.
        q_start: where the arm stands, and looks from, (6,) rad.
        unit: the arm's counts and registers.
        limits: at speed 1; default: those of the unit's default registers.
        options: see `PlanOptions`.
        provenance: what else the plan rests on (calibration, files); JSON types.
        task: name and kind of the task, for the plan file; JSON types.

    Raises:
        InputError: no transfers, an unknown cube, or a start outside limits.
        ImpossibleError: a place is out of reach, or no clear way was found; says which, by how much, and what helps.
    """
    options = options or PlanOptions()
    limits = limits or unit.limits()
    planner = Planner(scene, np.asarray(q_start, dtype=float), unit, limits, options)
    planner.check_input(transfers)
    tables = planner.reach(transfers)
    steps: list[Step] = [GripperStep("open the gripper", "open", None, 0.0, options.settle_s)]
    for index, transfer in enumerate(transfers):
        steps += planner.transfer(index, transfer, *tables, last=index + 1 == len(transfers))
    allowed = scene.allowed | {
        frozenset((t.cube, name)) for t in transfers for name in t.pick.touches | t.place.touches
    }
    cubes = [{"cube": t.cube, "from": t.pick.name, "to": t.place.name} for t in transfers]
    return plan_of(
        replace(scene, allowed=allowed),
        steps,
        unit,
        limits,
        options,
        {**(provenance or {}), "scene": scene.digest},
        {**(task or {}), "cubes": cubes},
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
    """Steps as a plan, with what they rest on."""
    registers = _registers(unit, limits)
    return Plan(
        task=dict(task),
        unit=unit.name,
        speed=options.speed,
        speed_registers=registers["speed"],
        acceleration_registers=registers["acceleration"],
        steps=tuple(steps),
        provenance={
            "scene": scene.digest,
            **(provenance or {}),
            "robot_open": scene.robot_open.digest,
            "robot_holding": scene.robot_holding.digest,
            "unit": unit.digest,
            "options": options.to_json(),
            "versions": {name: version(name) for name in _LIBRARIES},
        },
        scene=scene.to_json(),
    )


def _registers(unit: Unit, limits: Limits) -> dict[str, tuple[int, ...]]:
    """The controller's registers that `limits` came from."""
    scale = np.abs(unit.counts_per_rad) * 256.0
    return {
        "speed": tuple(int(v) for v in np.rint(limits.velocity * scale / 1e3)),
        "acceleration": tuple(int(v) for v in np.rint(limits.acceleration * scale / 1e6)),
    }


class Planner:
    """Plans transfer after transfer; `scene` and `q` are where things stand by then.

    Attributes:
        q: where the arm stands, a whole number of counts, (6,) rad.
        sent: limits that hold on what is sent.
        planned: the part of them that motion is timed with.
    """

    def __init__(
        self, scene: Scene, q_start: Array, unit: Unit, limits: Limits, options: PlanOptions
    ) -> None:
        self.scene, self.unit, self.options = scene, unit, options
        # a configuration that is a whole number of counts, so that moves meet to the count
        self.q_start = self.q = unit.positions(unit.counts(q_start))
        self.sent = limits.scaled(options.speed)
        self.planned = Limits(
            limits.lower,
            limits.upper,
            self.sent.velocity * options.velocity_fraction,
            self.sent.acceleration * options.acceleration_fraction,
        )

    def check_input(self, transfers: Sequence[Transfer]) -> None:
        if not transfers:
            raise InputError("a task needs at least one cube to move", transfers=0)
        for transfer in transfers:
            self.scene.cube(transfer.cube)
        for name, q, low, high in zip(
            self.scene.robot_open.joint_names, self.q, self.planned.lower, self.planned.upper, strict=True
        ):
            if not low <= q <= high:
                raise InputError(
                    f"q_start: joint {name} = {np.degrees(q):.2f} deg: must be from {np.degrees(low):.2f} to "
                    f"{np.degrees(high):.2f} deg",
                    joint=name,
                    value=float(q),
                )

    def reach(self, transfers: Sequence[Transfer]) -> tuple[ReachTable, ReachTable]:
        """Tables of the picks and the places; refused here if any cannot be served."""
        robot, offset = self.scene.robot_open, self.options.offset
        picks, places = (
            reach(robot, self.planned, {s.name: s.T_base_tool for s in stations}, offset)
            for stations in ([t.pick for t in transfers], [t.place for t in transfers])
        )
        ReachTable((*picks.holes, *places.holes)).require()
        return picks, places

    def transfer(
        self, index: int, transfer: Transfer, picks: ReachTable, places: ReachTable, last: bool
    ) -> list[Step]:
        """Steps of one cube; moves the cube in `scene` and the arm in `q`."""
        options = self.options
        go_home = last or options.look == "each"
        stages = Stages(self.scene, transfer)
        search = TransferSearch(
            stages,
            picks[transfer.pick.name].serving(),
            places[transfer.place.name].serving(),
            self.q,
            self.q_start if go_home else None,
            self.planned,
            options,
        )
        route = search.best()
        executed = Stages(self.scene, self.as_executed(transfer, route))
        steps = self.steps(index, transfer, executed, route)
        placed = executed.placed(0, 0)
        self.scene = replace(
            self.scene, cubes=tuple(placed if c.name == placed.name else c for c in self.scene.cubes)
        )
        self.q = self.q_start if go_home else route.place.q_offset
        if options.look == "each":
            steps.append(LookStep(f"look after {transfer.cube}"))
        return steps

    def as_executed(self, transfer: Transfer, route: Route) -> Transfer:
        """The transfer with the one tool pose at each end that whole counts of the route's grips give."""

        def station(of: Station, grip: Grip) -> Station:
            q = self.unit.positions(self.unit.counts(grip.path.q[0]))
            return Station(of.name, (self.scene.robot_open.T_base_tool(q),), of.touches)

        return Transfer(
            transfer.cube, station(transfer.pick, route.pick), station(transfer.place, route.place)
        )

    def steps(self, index: int, transfer: Transfer, stages: Stages, route: Route) -> list[Step]:
        """The moves of a route, timed and certified, with the gripper's steps between.

        `stages` are those of the transfer as executed: its stations have one tool pose each.
        """
        options, cube, pick, place = self.options, transfer.cube, route.pick, route.place
        before, after, holding = stages.before(), stages.after(0, 0), stages.holding(0)
        lifting = stages.holding(0, transfer.pick.touches)
        lowering = stages.holding(0, transfer.place.touches)
        to = _Job(index, cube)
        steps: list[Step | None] = [
            self.transit(to, f"to {pick.station}", "transit", before, route.out, held=False),
            self.line(to, f"approach {pick.station}", "approach", before, pick, held=False),
            GripperStep(f"{cube}: close on it", "close", index, options.fraction_closed, options.settle_s),
            _touching(
                self.line(to, f"lift off {pick.station}", "retract", lifting, pick, held=True), transfer.pick
            ),
            self.transit(to, f"to {place.station}", "transit", holding, route.across, held=True),
            _touching(
                self.line(to, f"approach {place.station}", "approach", lowering, place, held=True),
                transfer.place,
            ),
            GripperStep(f"{cube}: let go", "open", index, 0.0, options.settle_s),
            self.line(to, f"retract from {place.station}", "retract", after, place, held=False),
        ]
        if route.back is not None:
            steps.append(self.transit(to, "home", "home", after, route.back, held=False))
        return [step for step in steps if step is not None]

    def way(self, name: str, world: World, waypoints: Array) -> Move | None:
        """A timed transit that serves no cube, with empty jaws; None where there is no way to go."""
        return self.transit(_Job(None, "arm"), name, "home", world, waypoints, held=False)

    def transit(
        self, job: _Job, name: str, role: str, world: World, waypoints: Array, held: bool
    ) -> Move | None:
        """A timed transit that keeps its clearance, or None where there is no way to go."""
        q = self.unit.positions(self.unit.counts(waypoints))
        if np.array_equal(q[0], q[-1]) and len(q) == 2:
            return None
        clearance = self.options.clearance
        corners = [("blend", blend) for blend in _BLENDS] if len(q) > 2 else []
        for style, blend in [*corners, ("stop", _BLENDS[-1])]:
            trajectory = time_path(q, self.planned, corners=style, blend=blend)
            path = to_segments(trajectory, self.unit, self.options.segment_ms, limits=self.sent)
            check = check_move(world, path, self.unit, clearance, tight=False)
            if check.proved:
                break
        return self.certified(job, name, role, world, path, clearance, held)

    def line(self, job: _Job, name: str, role: str, world: World, grip: Grip, held: bool) -> Move:
        """A timed line, away from the station (retract) or towards it (approach)."""
        path = grip.path if role == "retract" else _reversed(grip.path)
        trajectory = time_line(path, self.planned, self.options.approach_speed * self.options.speed)
        segments = to_segments(
            trajectory,
            self.unit,
            self.options.segment_ms,
            limits=self.sent,
            line=LineTolerance(self.scene.robot_open, grip.line),
        )
        return self.certified(job, name, role, world, segments, self.options.line_clearance, held)

    def certified(
        self, job: _Job, name: str, role: str, world: World, path: CountPath, clearance: float, held: bool
    ) -> Move:
        """The move, if it is proved to keep `clearance` as it will be sent.

        Raises:
            ImpossibleError: it does not; data: step, pair, distance_m, time_s.
        """
        check = check_move(world, path, self.unit, clearance)
        step = f"{job.cube}: {name}"
        if not check.proved:
            raise ImpossibleError(
                f"step {step!r}: {check.pair[0]} comes to {check.seen * 1e3:.2f} mm of {check.pair[1]} after "
                f"{check.time:.2f} s, {clearance * 1e3:g} mm are asked for (proved: {check.clearance * 1e3:.2f} mm); "
                "ask for less clearance or move the bodies apart",
                step=step,
                pair=list(check.pair),
                distance_m=check.seen,
                proved_m=check.clearance,
                clearance_m=clearance,
                time_s=check.time,
            )
        return Move(
            name=step,
            role=role,
            cube=job.index,
            path=path,
            held=job.cube if held else None,
            jaw_opening=_jaw_opening(world.robot),
            clearance=_rounded_down(check.clearance),
            closest=check.pair,
            certified=True,
        )


@dataclass(frozen=True)
class _Job:
    """Which cube a step serves."""

    index: int | None
    cube: str


def _touching(move: Move, station: Station) -> Move:
    return replace(move, touching=tuple(sorted(station.touches)))


def _rounded_down(clearance: float) -> float:
    """To a tenth of a micrometre: the last bits differ between processors, and the files must not."""
    return float(np.floor(clearance * 1e7)) / 1e7


def _reversed(path: JointPath) -> JointPath:
    return JointPath(frozen(path.q[::-1]), frozen(path.s[-1] - path.s[::-1]))


def _jaw_opening(robot: Robot) -> float:
    """Distance of the inner faces of the bodies finger_l and finger_r, m; 0 for an arm without them."""
    fingers = {b.name: b for b in robot.bodies if b.name in ("finger_l", "finger_r")}
    if len(fingers) < 2:
        return 0.0
    faces = []
    for finger in fingers.values():
        thickness = finger.shape.size[1] if isinstance(finger.shape, Box) else 0.0
        faces.append(abs(float(finger.T_joint_body[1, 3])) - thickness / 2.0)
    return round(sum(faces), 9)
