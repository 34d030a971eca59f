"""From an observation to a plan: reach of every hole, and the plan of the task."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from itertools import cycle, product
from typing import Any

from arm.errors import ImpossibleError
from arm.numerics.products import norm
from arm.plan_file import Plan
from arm.poses import HolePose
from arm.robot.jaws import after_closing
from arm.se3 import Array
from cell.accuracy.clearances import erring_clearances
from cell.accuracy.error_model import ErrorModel
from cell.cubes.confirm_placed import T_base_of
from cell.cubes.grips import Grip, recovery_grips
from cell.files.task import POSES, Task
from cell.scene.build import build_scene, cube_name, second_look_before
from cell.scene.displaced import (
    DisplacedCube,
    has_room,
    is_displaced,
    is_hidden,
    support_of,
    with_displaced,
)
from cell.scene.fingerprint import plan_fingerprint
from cell.scene.options import options_of
from cell.scene.places import (
    hole_stations,
    nothing_to_plan,
    reachable_places,
    taken_places,
    unused_holes,
)
from plan.advice.changes import Request
from plan.collision.world import World, distance_of
from plan.failure import nearness
from plan.options import PlanOptions
from plan.program.go_to import plan_joint_motion
from plan.scene import Scene, Station, Transfer
from vision.observation import Observation
from vision.occupancy.classify import HoleState, Occupancy

SHORTEST_LINE = 0.045  # m, of an approach or retract: a cube and its pocket's depth
# m, that the approach to a displaced cube and its lift keep if it stands too close to another: beyond the paddings, by
# which boards may have moved. No motion but its lift takes it away from there.
NARROW = 1e-3


def require_above_table(task: Task, observation: Observation) -> None:
    """Require that all holes were seen above the table.

    Raises:
        ImpossibleError: names the holes below it, by how much, and the keys of the cell file; data: below_mm.
    """
    cell = task.cell
    below = {
        hole.name: 1e3 * (cell.table_z - float(hole.T_base_hole[2, 3]))
        for board in observation.boards
        if task.kind == POSES or board.name in {b.name for b in task.boards}
        for hole in board.pose.holes
        if hole.T_base_hole[2, 3] < cell.table_z
    }
    if not below:
        return
    closest = World(cell.robot(), cell.fixed).distance(cell.q_start)
    start = ""
    if "table" in closest.pair and closest.value < cell.clearance:
        start = f"; {nearness(closest.pair, closest.value, cell.clearance)} also at the start (q_start_deg)"
    shown = ", ".join(f"{name} by {depth:.1f} mm" for name, depth in below.items())
    raise ImpossibleError(
        f"holes were seen below the table's top, {shown}: table.top_z_mm = {cell.table_z * 1e3:g} in {cell.file.name}, "
        f"or the camera pose, is wrong{start}",
        below_mm=below,
    )


@dataclass(frozen=True, eq=False)
class Rest:
    """What is left of a task after a look.

    Attributes:
        task: the task.
        observation: boards and the occupancy of their holes, from the last look.
        q_from: configuration from which the arm starts, at rest, (6,) rad.
        speed: for which to plan.
        done: present place of each moved cube, by its name.
        on_table: pose of the centre of each cube that was set down on the table, by its name.
        skip: holes of the source board (0 to 3) whose cube must stay.
        second_looks: names of the cubes that need a second look before they enter their pockets.
        displaced: cubes that are not in their seats. They stay where they are (`plan_recovery` moves one), and holes
            beside them wait for a look without them.
    """

    task: Task
    observation: Observation
    q_from: Array
    speed: float
    done: Mapping[str, str] = field(default_factory=dict)
    on_table: Mapping[str, Array] = field(default_factory=dict)
    skip: Iterable[int] = ()
    displaced: tuple[DisplacedCube, ...] = ()
    second_looks: frozenset[str] = frozenset()

    def look_before(self, cube: str) -> float:
        """How far before its place the arm rests for a second look with a cube, m; 0 if it does not."""
        cell = self.task.cell
        if self.task.to_board is None or cell.second_look == "never":
            return 0.0
        looks = cell.second_look == "each" or cube in self.second_looks
        return second_look_before(cell) if looks else 0.0

    @property
    def scene(self) -> Scene:
        """What surrounds the arm now."""
        cell = self.task.cell
        free: dict[str, HoleState] = {
            cube.near: "empty" for cube in self.displaced if not self._stands_beside_another(cube)
        }
        return with_displaced(
            cell, build_scene(cell, self.observation.with_states(free), self.on_table), self.displaced
        )

    def _stands_beside_another(self, cube: DisplacedCube) -> bool:
        """Whether the hole that a displaced cube is nearest to holds another one, as far away as that takes."""
        T_base_place = T_base_of(self.task, self.observation, cube.near)
        holds = self.observation.state(cube.near) == "cube" and cube.name != cube_name(cube.near)
        if T_base_place is None or not holds:
            return False
        return float(norm(cube.T_base_cube[:3, 3] - T_base_place[:3, 3])) > self.task.cell.cube_size


def request_of(rest: Rest) -> Request:
    """The rest of a task as a request to the planner: a transfer per cube, in the order of the holes.

    Raises:
        ImpossibleError: more cubes than free places, or a board was not detected.
    """
    task, observation, done = rest.task, rest.observation, rest.done
    skip = task.skip or bool(rest.displaced)  # a cube that stays where it is does not keep the others
    source = observation.board(task.from_board.name)
    if source is None:
        raise ImpossibleError(f"board {task.from_board.name} was not found", board=task.from_board.name)
    stations = {s.name: s for s in hole_stations(task, observation)}
    skipped = set(rest.skip)
    picks = [
        hole
        for hole in source.holes("cube", "unsure")
        if hole.index not in skipped
        and cube_name(hole.name) not in done
        and not is_hidden(hole, source.occupancy[hole.index], rest.displaced)
    ]
    skipped_cubes: list[dict[str, str]] = []
    for hole in list(picks):
        try:
            _require_seat(hole, source.occupancy[hole.index])
        except ImpossibleError as error:
            if not task.skip or len(picks) == 1:
                raise
            picks.remove(hole)
            skipped_cubes.append({"cube": cube_name(hole.name), "from": hole.name, "reason": str(error)})
    goals = free_goals(rest)
    if len(goals) < len(picks):
        if not skip or not goals:
            raise _too_few(len(picks), goals, rest)
        if task.assignment == "given":
            reason = f"only {len(goals)} places are free and in reach"
            left_out = [(cube_name(hole.name), hole.name) for hole in picks[len(goals) :]]
            skipped_cubes += [{"cube": cube, "from": name, "reason": reason} for cube, name in left_out]
            picks = picks[: len(goals)]
    transfers = (
        Transfer(cube := cube_name(hole.name), stations[hole.name], goal, rest.look_before(cube))
        for hole, goal in zip(picks, cycle(goals), strict=False)
    )
    return replace(
        empty_request(rest),
        transfers=tuple(transfers),
        places=tuple(goals[len(picks) :]),
        skip=skip,
        skipped=tuple(skipped_cubes),
    )


def _too_few(cubes: int, goals: Sequence[Station], rest: Rest) -> ImpossibleError:
    """The error for more cubes than free places."""
    to_board, filled, unused = rest.task.to_board, set(rest.done.values()), unused_holes(rest.task)
    target = None if to_board is None else rest.observation.board(to_board.name)
    notes, cure = "", "clear the target board, or give the task file more places"
    if to_board is None:
        notes, cure = taken_places(rest.task, rest.observation, filled, rest.speed)
    if target is not None:
        free = {goal.name for goal in goals}
        holes = zip(target.pose.holes, target.occupancy, strict=True)
        taken = [_taken(hole, now) for hole, now in holes if hole.name not in free | unused]
        notes = (
            f" ({'; '.join([*taken, *(f'hole {name} is not one of to_holes' for name in sorted(unused))])})"
        )
        if any(hole.name not in filled | unused for hole in target.holes("unsure")):
            cure = "let the camera see the unsure holes, or clear the target board"
    return ImpossibleError(
        f"{cubes} cubes to move but only {len(goals)} free and reachable places{notes}; {cure}",
        cubes=cubes,
        places=[goal.name for goal in goals],
    )


def empty_request(rest: Rest) -> Request:
    """A request that moves no cube."""
    cell = rest.task.cell
    return Request(rest.scene, (), rest.q_from, cell.unit, cell.limits, options_of(rest.task, rest.speed))


def hidden_holes(rest: Rest) -> list[str]:
    """Say which holes of the source board were left out because a displaced cube is beside them."""
    source = rest.observation.board(rest.task.from_board.name)
    if source is None:
        return []
    near = {cube.near for cube in rest.displaced}
    return [
        f"hole {hole.name} may hold a cube, which stays there: a displaced cube is beside it"
        for hole in source.holes("unsure")
        if hole.name not in near and is_hidden(hole, source.occupancy[hole.index], rest.displaced)
    ]


def plan_recovery(rest: Rest, cube: DisplacedCube, goals: Sequence[Station]) -> Plan:
    """Plan to take a displaced cube from where it is to the best of some stations.

    The jaws are aligned with the cube. If they cannot reach it so, they come and go on shorter lines, lean, or grip
    higher. If that fails too, because it stands close to another cube, lines keep `NARROW` from what the arm passes. At
    last the cube may touch that other cube on its lift, if the lift takes it no nearer.

    Args:
        rest: what is left of the task; `cube` is one of its displaced cubes.
        cube: the cube to move.
        goals: stations to choose from.

    Raises:
        ImpossibleError: there is no plan, also for an arm with its errors; says why the jaws cannot be aligned with the
            cube.
    """
    cell, request = rest.task.cell, empty_request(rest)
    provenance, named = plan_fingerprint(rest.task), _named(rest.task)
    refused: ImpossibleError | None = None
    offsets = dict.fromkeys((cell.offset, max(0.5 * cell.offset, SHORTEST_LINE)))
    for (clearance, grip), offset in product(_recovery_ways(rest, cube, goals), offsets):
        touching = {frozenset((cube.name, name)) for name in grip.pick.touches}
        asked = replace(
            request,
            scene=request.scene.allowing(request.scene.allowed | touching),
            transfers=(Transfer(cube.name, grip.pick, grip.goals[0], _look_before(rest, cube, goals)),),
            places=grip.goals[1:],
            options=replace(request.options, offset=offset, line_clearance=clearance),
        )
        try:
            if (plan := asked.plan(provenance, named)) is not None:
                erring_clearances(cell, plan, rest.observation)
                return plan
        except ImpossibleError as error:
            refused = refused or error
    raise refused or ImpossibleError(f"no plan moves {cube.name}", cube=cube.name)


def _look_before(rest: Rest, cube: DisplacedCube, goals: Sequence[Station]) -> float:
    """As `Rest.look_before`: the jaws that take a cube from a board may move it, so they ask for a look at it."""
    moved = ErrorModel.available(rest.task.cell) and support_of(cube.near) in goals[0].touches
    return replace(rest, second_looks=frozenset((cube.name,) if moved else ())).look_before(cube.name)


def _recovery_ways(rest: Rest, cube: DisplacedCube, goals: Sequence[Station]) -> Iterator[tuple[float, Grip]]:
    """Yield the clearance of lines and the grip of each way to take a displaced cube, best first."""
    cell, lines = rest.task.cell, PlanOptions.line_clearance
    T_base_place = T_base_of(rest.task, rest.observation, cube.near)
    grips = list(recovery_grips(cell, cube, [cube.goal(goal) for goal in goals], T_base_place))
    yield from product((lines, NARROW), grips)
    scene = rest.scene
    body = scene.cube(cube.name)
    close = [
        other
        for other in scene.cubes
        if other is not body and distance_of(body, other).value < lines + 2.0 * cell.moved
    ]
    parted = (grip.lifting_from(body, close) for grip in grips if close)
    yield from ((NARROW, grip) for grip in parted if grip is not None)


def free_goals(rest: Rest) -> tuple[Station, ...]:
    """The places to which a cube may be moved, in order of preference.

    None holds a cube or may hold one, and no displaced cube stands where that cube must pass.
    """
    task, observation, filled = rest.task, rest.observation, set(rest.done.values())
    if task.to_board is None:
        return tuple(s for s in reachable_places(task, observation, rest.speed) if s.name not in filled)
    target = observation.board(task.to_board.name)
    if target is None:
        name = task.to_board.name
        raise ImpossibleError(f"board {name} was not seen, so its holes are not known", board=name)
    stations, kept_out = {s.name: s for s in hole_stations(task, observation)}, filled | unused_holes(task)
    return tuple(
        stations[hole.name]
        for hole in target.holes("empty")
        if hole.name not in kept_out and has_room(hole, rest.displaced)
    )


def _require_seat(hole: HolePose, occupancy: Occupancy) -> None:
    """Require a seated cube. Jaws that close on a cube beside its seat push it, and the palm may hit it.

    Raises:
        ImpossibleError: the hole shows something other than a seated cube.
    """
    if is_displaced(occupancy):
        raise ImpossibleError(
            f"no cube can be taken from hole {hole.name}: {occupancy.reason}; seat the cube, clear the hole, or remove "
            "the shadow, and look again",
            hole=hole.name,
            reason=occupancy.reason,
        )


def _taken(hole: HolePose, occupancy: Occupancy) -> str:
    if occupancy.state != "unsure":
        return f"hole {hole.name} holds a cube"
    return f"hole {hole.name} may hold a cube; it is unsure ({occupancy.reason or 'no reason given'})"


def _named(task: Task) -> dict[str, Any]:
    return {"name": task.name, "kind": task.kind}


def plan_rest(rest: Rest) -> Plan | None:
    """Plan the rest of a task; return None if nothing is left.

    Raises:
        ImpossibleError: there is no plan; names the step, and the hole, joint or pair of bodies, with the margin.
    """
    require_above_table(rest.task, rest.observation)
    return request_of(rest).plan(plan_fingerprint(rest.task), _named(rest.task))


def plan_otherwise(rest: Rest, observation: Observation, without: Set[str]) -> Plan:
    """Plan the rest of a task for another look, without some holes of the target board.

    Raises:
        ImpossibleError: there is no plan.
    """
    task = without_holes(rest.task, without)
    plan = plan_rest(replace(rest, task=task, observation=observation))
    if plan is None:
        raise nothing_to_plan(task, observation)
    return plan


def without_holes(task: Task, names: Set[str]) -> Task:
    """The task without some holes of its target board, such as ``03-04/1``."""
    if task.to_board is None:
        return task
    return replace(task, to_holes=tuple(n for n in task.to_holes if f"{task.to_board.name}/{n}" not in names))


def skipped_cubes(plan: Plan | None) -> list[str]:
    """Say which cubes a plan leaves where they are, and why."""
    skipped = () if plan is None else plan.task.get("skipped", ())
    return [f"{entry['cube']} stays in {entry['from']}: {entry['reason']}" for entry in skipped]


def plan_motion(task: Task, scene: Scene, q_from: Array, q_to: Array, speed: float) -> Plan | None:
    """Plan a motion between configurations (6,), rad, in a scene of the task's cell; see `plan_joint_motion`.

    Raises:
        ImpossibleError: there is no such motion, or an arm with its errors may come too near to something.
    """
    cell, options = task.cell, options_of(task, speed)
    inputs = plan_fingerprint(task), _named(task)
    plan = plan_joint_motion(scene, q_from, q_to, cell.unit, cell.limits, options, *inputs)
    if plan is not None:
        robot = cell.robot()
        jaws_unknown = scene.robot_open.digest == after_closing(robot).digest
        if jaws_unknown or scene.robot_open.digest == robot.digest:  # else a target is in the hand
            erring_clearances(cell, plan, jaws_unknown=jaws_unknown)
    return plan
