"""Motions of a found sequence, with what is held and what may touch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.errors import ImpossibleError
from arm.plan_file import Move, Step
from arm.robot.model import Robot
from arm.robot.shapes import Body, Box
from arm.se3 import inverse, transform
from plan.collision.world import Distance, World, distance_of
from plan.motion.builder import MotionBuilder
from plan.motion.phase import Join, MotionPhase
from plan.program.goals.line_chains import SequenceStep
from plan.program.goals.target import Target
from plan.program.planned import Pause
from plan.program.pose_lists import plan_poses
from plan.program.writer import ClearanceLost, MotionWriter, _Motion
from plans.waypoints import FEW, Q_START, planned
from tasks.pose_lists import FAST, TABLE, down


@pytest.mark.parametrize("counts", [True, False])
def test_the_first_pose_may_be_where_the_arm_stands(robot: Robot, crs97: Unit, counts: bool) -> None:
    q = crs97.positions(crs97.counts(Q_START)) if counts else Q_START
    here, there = robot.T_base_tool(q), down(0.45, 0.2, 0.2)
    first = Target("here", here, dwell_s=0.3)
    for unit in (crs97, None):
        plan = plan_poses(
            robot, [TABLE], [first, Target("there", there), Target("again", there)], q, crs97.limits(),
            unit=unit, options=FAST, effort=FEW,
        )  # fmt: skip
        assert [r.target for r in plan.reached] == ["here", "there", "again"]
        np.testing.assert_allclose(plan.reached[0].q, q, atol=3e-5)
        pauses = [i for i, step in enumerate(plan.steps) if isinstance(step, Pause)]
        assert pauses == [0]  # nothing moves before it
        assert all(sum(s.duration_ms for s in move.path.segments) > 0 for move in plan.moves)
    alone = plan_poses(robot, [TABLE], [first], q, crs97.limits(), unit=crs97, options=FAST, effort=FEW)
    assert not alone.moves
    assert [r.target for r in alone.reached] == ["here"]


def test_lines_are_certified_with_the_clearance_of_their_target(robot: Robot, crs97: Unit) -> None:
    """The fingers come to 3 mm above the table; 5 mm is what other lines keep."""
    above = down(0.45, 0.1, -0.04)
    lowest = min(distance.value for distance in hand_above_table(robot, above))
    over = down(0.45, 0.1, -0.04 + 0.003 - lowest)
    target = Target("low", over, approach=0.05, retract=0.05, line_clearance=0.002)
    plan = planned(robot, crs97, [TABLE], target, options=replace(FAST, certificate="decide"))
    lines = [move for move in plan.moves if move.role in ("approach", "retract")]
    assert len(lines) == 2
    assert all(0.002 <= move.clearance <= 0.0031 for move in lines)
    with pytest.raises(ImpossibleError, match="too near"):
        planned(robot, crs97, [TABLE], replace(target, line_clearance=None))


def test_each_phase_has_its_world_and_its_clearance(
    robot: Robot, crs97: Unit, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A box is fetched, carried and set down; only lines may touch, and what is held moves with the hand."""
    phases: list[MotionPhase] = []
    run = MotionBuilder.run

    def recorded(builder: MotionBuilder, some: Sequence[MotionPhase], joins: Sequence[Join]) -> list[Move]:
        phases.extend(some)
        return run(builder, some, joins)

    monkeypatch.setattr(MotionBuilder, "run", recorded)
    box = Body("box", Box((0.03, 0.03, 0.03)), transform(t=(0.4, 0.15, 0.06)), "cube")
    touching = {("finger_l", "box"), ("finger_r", "box"), ("palm", "box"), ("table", "box")}
    lines = {"approach": 0.05, "retract": 0.05, "allowed_collisions": touching}
    targets = [
        Target("pick", down(0.4, 0.15, 0.06), attach="box", **lines),
        Target("put", down(0.4, -0.15, 0.06), detach=True, line_clearance=0.003, dwell_s=0.5, **lines),
        Target("away", down(0.4, 0.1, 0.3), free="rz"),
    ]
    options = replace(FAST, clearance=0.012, line_clearance=0.004)
    plan = planned(robot, crs97, [TABLE, box], *targets, options=options)
    held = [None, None, "box", "box", "box", None, None]
    roles = ["transit", "approach", "retract", "transit", "approach", "retract", "transit"]
    clearances = [0.012, 0.004, 0.004, 0.012, 0.003, 0.003, 0.012]
    assert [(p.role, p.held, p.clearance) for p in phases] == list(zip(roles, held, clearances, strict=True))
    brought = plan.state.moved[0][1][:3, 3]
    for phase, carried, after in zip(phases, held, [False] * 5 + [True] * 2, strict=True):
        pairs = range(len(phase.world.pairs))
        checked = {frozenset(phase.world.pair_names(i)) for i in pairs}
        on_line = phase.role != "transit"
        assert (frozenset(("finger_l", "box")) in checked) == (not on_line and carried is None)
        assert (frozenset(("table", "box")) in checked) == (not on_line and carried is not None)
        assert phase.world.joint_of("box") == (robot.end_joint if carried else 0)
        touched = {"finger_l", "finger_r", "palm", "table"} if on_line and carried else set()
        assert phase.allowed_collisions == touched
        if carried is None:
            place = brought if after else box.T_base_body[:3, 3]
            part = next(part for part in phase.world._parts if part.name == "box")
            np.testing.assert_allclose(part.T_joint_body[:3, 3], place, atol=1e-9)
    assert [(p.name, p.attached, p.detached) for p in plan.steps if isinstance(p, Pause)] == [
        ("pick", "box", None),
        ("put", None, "box"),
    ]


