"""What a second look says: where the target is, and whether the cube enters as planned or where the pocket is now."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.io.storage import data_file
from arm.numerics.products import mul
from arm.plan_file import Plan
from arm.poses import BoardPose
from arm.se3 import Array, frozen, inverse, rotation, rotation_vector, transform
from cell.accuracy.plan_budgets import plan_budgets
from cell.files.task import Task, read_task
from cell.task.planning import Rest, plan_rest
from cell.task.second_look.judge import Judgement, judge, mean_pose, second_look_helps
from tasks.true_look import true_look
from vision.observation import Observation

NOISE = np.diag([1e-4, 1e-4, 2e-4, 1e-3, 1e-3, 5e-4]) ** 2  # m and rad, drawn anew in every look
LASTING = np.diag([5e-5] * 3 + [3e-4] * 3) ** 2  # of the print: the same in every look


@pytest.fixture(scope="module")
def task() -> Task:
    return read_task(data_file("scenes/realistic/task2.toml"))


def _noisy(seen: Observation, noise: Array = NOISE) -> Observation:
    boards = tuple(
        replace(b, pose=replace(b.pose, covariance=frozen(noise + LASTING), repeatability=frozen(noise)))
        for b in seen.boards
    )
    return replace(seen, boards=boards)


@pytest.fixture(scope="module")
def seen(task: Task) -> Observation:
    return _noisy(true_look(task))


@pytest.fixture(scope="module")
def plan(task: Task, seen: Observation) -> Plan:
    made = plan_rest(Rest(task, seen, task.cell.q_start, 0.5))
    assert made is not None
    return made


def _pose(seen: Observation) -> BoardPose:
    return next(pose for pose in seen.poses if pose.board.name == "03-04")


def _slid(pose: BoardPose, by: Array, turn_deg: float = 0.0) -> BoardPose:
    """The pose after a motion in its own frame, m."""
    motion = transform(rotation((0.0, 0.0, np.radians(turn_deg))), by)
    return replace(pose, T_base_board=frozen(mul(pose.T_base_board, motion)))


def _judged(task: Task, seen: Observation, plan: Plan, after: BoardPose) -> Judgement:
    return judge(task.cell, plan, 0, seen, after, _pose(seen))


def test_looks_at_a_board_at_rest_rarely_count_as_a_motion(task: Task, seen: Observation, plan: Plan) -> None:
    rng = np.random.default_rng(1)
    root, moved = np.linalg.cholesky(NOISE), 0
    for _ in range(150):
        twists = root @ rng.standard_normal((6, 2))
        first, second = (
            replace(_pose(seen), T_base_board=frozen(
                _pose(seen).T_base_board @ transform(rotation(t[3:]), t[:3]))) for t in twists.T
        )  # fmt: skip
        found = judge(task.cell, plan, 0, seen, second, first)
        moved += found.moved
        assert found.enters
    assert moved <= 2  # 0.15 expected


def test_the_mean_of_two_looks_errs_as_it_says() -> None:
    task = read_task(data_file("scenes/realistic/task2.toml"))
    true, rng = _pose(_noisy(true_look(task))), np.random.default_rng(2)
    other = replace(true, covariance=frozen(4 * NOISE + LASTING), repeatability=frozen(4 * NOISE))
    errors = []
    for _ in range(2000):
        poses = []
        for pose in (true, other):
            twist = np.linalg.cholesky(pose.repeatability) @ rng.standard_normal(6)
            T = pose.T_base_board @ transform(rotation(twist[3:]), twist[:3])
            poses.append(replace(pose, T_base_board=frozen(T)))
        T = inverse(true.T_base_board) @ mean_pose(*poses).T_base_board
        errors.append([*T[:3, 3], *rotation_vector(T[:3, :3])])
    mean = mean_pose(true, other)
    assert mean.repeatability == pytest.approx(0.8 * NOISE, abs=1e-18)
    assert mean.covariance == pytest.approx(0.8 * NOISE + LASTING, abs=1e-18)
    assert np.std(errors, axis=0) == pytest.approx(np.sqrt(0.8 * np.diag(NOISE)), rel=0.05)


@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.6, 0.8, 0.0)])
def test_a_board_that_slid_is_told_and_worth_a_correction_within_10_mm(
    task: Task, seen: Observation, plan: Plan, direction: tuple[float, float, float]
) -> None:
    by = np.array(direction)
    for slid, enters, worth in (
        (0.3e-3, True, True),
        (2.5e-3, False, True),
        (4e-3, False, True),
        (12e-3, False, False),
    ):
        found = _judged(task, seen, plan, _slid(_pose(seen), slid * by))
        assert (found.enters, found.worth) == (enters, worth), slid
        assert found.shift.farthest == pytest.approx(slid, rel=0.6 if enters else 1e-3)
        if not enters:
            assert found.moved
            assert found.pose.T_base_board == pytest.approx(_slid(_pose(seen), slid * by).T_base_board)
            assert f"has moved by {1e3 * slid:.1f} mm" in found.words()


def test_a_pocket_that_is_higher_or_lower_is_not_entered_as_planned(
    task: Task, seen: Observation, plan: Plan
) -> None:
    for up, enters in ((1.5e-3, True), (-1.5e-3, True), (3e-3, False), (-3e-3, False)):
        assert _judged(task, seen, plan, _slid(_pose(seen), np.array((0.0, 0.0, up)))).enters == enters


def test_a_rotation_counts_at_the_hole(task: Task, seen: Observation, plan: Plan) -> None:
    """3 degrees about the board's origin move a hole by several mm."""
    found = _judged(task, seen, plan, _slid(_pose(seen), np.zeros(3), 3.0))
    assert found.moved
    assert not found.enters
    assert np.degrees(found.shift.turn) == pytest.approx(3.0)


