"""An arm whose links have errors, against a product of transforms that is written out here."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm.errors import InputError
from arm.io.storage import data_file
from arm.robot.dh import A465, DhTable
from arm.robot.link_errors import LinkErrors, with_link_errors
from arm.robot.model import load_a465, load_robot
from arm.se3 import Array, frozen, transform
from plan.kinematics.ik import inverse_kinematics

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
def test_the_tool_pose_follows_the_corrected_dh_table(seed: int) -> None:
    found = errors(seed)
    robot = with_link_errors(ROBOT, A465, found)
    rng = np.random.default_rng(seed)
    back = np.linalg.inv(ROBOT.T_end_tool)
    for q in rng.uniform(-2.0, 2.0, (20, 6)):
        assert np.abs(robot.T_base_tool(q) @ back - flange(q, found)).max() < 1e-12
        moved = robot.T_base_tool(q)[:3, 3] - ROBOT.T_base_tool(q)[:3, 3]
        assert 1e-5 < np.linalg.norm(moved) < 2e-2
    assert robot.digest != ROBOT.digest


@pytest.mark.parametrize("which", range(3))
@pytest.mark.parametrize("joint", range(5))
def test_each_link_error_alone_moves_the_tool(which: int, joint: int) -> None:
    values = np.zeros((3, 6))
    values[which, joint] = 1e-3
    found = LinkErrors(*map(frozen, values))
    assert found.any
    q = np.array([0.3, -0.7, 0.4, 0.9, -0.6, 0.2])
    hand = with_link_errors(ROBOT, A465, found).T_base_tool(q) @ np.linalg.inv(ROBOT.T_end_tool)
    assert np.abs(hand - flange(q, found)).max() < 1e-12
    assert np.abs(hand - flange(q, LinkErrors.none())).max() > 1e-4


def test_the_digest_is_of_the_arm_and_of_its_errors() -> None:
    longer = load_robot(
        data_file("urdf/a465/a465.urdf"), "flange", transform(t=(0.0, 0.0, 0.2)), {"jaw_l": 0.0, "jaw_r": 0.0}
    )
    found = [(ROBOT, errors(1)), (ROBOT, errors(2)), (longer, errors(1)), (longer, LinkErrors.none())]
    digests = [with_link_errors(robot, A465, off).digest for robot, off in found]
    assert len({ROBOT.digest, *digests}) == 5
    assert with_link_errors(ROBOT, A465, errors(1)).digest == digests[0]


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
    with pytest.raises(InputError, match="its axis is not that of the DH table"):
        with_link_errors(ROBOT, other, errors(1))
    for wrong in (
        DhTable(frozen(1.01 * A465.d), A465.a, A465.alpha, A465.theta_offset),
        DhTable(A465.d, frozen(1.01 * A465.a), A465.alpha, A465.theta_offset),
        DhTable(A465.d, A465.a, frozen(-A465.alpha), A465.theta_offset),
    ):
        with pytest.raises(InputError, match="its axis is not that of the DH table"):
            with_link_errors(ROBOT, wrong, errors(1))
    locked = {"jaw_l": 0.0, "jaw_r": 0.0, "J6": 0.0}
    five = load_robot(data_file("urdf/a465/a465.urdf"), "flange", ROBOT.T_end_tool, locked)
    with pytest.raises(InputError, match=r"have \[6, 6, 6\] joints, the arm has 5, its DH table 6"):
        with_link_errors(five, A465, errors(1))


@pytest.mark.parametrize("counts", [(5, 5, 5), (6, 5, 6), (6, 4, 6), (6, 6, 7)])
def test_errors_of_another_number_of_joints_are_refused(counts: tuple[int, int, int]) -> None:
    wrong = LinkErrors(*(frozen(np.ones(n)) for n in counts))
    with pytest.raises(InputError, match=f"have \\[{counts[0]}, {counts[1]}, {counts[2]}\\] joints"):
        with_link_errors(ROBOT, A465, wrong)


@pytest.mark.parametrize(("kind", "axis"), [("prismatic", "0 0 1"), ("revolute", "0 0.6 0.8")])
def test_links_have_errors_about_turning_joints_along_an_axis(tmp_path: Path, kind: str, axis: str) -> None:
    limit = '<limit lower="-1" upper="1" velocity="1" effort="1"/>'
    (tmp_path / "arm.urdf").write_text(
        '<robot name="two"><link name="l0"/><link name="l1"/><link name="l2"/>'
        f'<joint name="q1" type="{kind}"><parent link="l0"/><child link="l1"/><axis xyz="{axis}"/>{limit}</joint>'
        '<joint name="q2" type="revolute"><parent link="l1"/><child link="l2"/><origin xyz="0.3 0 0"/>'
        f'<axis xyz="0 0 1"/>{limit}</joint></robot>'
    )
    robot = load_robot(tmp_path / "arm.urdf", "l2", np.eye(4))
    two = DhTable(*(frozen(v) for v in ([0.0, 0.0], [0.3, 0.0], [0.0, 0.0], [0.0, 0.0])))
    off = frozen([1e-3, 0.0])
    with pytest.raises(InputError, match=r"joint q1: is a JointModel\w+; link errors need revolute joints"):
        with_link_errors(robot, two, LinkErrors(off, off, off))
