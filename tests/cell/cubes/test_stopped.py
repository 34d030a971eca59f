"""What a stopped plan tells of displaced cubes."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice
from unittest.mock import patch

import numpy as np
import pytest

import cell.task.planning
from arm.io.storage import data_file
from arm.numerics.products import mul
from arm.plan_file import Plan
from arm.se3 import frozen, inverse, rot_z, transform
from cell.cubes.grips import recovery_grips
from cell.cubes.stopped import displaced_in, released_at, released_before
from cell.files.task import read_task
from cell.scene.displaced import DisplacedCube
from cell.sim.release_faults import T_hole_released
from cell.task.planning import Rest, free_goals, plan_recovery, plan_rest
from cell.task.resume import carried_by
from tasks.true_look import true_look
from vision.observation import Observation

TASK = read_task(data_file("scenes/task2.toml"))
CELL = TASK.cell
SEEN = true_look(TASK).with_states({"01-02/4": "empty", "01-02/1": "empty"})


def _displaced(name: str, near: str, fault: str) -> DisplacedCube:
    board = SEEN.board(near.split("/")[0])
    assert board is not None
    T_base_hole = board.pose.holes[int(near[-1]) - 1].T_base_hole
    return DisplacedCube(name, near, frozen(mul(T_base_hole, T_hole_released(fault, CELL.cube_size))))


LEANS = _displaced("cube 01-02/4", "01-02/4", "half")
STAYS = _displaced("cube 01-02/1", "03-04/3", "aside")


@pytest.fixture(scope="module")
def leaning() -> Plan:
    """A plan that takes a leaning cube by jaws that lean less than it does, so that it leans in them."""
    rest = Rest(TASK, SEEN, CELL.q_start, 0.5, displaced=(LEANS, STAYS))
    with patch.object(
        cell.task.planning, "recovery_grips", lambda *given: islice(recovery_grips(*given), 1, None)
    ):
        return plan_recovery(rest, LEANS, free_goals(rest))


def test_its_displaced_cubes_are_where_it_has_them(leaning: Plan) -> None:
    found = displaced_in(CELL, leaning, SEEN)
    assert {(cube.name, cube.near) for cube in found} == {(c.name, c.near) for c in (LEANS, STAYS)}
    for cube in found:
        known = LEANS if cube.name == LEANS.name else STAYS
        assert cube.T_base_cube == pytest.approx(known.T_base_cube, abs=1e-9)


def test_a_plan_of_seated_cubes_has_none() -> None:
    plan = plan_rest(Rest(TASK, SEEN, CELL.q_start, 0.5))
    assert plan is not None
    assert displaced_in(CELL, plan, SEEN) == ()


def test_a_cube_is_released_before_the_moves_that_leave_its_target(leaning: Plan) -> None:
    """On the way to it, and far from the plan, it is where it was."""
    fetch, *_, leave = (move for move in leaning.moves if move.held is None)
    for move, gone in ((fetch, frozenset()), (leave, frozenset({LEANS.name}))):
        for counts in move.path.knots()[1:-1]:
            assert released_before(leaning, CELL.unit.positions(counts), CELL.unit) == gone
    far = CELL.unit.positions(leave.path.start) + np.radians(5.0)
    assert released_before(leaning, far, CELL.unit) == frozenset()


@pytest.mark.parametrize("pushed", [False, True])
def test_a_cube_that_leans_in_the_jaws_is_released_upright_wherever_its_target_is(
    leaning: Plan, pushed: bool
) -> None:
    push = transform(rot_z(0.03), (0.004, -0.002, 0.0)) if pushed else transform()
    boards = [
        replace(b, pose=replace(b.pose, T_base_board=frozen(push @ b.pose.T_base_board))) for b in SEEN.boards
    ]
    now = Observation(tuple(boards))
    lift = next(move for move in leaning.moves if move.held is not None)
    transfer, jaws = carried_by(TASK, leaning, lift.path.end, now)
    T_base_cube = released_at(TASK, leaning, 0, SEEN, now) @ jaws.T_tool_cube
    board = now.board("03-04")
    assert board is not None
    T_base_hole = board.pose.holes[int(transfer["to"][-1]) - 1].T_base_hole
    T = inverse(T_base_hole) @ T_base_cube
    assert np.degrees(np.arccos(np.clip(T[2, 2], -1.0, 1.0))) < 0.05  # rounded to counts
    assert np.hypot(*T[:2, 3]) < 0.1e-3
    tool = -(jaws.T_tool_cube[2, :3] @ (0.0, 0.0, 1.0))
    assert np.degrees(np.arccos(tool)) > 3.0  # it does lean in the jaws
