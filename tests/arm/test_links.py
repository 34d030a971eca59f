"""An arm whose links have errors, against a product of transforms that is written out here."""

from __future__ import annotations

import numpy as np
import pytest

from arm.dh import A465, DhTable
from arm.errors import InputError
from arm.links import LinkErrors, with_link_errors
from arm.robot import load_a465
from arm.se3 import Array, frozen
from plan.ik import inverse_kinematics

ROBOT = load_a465(0.134112, 0.06)


def errors(seed: int, size: float = 1.0) -> LinkErrors:
    rng = np.random.default_rng(seed)
    d, a, alpha = size * rng.normal(size=(3, 6)) * [[5e-4], [5e-4], [2e-3]]
    return LinkErrors(frozen(d), frozen(a), frozen(alpha))


def flange(q: Array, found: LinkErrors) -> Array:
    """By Denavit and Hartenberg; the last link as its maker says."""
    T = np.eye(4)
    for j in range(6):
        last = j == 5
        t, alpha = q[j] + A465.theta_offset[j], A465.alpha[j] + (0.0 if last else found.alpha[j])
        d, a = A465.d[j] + (0.0 if last else found.d[j]), A465.a[j] + (0.0 if last else found.a[j])
        c, s, ca, sa = np.cos(t), np.sin(t), np.cos(alpha), np.sin(alpha)
        T = T @ [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
    return T


@pytest.mark.parametrize("seed", range(5))
def test_the_hand_is_where_the_numbers_say(seed: int) -> None:
    found = errors(seed)
    robot = with_link_errors(ROBOT, A465, found)
    rng = np.random.default_rng(seed)
    back = np.linalg.inv(ROBOT.T_end_tool)
    for q in rng.uniform(-2.0, 2.0, (20, 6)):
        assert np.abs(robot.T_base_tool(q) @ back - flange(q, found)).max() < 1e-12
        moved = robot.T_base_tool(q)[:3, 3] - ROBOT.T_base_tool(q)[:3, 3]
        assert 1e-5 < np.linalg.norm(moved) < 2e-2
    assert robot.digest != ROBOT.digest


def test_every_branch_of_such_an_arm_reaches_its_pose() -> None:
    robot = with_link_errors(ROBOT, A465, errors(7))
    rng = np.random.default_rng(3)
    low, high = np.full(6, -np.pi), np.full(6, np.pi)
    q = rng.uniform(-1.2, 1.2, (60, 6))
    for joint in (2, 4):  # where the arm is straight, the ideal one may not reach as far
        q[:, joint] = np.where(np.abs(q[:, joint]) < 0.2, 0.5, q[:, joint])
    T = np.array([robot.T_base_tool(x) for x in q])
    found = inverse_kinematics(robot, T, low, high)
    for pose in range(len(T)):
        branches = found.of(pose).q
        assert min(np.abs(b - q[pose]).max() for b in branches) < 1e-6
        assert max(np.abs(robot.T_base_tool(b) - T[pose]).max() for b in branches) < 1e-8
    ideal = inverse_kinematics(ROBOT, T, low, high)
    assert abs(len(found) - len(ideal)) <= 0.1 * len(ideal)


def test_no_errors_leave_the_arm_as_it_is() -> None:
    assert with_link_errors(ROBOT, A465, LinkErrors.none()) is ROBOT
    last = np.zeros(6)
    last[5] = 1e-3
    assert with_link_errors(ROBOT, A465, LinkErrors(frozen(last), frozen(last), frozen(last))) is ROBOT


def test_a_table_of_another_arm_is_refused() -> None:
    other = DhTable(A465.d, A465.a, frozen(A465.alpha[::-1]), A465.theta_offset)
    with pytest.raises(InputError, match="its axis is not that of the table"):
        with_link_errors(ROBOT, other, errors(1))
    short = LinkErrors(frozen(np.ones(5)), frozen(np.ones(5)), frozen(np.ones(5)))
    with pytest.raises(InputError, match="link errors are of 5 joints"):
        with_link_errors(ROBOT, A465, short)
