"""The whole of Task 2: what is planned, how clear and straight it is, judged by MuJoCo."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm.controller.unit import load_unit
from arm.errors import ImpossibleError
from arm.io.storage import data_file
from arm.plan_file import GripperStep, LookStep, Move, Plan
from arm.se3 import Array, angle_between, inverse, transform
from arms.mujoco_cell import MujocoCell
from plan.budget import allowed
from plan.options import PlanOptions
from plan.program.grammar import require_grammar
from plan.program.tasks import plan_task
from plan.scene import scene_from_json
from plan.trajectory.extremes import segment_extremes
from plan.trajectory.time_estimates import straight_time
from plan.verify import RequiredClearance, replay
from tasks.task2 import CUBE, Q_START, Task2, task2

UNIT = load_unit("crs93")

LIMITS = UNIT.limits()


def roles(plan: Plan) -> list[str]:
    return [
        step.role if isinstance(step, Move) else step.action if isinstance(step, GripperStep) else "look"
        for step in plan.steps
    ]


def test_every_cube_is_fetched_carried_and_looked_at(plan: Plan) -> None:
    once = [
        "transit",
        "approach",
        "close",
        "retract",
        "transit",
        "approach",
        "open",
        "retract",
        "home",
        "look",
    ]
    assert roles(plan) == ["open", *once * 4]
    cubes = plan.task["cubes"]
    assert {(c["cube"], c["from"]) for c in cubes} == {(f"cube {i}", f"01-02/{i}") for i in (1, 2, 3, 4)}
    assert {c["to"] for c in cubes} == {f"03-04/{i}" for i in (1, 2, 3, 4)}
    for number, cube in enumerate(cubes):
        holding = [step.held for step in plan.moves if step.cube == number]
        assert holding == [None, None, *[cube["cube"]] * 3, None, None]
    assert {step.jaw_opening for step in plan.moves if step.held} == {0.04}
    assert {step.jaw_opening for step in plan.moves if not step.held} == {0.06}


def test_limits_hold_on_what_is_sent(plan: Plan) -> None:
    allowed = LIMITS.scaled(plan.speed)
    for move in plan.moves:
        found = segment_extremes(move.path, UNIT)
        assert np.all(found.lower >= LIMITS.lower - 1e-9)
        assert np.all(found.upper <= LIMITS.upper + 1e-9)
        assert np.all(found.velocity <= allowed.velocity)
        assert np.all(found.acceleration <= allowed.acceleration)
    assert UNIT.limits(plan.speed_registers, plan.acceleration_registers).velocity == pytest.approx(
        LIMITS.velocity
    )


def test_clearances_are_those_asked_for_and_proved(plan: Plan, walled_plan: Plan) -> None:
    options = PlanOptions()
    for move in (*plan.moves, *walled_plan.moves):
        assert move.certified
        least = options.clearance if move.role in ("transit", "home") else options.line_clearance
        assert move.clearance >= least, move.name


@pytest.mark.slow
def test_what_the_plan_states_holds_when_it_is_replayed(
    case: Task2, plan: Plan, walled: Task2, walled_plan: Plan
) -> None:
    """Replaying builds its worlds from the file alone: nothing that stands around may have been left out."""
    for task, made in ((case, plan), (walled, walled_plan)):
        scene = scene_from_json(made.scene, task.scene.robot_open, task.scene.robot_holding)
        again = replay(made, scene, UNIT, LIMITS)
        assert [r.move.name for r in again] == [m.name for m in made.moves]
        assert all(r.check.proved for r in again)


def test_lines_follow_the_boards_normal(case: Task2, plan: Plan) -> None:
    """At every millisecond within 0.1 mm and 0.05 deg of the line along the station's normal, 100 mm long."""
    robot = case.scene.robot_open
    stations = {s.name: s for t in case.transfers for s in (t.pick, t.place)}
    for move in plan.moves:
        if move.role not in ("approach", "retract"):
            continue
        station = stations[move.name.rsplit(" ", 1)[1]]
        q = UNIT.positions(move.path.sample(1e-3))
        tools = [robot.T_base_tool(x) for x in q]
        if move.role == "approach":
            tools.reverse()
        # the yaw that was taken is the nearest of the four
        T = min(station.T_base_tool, key=lambda T: angle_between(T[:3, :3], tools[0][:3, :3]))
        away = np.array([(inverse(T) @ tool)[:3, 3] for tool in tools])
        assert np.abs(away[:, :2]).max() <= 1e-4
        assert max(angle_between(T[:3, :3], tool[:3, :3]) for tool in tools[::20]) <= np.radians(0.05)
        assert away[0, 2] == pytest.approx(0.0, abs=1e-4)
        assert away[-1, 2] == pytest.approx(-0.1, abs=1e-4)
        speed = np.linalg.norm(np.diff(away, axis=0), axis=1).max() / 1e-3
        assert speed <= PlanOptions().approach_speed * plan.speed * 1.05


