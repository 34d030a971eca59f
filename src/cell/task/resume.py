"""Resume after a stop, from where the arm is and with what the jaws and boards hold now.

The stopped plan is never executed again. It only states the transfers, and the planned positions of boards and cubes.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from arm.errors import ExecutionStopped, ImpossibleError
from arm.numerics.products import mul, norm
from arm.plan_file import GripperStep, Move, Plan
from arm.se3 import Array, frozen, inverse
from cell.accuracy.clearances import erring_clearances
from cell.accuracy.plan_budgets import require_placements
from cell.cubes.confirm_placed import NOT_CONFIRMED, seated
from cell.cubes.locate import WITHIN
from cell.cubes.recovery import Recovery
from cell.cubes.stopped import NEAR_PATH, displaced_in, released_at, released_before
from cell.files.task import Task
from cell.scene.build import (
    RELEASE_GAP,
    T_base_cube_on_table,
    cube_name,
    hole_station,
    table_station,
)
from cell.scene.displaced import BESIDE, DisplacedCube, support_of
from cell.scene.fingerprint import plan_fingerprint
from cell.scene.options import options_of
from cell.session.grasp_monitor import grip_fault
from cell.task.plan_matches import planned_observation
from cell.task.run import TaskRun
from plan.program.recovery import CarryPlanner, InJaws, plan_retreat
from plan.program.setting import Setting
from plan.scene import Station, scene_from_json
from vision.observation import Observation

STANDS = 3e-3  # m; jaws this close to fully open or shut count as open or shut


def resume(run: TaskRun, plan: Plan) -> None:
    """Finish a stopped plan.

    Raises:
        ImpossibleError: the unit lost its positions, or there is no certified motion from where the arm is; nothing
            moved.
        ExecutionStopped: motion stopped again, or the position of a cube is unknown.
    """
    mars, task, cell = run.connection.mars, run.task, run.task.cell
    mars.initialise(home=False)
    run.homed = True
    mars.set_registers(cell.speed_registers, cell.acceleration_registers)
    counts, closed = mars.settled_counts(), mars.jaws()
    degrees = ", ".join(f"{d:.1f}" for d in np.degrees(cell.unit.positions(counts)))
    run.console.step(f"the arm stands at [{degrees}] deg, the jaws are {abs(round(100 * closed))} % closed")
    observed = run.see("from where the arm stands", arm_in_view=True)
    width = cell.gripper.width(closed)
    why_not = grip_fault(cell, width)
    planned = _planned(task, plan)
    displaced = displaced_in(cell, plan, planned)
    if why_not:
        gone = released_before(plan, cell.unit.positions(counts), cell.unit)
        displaced = tuple(cube for cube in displaced if cube.name not in gone)
    observation = _known(observed, task, plan, displaced)
    run.recovery.assume(displaced, planned)
    run.recovery.locate_again(observation)  # in no image: they moved with their boards
    if not why_not:
        transfer, jaws = carried_by(task, plan, counts, observed)
        run.console.step(f"{transfer['cube']} is in the jaws; its target is {transfer['to']}")
        _set_down(run, plan, (observation, observed), transfer, jaws, closed)
    else:
        if cell.gripper.shut + STANDS < width < cell.gripper.opening - STANDS:
            run.tell(f"no cube is in the jaws: {why_not}; they open where the arm stands")
        run.on_table = _on_table(task, plan)
        if mars.gripper(0.0).stalled:
            raise ExecutionStopped("the jaws do not open: something blocks them; the arm has not moved")
        _leave(run, observation)
    observation = run.look("from q_start")
    observation = run.confirm_placed(observation)
    _take_stock(run, plan, observation)
    run.carry_out(observation)


def _planned(task: Task, plan: Plan) -> Observation:
    """Boards as planned, with a cube wherever one may be."""
    cell = task.cell
    scene = scene_from_json(plan.scene, cell.robot(), cell.robot_holding())
    return planned_observation(cell, scene, (transfer["to"] for transfer in plan.task["cubes"]))


def _known(
    observation: Observation, task: Task, plan: Plan, displaced: Collection[DisplacedCube] = ()
) -> Observation:
    """Boards as observed, or as planned if the arm hides them, with a cube wherever one may be in a hole."""
    planned = _planned(task, plan).with_states({Recovery.home(cube.name): "empty" for cube in displaced})
    boards = [
        b if (now := observation.board(b.name)) is None else replace(b, pose=now.pose) for b in planned.boards
    ]
    return Observation((*boards, *(b for b in observation.boards if planned.board(b.name) is None)))


def _on_table(task: Task, plan: Plan, free: Collection[str] = ()) -> dict[str, Array]:
    """Cubes that may be on the table: those of the plan's scene, and one at each of its targets but those in `free`."""
    if task.places is None:
        return {}
    had = [c["name"].removeprefix(cube_name("")) for c in plan.scene["cubes"]]
    places = [*had, *(t["to"] for t in plan.task["cubes"])]
    return {
        cube_name(place): T_base_cube_on_table(task, place)
        for place in places
        if place.startswith("table/") and place not in free
    }