def test_a_second_look_that_is_too_uncertain_itself_is_worth_nothing(
    task: Task, seen: Observation, plan: Plan
) -> None:
    after = _slid(_pose(seen), np.array((8e-3, 0.0, 0.0)))
    vague = replace(after, covariance=frozen(80 * NOISE), repeatability=frozen(80 * NOISE))
    found = _judged(task, seen, plan, vague)
    assert not found.enters
    assert not found.worth


def test_a_cube_from_beside_its_hole_has_a_budget_too(task: Task, seen: Observation, plan: Plan) -> None:
    cubes = [{**c, "from": "beside 03-04/1"} if n == 0 else c for n, c in enumerate(plan.task["cubes"])]
    beside = replace(plan, task={**plan.task, "cubes": cubes})
    found = _judged(task, seen, beside, _pose(seen))
    assert found.planned is not None
    assert found.planned > 0.99
    assert found.enters


def test_without_a_calibration_the_tolerance_of_boards_counts(task: Task) -> None:
    plain = read_task(data_file("scenes/task2.toml"))
    seen = _noisy(true_look(plain))
    made = plan_rest(Rest(plain, seen, plain.cell.q_start, 0.5))
    assert made is not None
    for slid, enters in ((1.0e-3, True), (2.0e-3, False)):
        found = _judged(plain, seen, made, _slid(_pose(seen), np.array((slid, 0.0, 0.0))))
        assert (found.planned, found.enters, found.worth) == (None, enters, True)


def test_a_second_look_is_asked_for_only_where_it_makes_the_placement_certain(
    task: Task, seen: Observation, plan: Plan
) -> None:
    """Noise that two looks at the target average enough; less of it needs none, and more is not cured."""
    cell, asked = replace(task.cell, photographs=50), {}
    for factor in (1.0, 30.0, 35.0, 200.0):
        noisy, noise = _noisy(seen, factor * NOISE), {b.name: b for b in seen.boards}
        noisy = replace(noisy, boards=tuple(b if b.name == "03-04" else noise[b.name] for b in noisy.boards))
        asked[factor] = second_look_helps(cell, noisy, plan)
        below = {b.cube for b in plan_budgets(cell, noisy, plan) if b.insertion < cell.least_insertion}
        assert asked[factor] in (set(), below)
    assert asked[1.0] == asked[200.0] == set()
    assert any(asked.values())