def test_motion_is_near_the_bound_without_obstacles(plan: Plan, direct: Plan, walled_plan: Plan) -> None:
    """The straight joint moves between the ends that were chosen, at the planned fractions, from rest to rest.

    Moves that meet at speed may take less; no plan takes less than it says that no plan can.
    """
    options = PlanOptions()
    scaled = LIMITS.scaled(options.speed)
    planned = replace(
        scaled,
        velocity=scaled.velocity * options.velocity_fraction,
        acceleration=scaled.acceleration * options.acceleration_fraction,
    )
    bound = sum(
        float(straight_time(UNIT.positions(m.path.end) - UNIT.positions(m.path.start), planned))
        for m in plan.moves
    )
    assert plan.duration_s <= bound
    assert plan.duration_s <= 115.0  # 92 s with the full limits (docs/sources.md, "Boards and cubes")
    for made in (plan, direct, walled_plan):
        assert 0.8 * made.duration_s < made.task["no_plan_is_faster_than_s"] <= made.duration_s
    assert walled_plan.task["no_plan_is_faster_than_s"] == plan.task["no_plan_is_faster_than_s"]


def test_what_a_plan_takes_above_its_bound_is_explained(plan: Plan, direct: Plan, walled_plan: Plan) -> None:
    around = []
    for made in (plan, direct, walled_plan):
        bound, above = made.task["no_plan_is_faster_than_s"], made.task["above_that_s"]
        parts = [above[name] for name in ("order", "straight", "around", "sent")]
        assert bound + sum(parts) == pytest.approx(made.duration_s, abs=4e-3)
        assert min(parts[:2]) >= 0.0
        assert abs(above["sent"]) < 0.02 * made.duration_s
        assert 0.0 <= above["unexplored"] <= 0.03 * made.duration_s
        around.append(above["around"])
    assert plan.task["no_plan_is_faster_than_s"] > 0.95 * plan.duration_s
    assert around[2] > around[0] + 0.1


def test_a_plan_avoids_a_wall(plan: Plan, walled_plan: Plan) -> None:
    assert walled_plan.duration_s < 1.1 * plan.duration_s
    assert walled_plan.to_json() != plan.to_json()


def states(case: Task2, plan: Plan, step_s: float) -> Iterator[tuple[Array, float, dict[str, Array], Move]]:
    """Joint positions, jaw opening and where all cubes are, along the whole plan."""
    robot = case.scene.robot_open
    cubes = {c.name: c.T_base_body for c in case.scene.cubes}
    held: str | None = None
    T_tool_held = transform()
    for step in plan.steps:
        if isinstance(step, GripperStep) and step.action == "close":
            tool = robot.T_base_tool(q)  # noqa: F821 - the last state of the move before
            held = min(cubes, key=lambda name: float(np.linalg.norm(cubes[name][:3, 3] - tool[:3, 3])))
            T_tool_held = inverse(tool) @ cubes[held]
        elif isinstance(step, GripperStep):
            held = None
        elif isinstance(step, Move):
            for q in UNIT.positions(step.path.sample(step_s)):
                if held is not None:
                    cubes[held] = robot.T_base_tool(q) @ T_tool_held
                yield q, step.jaw_opening, cubes, step