def carried_by(
    task: Task, plan: Plan, counts: tuple[int, ...], observation: Observation
) -> tuple[dict[str, str], InJaws]:
    """Identify the cube in the jaws by the arm's position on the plan, or else by the hole that is empty.

    Args:
        task, plan: the task and its stopped plan.
        counts: of the arm.
        observation: from there; boards that the arm hides are missing.

    Returns:
        The cube's entry in the plan (cube, from, to), and how it is held.

    Raises:
        ImpossibleError: neither identifies it.
    """
    cell = task.cell
    q = cell.unit.positions(counts)
    transfer = _carried_near(task, plan, q) or _missing(observation, plan)
    if transfer is None:
        raise ImpossibleError(
            "a cube is in the jaws, but it cannot be identified: the arm is not on a move that carries one, and the "
            "number of missing cubes is not one; take it out of the jaws by hand, put it back into its hole, and "
            "resume again"
        )
    robot = cell.robot()
    cube = scene_from_json(plan.scene, robot, cell.robot_holding()).cube(transfer["cube"])
    index = plan.task["cubes"].index(transfer)
    T_tool_cube = mul(inverse(robot.T_base_tool(_gripped_at(task, plan, index))), cube.T_base_body)
    return transfer, InJaws(transfer["cube"], frozen(T_tool_cube))


def _gripped_at(task: Task, plan: Plan, index: int) -> Array:
    """Joint positions (6,) rad at which the plan's jaws close on a cube, by its number."""
    lift = next(m for m in plan.moves if m.held is not None and m.cube == index)
    return task.cell.unit.positions(lift.path.start)


def _carried_near(task: Task, plan: Plan, q: Array) -> dict[str, str] | None:
    """The transfer whose carrying move passes closest to the arm's configuration; None if none is near."""
    unit = task.cell.unit
    best: tuple[float, dict[str, str] | None] = (NEAR_PATH, None)
    for move in plan.moves:
        if move.held is not None and move.cube is not None:
            off = float(np.abs(unit.positions(move.path.sample(0.02)) - q).max(axis=1).min())
            if off <= best[0]:
                best = off, plan.task["cubes"][move.cube]
    return best[1]


def _missing(observation: Observation, plan: Plan) -> dict[str, str] | None:
    """The only transfer whose cube is certainly at neither of its places; None if there is not exactly one."""
    gone = [
        transfer
        for transfer in plan.task["cubes"]
        if observation.state(transfer["from"]) == "empty"
        and observation.state(transfer["to"]) in (None, "empty")
    ]
    return gone[0] if len(gone) == 1 else None


def _touched(
    task: Task, observation: Observation, transfer: dict[str, str], T_base_tool: Array
) -> frozenset[str]:
    """What the held cube may touch: the board or table of each place of the transfer that the tool is near."""
    near = []
    for place in (transfer["from"], transfer["to"]):
        reach_m = 1.2 * options_of(task, 1.0).offset + (WITHIN if place.startswith(BESIDE) else 0.0)
        T = _station(task, observation, place.removeprefix(BESIDE)).T_base_tool[0]
        if norm(T_base_tool[:3, 3] - T[:3, 3]) < reach_m:
            near.append(support_of(place))
    return frozenset(near)


def _station(task: Task, observation: Observation, place: str) -> Station:
    """The station of a place, at its present pose."""
    board, _, number = place.rpartition("/")
    if board == "table" and task.places is not None:
        return table_station(task, place)
    found = observation.board(board)
    if found is None:
        raise ImpossibleError(f"board {board} was not seen, so its holes are not known", board=board)
    return hole_station(task.cell, found.pose.holes[int(number) - 1], RELEASE_GAP)