def test_a_sequence_that_is_written_again_begins_where_the_program_does(
    robot: Robot, crs97: Unit, monkeypatch: pytest.MonkeyPatch
) -> None:
    box = Body("box", Box((0.03, 0.03, 0.03)), transform(t=(0.4, 0.15, 0.06)), "cube")
    touching = [("box", name) for name in ("finger_l", "finger_r", "palm")]
    pick = Target("pick", down(0.4, 0.15, 0.06), approach=0.05, retract=0.05, attach="box",
                  allowed_collisions=touching)  # fmt: skip
    steps = MotionWriter.steps

    def twice(writer: MotionWriter, sequence: Sequence[SequenceStep]) -> list[Step]:
        first, again = steps(writer, sequence), steps(writer, sequence)
        assert first == again
        assert writer.state.held == "box"
        return again

    monkeypatch.setattr(MotionWriter, "steps", twice)
    wait = Target("wait", down(0.4, 0.1, 0.3), free="rz", dwell_s=0.2)
    plan = planned(robot, crs97, [TABLE, box], pick, wait)
    assert plan.state.held == "box"
    pauses = [(p.name, p.attached, p.detached) for p in plan.steps if isinstance(p, Pause)]
    assert pauses == [("pick", "box", None), ("wait", None, None)]


@pytest.mark.parametrize("step", [0, 1, 2])
def test_a_lost_clearance_is_that_of_its_step(robot: Robot, crs97: Unit, step: int) -> None:
    """Of several steps in one motion."""
    phases = [
        MotionPhase(f"phase {i}", "transit", World(robot, []), 0.01, np.stack([Q_START] * 2))
        for i in range(3)
    ]
    motion = _Motion()
    for number, phase in enumerate(phases):
        motion.add(number, phase, [])

    class Losing:
        def run(self, some: Sequence[MotionPhase], joins: Sequence[Join]) -> list[Move]:
            raise ImpossibleError("lost", step=some[step].name)

    with pytest.raises(ClearanceLost) as lost:
        motion.written(Losing())  # type: ignore[arg-type]
    assert lost.value.step == step


def hand_above_table(robot: Robot, T_base_tool: np.ndarray) -> list[Distance]:
    """Distances of the hand's bodies from the table with the tool at a pose."""
    T_base_joint = T_base_tool @ inverse(robot.T_joint_end @ robot.T_end_tool)
    hand = [body for body in robot.bodies if body.joint == robot.end_joint]
    placed = [Body(body.name, body.shape, T_base_joint @ body.T_joint_body, "robot") for body in hand]
    return [distance_of(body, TABLE) for body in placed]