def penetrations(case: Task2, plan: Plan, step_s: float = 0.01) -> set[tuple[str, frozenset[str]]]:
    """Names of moves, and pairs that overlap on them, by MuJoCo; a cube may touch its plate on a line."""
    scene = case.scene
    judge = MujocoCell(
        data_file("urdf/a465/a465.urdf"),
        scene.bodies,
        [(c.name, CUBE) for c in scene.cubes],
        scene.robot_open.disabled_collisions,
    )
    found = set()
    for q, opening, cubes, move in states(case, plan, step_s):
        judge.place(q, opening, cubes)
        for pair, _depth in judge.penetrations():
            kinds = {name.split()[0] for name in pair}
            in_pocket = kinds == {"cube", "plate"} and (
                move.held not in pair or move.role in ("approach", "retract")
            )
            in_jaws = move.held in pair and any(name.startswith("finger") for name in pair)
            if not in_pocket and not in_jaws and pair != {"base", "table"}:
                found.add((move.name, pair))
    return found


@pytest.mark.slow
def test_mujoco_finds_no_penetration(case: Task2, plan: Plan, walled: Task2, walled_plan: Plan) -> None:
    assert penetrations(case, plan) == set()
    assert penetrations(walled, walled_plan) == set()


@pytest.mark.slow
def test_mujoco_would_find_one(walled: Task2, plan: Plan) -> None:
    """The plan that knows nothing of the wall runs into it."""
    found = penetrations(walled, plan)
    assert found
    assert all("wall" in pair for _, pair in found)


def test_the_same_request_gives_the_same_bytes_with_little_effort(case: Task2, plan: Plan) -> None:
    with allowed(None) as meter:
        again = plan_task(task2().scene, case.transfers, Q_START, UNIT, provenance={"note": "test"})
    assert again.to_json() == plan.to_json()
    assert meter.effort_s <= 1.0


@pytest.mark.slow
def test_every_processor_gives_the_same_bytes(plan: Plan) -> None:
    """BLAS made to compute as on older and newer processors: last bits differ, the file does not."""
    program = (
        "from tasks.task2 import *; from plan.program.tasks import plan_task; "
        "from arm.controller.unit import load_unit; c = task2();"
        "p = plan_task(c.scene, c.transfers, Q_START, load_unit('crs93'), provenance={'note': 'test'});"
        "print(p.sha256)"
    )
    path = os.pathsep.join([*sys.path, str(Path(__file__).parents[2] / "support")])
    for core, threads in (("Nehalem", "1"), ("Haswell", "2")):
        counts = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), threads)
        environment = {**os.environ, "OPENBLAS_CORETYPE": core, "PYTHONPATH": path, **counts}
        run = [sys.executable, "-c", program]
        done = subprocess.run(run, env=environment, capture_output=True, text=True, check=True, timeout=120)
        assert done.stdout.strip() == plan.sha256, core


def test_a_second_look_divides_the_approach_and_nothing_else() -> None:
    """The arm rests on the approach; each part is certified, and the rest of the plan is the same."""
    case, before = task2(), 0.017
    plain = plan_task(case.scene, case.transfers[:1], Q_START, UNIT)
    looking = plan_task(case.scene, [replace(case.transfers[0], look_before=before)], Q_START, UNIT)
    at = next(i for i, s in enumerate(looking.steps) if isinstance(s, LookStep))
    upto, look, last = looking.steps[at - 1 : at + 2]
    assert isinstance(upto, Move)
    assert isinstance(look, LookStep)
    assert isinstance(last, Move)
    assert (look.cube, upto.role, last.role) == (0, "approach", "approach")
    assert looking.steps[:4] == plain.steps[:4]  # until the jaws have closed: then the motion ends elsewhere
    assert looking.steps[at + 2 :] == plain.steps[at:]
    for velocity in (upto.path.segments[-1].derivative(1.0), last.path.segments[0].derivative(0.0)):
        assert np.abs(velocity).max() == 0.0
    tool = case.scene.robot_open.T_base_tool
    there, end = (tool(UNIT.positions(counts)) for counts in (last.path.start, last.path.end))
    assert (inverse(end) @ there)[2, 3] == pytest.approx(-before, abs=1e-4)
    scene = scene_from_json(looking.scene, case.scene.robot_open, case.scene.robot_holding)
    asked = RequiredClearance(0.010, 0.005, 0.100)
    assert len(replay(looking, scene, UNIT, LIMITS, asked)) == len(list(looking.moves))
    require_grammar(looking)
    short = replace(looking, steps=tuple(s for s in looking.steps if s is not look))
    with pytest.raises(ImpossibleError, match=r"is not a line of 100 mm"):
        replay(short, scene, UNIT, LIMITS, asked)