def _set_down(
    run: TaskRun,
    plan: Plan,
    looks: tuple[Observation, Observation],
    transfer: dict[str, str],
    jaws: InJaws,
    closed: float,
) -> None:
    """Bring the cube in the jaws to its target; `looks`: with the boards as far as known, and as they are seen now.

    Raises:
        ImpossibleError: there is no certified way, or the cube is too likely to miss its pocket; it stays in the jaws.
    """
    task, cell, (observation, observed) = run.task, run.task.cell, looks
    run.on_table = _on_table(task, plan, (transfer["to"],))
    others = [t for t in plan.task["cubes"] if t != transfer]
    q, number = run.q_now(), plan.task["cubes"].index(transfer)
    scene = run.rest(observation.with_states({transfer["to"]: "empty"}), q).scene
    run.recovery.stuck.pop(transfer["cube"], None)
    touches = _touched(task, observation, transfer, scene.robot_open.T_base_tool(q))
    jaws, station = replace(jaws, touches=touches), _station(task, observation, transfer["to"])
    if transfer["from"].startswith(BESIDE):
        station = replace(
            station, T_base_tool=(released_at(task, plan, number, _planned(task, plan), observation),)
        )
    setting = Setting(scene, cell.unit, cell.limits, options_of(task, run.speed))
    stated = {"name": task.name, "kind": task.kind, "cubes": [transfer, *others]}
    made = CarryPlanner(setting, q, jaws, cell.q_start, plan_fingerprint(task), stated).to_place(station)
    erring_clearances(cell, made, observed, jaws.cube)
    q_grip = _gripped_at(task, plan, number)
    budgets = require_placements(cell, observed, made, gripped={0: q_grip})
    run.budgets |= {budget.cube: budget for budget in budgets}
    run.keep(made, "set-down")
    release = 1 + next(i for i, s in enumerate(made.steps) if isinstance(s, GripperStep))
    row = run.add_row(transfer)
    run.carry(made.steps[:release], transfer, closed, row, observation)
    row.add_motion(made.steps)
    run.execute(made.steps[release:])


def _back_out(run: TaskRun, observation: Observation, blocked: ImpossibleError) -> tuple[Move, ...]:
    """Plan a retract along the tool with open jaws, from where the arm was stopped.

    If the whole length is not clear, shorter ones are tried: the arm may have been near the end of its approach line.

    Raises:
        ImpossibleError: there is none; names its obstacle and that of `blocked`, the motion to q_start.
    """
    cell, q, options = run.task.cell, run.q_now(), options_of(run.task, run.speed)
    scene = run.rest(observation, q).scene
    refused: ImpossibleError | None = None
    for share in (1.0, 0.6, 0.3):
        try:
            shorter = replace(options, offset=share * options.offset)
            return plan_retreat(scene, q, cell.unit, cell.limits, shorter)
        except ImpossibleError as error:
            refused = refused or error
    raise ImpossibleError(
        f"no certified motion from where the arm stands: {blocked}; and backing out along the jaws: {refused}; "
        "move the arm clear by hand, then home it with a465 run",
        blocked=str(blocked),
        back_out=str(refused),
    )


def _leave(run: TaskRun, observation: Observation) -> None:
    """Go to q_start with empty jaws, backing out first if the arm is on an approach or retract."""
    try:
        run.go_to_start(observation)
    except ImpossibleError as blocked:
        run.console.step("the arm is close to an obstacle: it backs out along the jaws first")
        run.execute(_back_out(run, observation, blocked))
        run.go_to_start(observation)


def _take_stock(run: TaskRun, plan: Plan, observation: Observation) -> None:
    """Mark the cubes that the look shows at their targets as done, and locate those that were to be taken from beside.

    A cube that is not certainly seated is left where it is, and the run ends as not confirmed.

    Raises:
        ExecutionStopped: a cube is certainly neither at its source nor at its target.
    """
    task = run.task
    run.on_table = _on_table(task, plan, [transfer["to"] for transfer in plan.task["cubes"]])
    unsure = 0
    for transfer in plan.task["cubes"]:
        cube, beside = transfer["cube"], transfer["from"].startswith(BESIDE)
        if not beside and observation.state(transfer["from"]) != "empty":
            continue
        state = observation.state(transfer["to"])
        seat = seated(task, observation, transfer["to"], run.widths.get(cube))
        if cube in run.recovery.stuck and (state not in (None, "cube") or seat.state != "seated"):
            if why_not := run.recovery.find(cube, transfer["to"], observation):
                run.tell(
                    f"{cube} stays {transfer['from']}, where the plan has it; in this look not: {why_not}"
                )
            continue
        run.recovery.stuck.pop(cube, None)
        if transfer["to"].startswith("table/"):
            run.on_table[cube_name(transfer["to"])] = T_base_cube_on_table(task, transfer["to"])
        if cube in run.done:
            continue  # released in this run, so the look has judged it
        if state not in (None, "cube") or (state == "cube" and seat.state == "off"):
            why = seat.reason if state == "cube" else f"that hole looks {state}"
            raise ExecutionStopped(
                f"the cube of {transfer['from']} is not confirmed in {transfer['to']}: {why}; correct or remove it, "
                "and run again; the arm is at q_start",
                cube=cube,
            )
        run.done[cube] = transfer["to"]  # so that no other cube is placed there
        if seat.state != "seated":
            unsure += 1
            row = run.add_row(transfer)
            row.remarks.append(f"{NOT_CONFIRMED}: it is not certainly seated: {seat.reason}")
            run.tell(f"{row.source} to {row.target} {row.remarks[-1]}")
    run.console.step(f"{len(run.done) - unsure} of {len(plan.task['cubes'])} cubes are where they should be")
