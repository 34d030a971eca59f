"""Plan and certify a list of poses and configurations, in a cell or for the arm of an arm file, as a plan file.

The obstacles are table and walls, and boards and cubes if a look is given, or the bodies of the arm file. Every move
keeps the clearance of the cell or arm file.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from typing import Any

import numpy as np

from arm.controller.segments import CountPath, Segment
from arm.controller.unit import Limits, Unit
from arm.errors import FileInputError, ImpossibleError, InputError
from arm.io.storage import read_bytes, sha256
from arm.numerics.products import mul, norm
from arm.plan_file import GripperStep, Move, Pause, Plan, Step
from arm.robot.gripper import Gripper
from arm.robot.jaws import with_any_jaws
from arm.robot.model import Robot
from arm.robot.shapes import Body
from arm.se3 import Array, frozen
from cell.config.arm_file import ARM, ArmFile, beyond_limits
from cell.files.pose_list import Entry, PoseList
from cell.files.task import POSES, Task
from cell.scene.build import build_scene
from cell.scene.fingerprint import plan_fingerprint
from cell.scene.options import pose_list_options
from plan.advice.changes import Request
from plan.collision.certificate import certify_move
from plan.collision.missing_srdf import self_collision_help
from plan.collision.world import World
from plan.failure import nearness
from plan.options import PlanOptions
from plan.program.goals.target import Target
from plan.program.planned import Planned
from plan.program.program import Program, plan_program
from plan.program.sequence.refusals import BELOW
from plan.program.setting import Setting
from plan.scene import Scene
from plan.trajectory.virtual_unit import is_virtual, virtual_unit
from vision.observation import Observation

_LONGEST_MS = 60_000  # of a segment in a plan file
_BACK = "q_start"  # name of the goal at the end


_Place = tuple[Entry, list[Entry]]
"""A pose or configuration, and the actions while the arm rests there."""


@dataclass(frozen=True, eq=False)
class ListPlace:
    """What a list is planned in.

    Attributes:
        name, kind: of the task, as the plan states them.
        scene: the arm and the bodies around it.
        unit: in whose counts the plan is.
        limits: at speed 1.
        q_start: where the arm is, and returns to.
        options: of planning; they hold the clearance of all moves.
        gripper: whose jaws the list opens and closes; None: the arm has none that is known.
        provenance: what the plan states besides what planning does; see `plan.program.program.Program`.
    """

    name: str
    kind: str
    scene: Scene
    unit: Unit
    limits: Limits
    q_start: Array
    options: PlanOptions
    gripper: Gripper | None
    provenance: dict[str, Any]

    def beyond_limits(self, q: Array) -> str:
        """Return in words the limit that a configuration violates; "" if it violates none."""
        if is_virtual(self.unit):
            beyond = beyond_limits(self.unit.axes, q, self.limits)
            return beyond and f"in rad, m where a joint slides: {beyond}"
        beyond = self.unit.beyond_limits(q)
        return beyond and f"in deg: {beyond}"


def place_of_cell(task: Task, observation: Observation | None, speed: float) -> ListPlace:
    """Return the cell of a task, with the boards and cubes of an observation or else without any."""
    cell = task.cell
    return ListPlace(
        task.name,
        task.kind,
        build_scene(cell, observation or Observation()),
        cell.unit,
        cell.limits,
        cell.q_start,
        pose_list_options(task, speed),
        cell.gripper if cell.has_jaws else None,
        plan_fingerprint(task),
    )


def place_of_arm(arm: ArmFile, speed: float) -> ListPlace:
    """Return the arm of an arm file among its bodies."""
    stated = {"notes": {"a465": version("a465")}, "inputs": {ARM: dict(arm.inputs)}}
    unit, scene = virtual_unit(arm.robot, arm.limits), Scene(arm.robot, arm.robot, arm.bodies, ())
    options = replace(arm.options, speed=speed)
    return ListPlace(arm.file.stem, POSES, scene, unit, arm.limits, arm.q_start, options, None, stated)


def plan_pose_list(
    place: ListPlace,
    poses: PoseList,
    back: bool,
    explain: Callable[[Request, ImpossibleError], None] | None = None,
) -> Plan:
    """Plan from rest at q_start through the whole list.

    Args:
        place: the arm, and what stands around it.
        poses: the list.
        back: whether the arm returns to q_start at the end.
        explain: called with what could not be planned, and the error, before that is raised.

    Raises:
        InputError: a configuration beyond the joint limits; a value that `plan.program.goals.target.Target` refuses.
        ImpossibleError: a pose is out of reach, a body is too close, or there is no clear path; names the entry.
    """
    return _Planner(place, poses, explain).plan(back)


class _Planner:
    """Build the plan of a list, leg by leg.

    Attributes:
        fraction_closed: of the jaws after the steps so far.
        at: counts at the end of the steps so far.
        steps: of the plan.
        reached: name and configuration of each pose and configuration, in order.
    """

    def __init__(
        self,
        place: ListPlace,
        poses: PoseList,
        explain: Callable[[Request, ImpossibleError], None] | None,
    ) -> None:
        self.place, self.poses, self.explain = place, poses, explain
        self.scene, self.options, self.clearance = place.scene, place.options, place.options.clearance
        jaws = next((entry for entry in poses.entries if entry.jaws is not None), None)
        if jaws is not None and place.gripper is None:
            rule = f"jaws: the arm of {place.name} has no jaws that move; leave it out"
            raise FileInputError(poses.file, jaws.key, None, rule)
        self.closes = any(entry.jaws for entry in poses.entries)
        # if the jaws close, their content is unknown, so the fingers are extended until they meet
        self.robot: Robot = with_any_jaws(self.scene.robot_open) if self.closes else self.scene.robot_open
        self.bodies: tuple[Body, ...] = (*self.scene.bodies, *self.scene.cubes)
        self.world = World(self.robot, self.bodies)
        self.fraction_closed = 0.0
        self.at = place.unit.counts(place.q_start)
        self.steps: list[Step] = []
        self.reached: list[tuple[str, Array]] = []

    def plan(self, back: bool) -> Plan:
        at_start, places = _places(self.poses.entries)
        for entry in self.poses.entries if back else ():
            if entry.name == _BACK:
                rule = "is where --back leads to; give the entry another name"
                raise FileInputError(self.poses.file, entry.key, _BACK, rule)
        for entry, _ in places:
            if entry.q is not None:
                self.require(entry, entry.q)
        self.act("the start", at_start)
        found = self.moves(places, back)
        if found is None or not any(isinstance(step, Move) for step in self.steps):
            why = f"{self.poses.file}: nothing moves: the list leads to q_start, where the arm is"
            raise ImpossibleError(why, file=str(self.poses.file))
        task: dict[str, object] = {
            "name": self.place.name,
            "kind": self.place.kind,
            "poses": [{"name": name, "q": [round(float(v), 9) + 0.0 for v in q]} for name, q in self.reached],
        }
        stated = self.place.provenance
        stated["notes"]["poses"] = sha256(read_bytes(self.poses.file, "pose list"))
        # the file states the cell's arm, whose jaws open and close; the motions are clear for any opening of them
        setting = Setting(self.scene, self.place.unit, self.place.limits, self.options)
        return replace(found, setting=setting, steps=tuple(self.steps), provenance=stated, task=task).plan()

    def require(self, entry: Entry, q: Array) -> None:
        """Require that a configuration is within limits and clear."""
        rule = self.place.beyond_limits(q)
        if rule:
            own = is_virtual(self.place.unit)
            values = [round(float(v), 3) for v in (q if own else np.degrees(q))]
            help = (
                "" if own or entry.in_deg or np.abs(q).max() <= 2.0 * np.pi else "were degrees read as rad?"
            )
            raise FileInputError(self.poses.file, entry.key, values, rule, help)
        closest = self.world.distance(q)
        if closest.value < self.clearance:
            raise ImpossibleError(
                f"{self.poses.file}: {entry.key} ({entry.name}): "
                f"{nearness(closest.pair, closest.value, self.clearance)}"
                f"{self_collision_help(self.world, q, self.clearance)}",
                entry=entry.key,
                target=entry.name,
                pair=list(closest.pair),
                distance_m=closest.value,
                clearance_m=self.clearance,
                **self.world.state(q),
            )

    def moves(self, places: Sequence[_Place], back: bool) -> Planned | None:
        """Append the moves through all places, with the actions there; return the plan, None if there is no place."""
        place = self.place
        goals = [self.target(entry, actions) for entry, actions in places]
        if back:
            goals.append(Target(_BACK, q=place.q_start))
        if not goals:
            return None
        scene = replace(self.scene, robot_open=self.robot, robot_holding=self.robot)
        program = Program(scene, tuple(goals), place.q_start, place.unit, place.limits, self.options)
        try:
            found = plan_program(program)
        except ImpossibleError as error:
            if self.explain is not None:
                asked = scene, (), place.q_start, place.unit, place.limits, self.options
                self.explain(Request(*asked, goals=tuple(goals)), error)
            raise self.located(error, places) from error
        actions_at = {entry.name: actions for entry, actions in places}
        for step in found.steps:
            if isinstance(step, Pause):
                self.act(step.name, actions_at[step.name])
            elif isinstance(step, Move):
                self.move(step, step.name)
        self.reached = [(r.target, r.q) for r in found.reached if r.target != _BACK]
        return found

    def target(self, entry: Entry, actions: Sequence[Entry]) -> Target:
        T_base_tool = entry.T
        if T_base_tool is not None and entry.frame == "flange":
            T_base_tool = frozen(mul(T_base_tool, self.robot.T_end_tool))
        acts = any(action.jaws is not None or action.dwell_s > 0.0 for action in actions)
        rest_s = sum(action.dwell_s for action in actions)
        try:
            return Target(
                entry.name,
                T_base_tool,
                q=entry.q,
                free=entry.free,
                tilt=entry.tilt,
                ranges=entry.ranges,
                by=entry.by,
                approach=entry.approach,
                retract=entry.retract,
                speed=entry.speed,
                blend_radius=entry.within,
                dwell_s=max(rest_s, self.options.settle_s, 1e-3) if acts else 0.0,
            )
        except InputError as error:
            raise FileInputError(self.poses.file, entry.key, None, str(error)) from error

    def move(self, move: Move, name: str) -> None:
        """Append a move. A plan file calls every move that keeps the cell's clearance a transit."""
        gripper = self.place.gripper
        opening = 0.0 if gripper is None else gripper.width(self.fraction_closed)
        self.steps.append(replace(move, name=name, role="transit", cube=None, jaw_opening=opening))
        self.at = np.array(move.path.end, dtype=np.int64)

    def act(self, place: str, actions: Sequence[Entry]) -> None:
        """Append the actions at a place in the order of the file; in one entry the jaws act before the dwell."""
        for action in actions:
            if action.jaws is not None:
                word = "close" if action.jaws > 0.0 else "open"
                self.steps.append(
                    GripperStep(f"{word} at {place}", word, None, action.jaws, self.options.settle_s)
                )
                self.fraction_closed = action.jaws
            if action.dwell_s > 0.0:
                self.rest(place, action.dwell_s)

    def rest(self, name: str, dwell_s: float) -> None:
        """Append a dwell: segments of zero length, certified like all others."""
        left_ms = round(1e3 * dwell_s)
        zero = ((0,) * len(self.at),) * 3
        lengths_ms = [min(_LONGEST_MS, left_ms - begin) for begin in range(0, left_ms, _LONGEST_MS)]
        path = CountPath(tuple(int(c) for c in self.at), tuple(Segment(ms, zero) for ms in lengths_ms))
        if not path.segments:
            return
        check = certify_move(self.world, path, self.place.unit, self.clearance)
        if not check.proved:
            why = f"{self.poses.file}: rest at {name}: {nearness(check.pair, check.seen, self.clearance)}"
            at = self.world.state(self.place.unit.positions(self.at))
            raise ImpossibleError(why, target=name, pair=list(check.pair), distance_m=check.seen, **at)
        clearance = float(np.floor(check.clearance * 1e7)) / 1e7
        clearances = (clearance,) * len(path.segments)
        dwell = Move(name, "transit", None, path, None, 0.0, clearance, check.pair, True, (), clearances)
        self.move(dwell, f"rest at {name}")

    def located(self, error: ImpossibleError, places: Sequence[_Place]) -> ImpossibleError:
        """Return the error with the file and its entry, or the entries between which it arose."""
        entries = [entry for entry, _ in places]
        about = [e for e in entries if e.name == error.data.get("target")] or entries
        where = " to ".join(dict.fromkeys(e.key for e in (*about[:1], *about[-1:]))) or "return to q_start"
        data = {k: v for k, v in error.data.items() if k != "entry"}
        why = f"{self.poses.file}: {where}: {error}"
        if about[0].frame == "flange" and BELOW in why:
            length = f"{1e3 * norm(self.robot.T_end_tool[:3, 3]):.0f} mm"
            why += f"; the pose is of the flange, and the tool is {length} long: is it of the finger tips (frame tool)?"
        return ImpossibleError(why, entry=where, **data)


def _places(entries: Sequence[Entry]) -> tuple[list[Entry], list[_Place]]:
    """The actions at the start, and every pose and configuration with its own."""
    at_start: list[Entry] = []
    actions, places = at_start, []
    for entry in entries:
        if entry.T is not None or entry.q is not None:
            actions = []
            places.append((entry, actions))
        actions.append(entry)
    return at_start, places
