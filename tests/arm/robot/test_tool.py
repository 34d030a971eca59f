"""Arms made ready for use: tools, pairs that are not checked, limits from the URDF, continuous joints."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm.errors import FileInputError, InputError
from arm.robot.gripper import HAND
from arm.robot.model import Robot, load_a465, load_robot
from arm.robot.shapes import Body, Box, Sphere
from arm.robot.tool import FixedTool, urdf_limits, with_disabled_collisions, with_tool
from arm.se3 import rot_x, rot_y, transform
from arms.made_up import UR_LIKE, arm, urdf
from plan.collision.world import World


@pytest.fixture
def ur(tmp_path: Path) -> Robot:
    return arm(tmp_path, UR_LIKE, [("l0", "l2")])


def test_a_tool_moves_with_the_end_and_changes_the_digest(ur: Robot) -> None:
    T = transform(rot_y(0.3), (0.02, 0.0, 0.15))
    tip = Body("tip", Sphere(0.01), T, "tool")
    other = with_tool(ur, T, [tip])
    q = np.array([0.3, -1.0, 0.7, 0.2, -0.4, 1.1])
    end = ur.T_base_tool(q) @ np.linalg.inv(ur.T_end_tool)
    np.testing.assert_allclose(other.T_base_tool(q), end @ T, atol=1e-12)
    placed = next(b for b in other.bodies_at(q) if b.name == "tip")
    np.testing.assert_allclose(placed.T_base_body, end @ T, atol=1e-12)
    assert len({ur.digest, other.digest, with_tool(ur, T).digest}) == 3
    # not checked against its own link and the one that carries it, but against all else
    pairs = [set(World(other, ()).pair_names(i)) for i in range(len(World(other, ()).pairs))]
    assert {"tip", "l4"} in pairs
    assert {"tip", "l5"} not in pairs
    assert {"tip", "l6"} not in pairs
    with pytest.raises(InputError, match="already has a body named 'l3'"):
        with_tool(ur, T, [Body("l3", Box((0.1, 0.1, 0.1)), T, "tool")])


def test_neighbours_are_not_checked(tmp_path: Path) -> None:
    bare = load_robot(_written(tmp_path), "l6", np.eye(4))
    assert not bare.disabled_collisions
    ready = with_disabled_collisions(bare, [("l0", "l2")], neighbours=True)
    wanted = {frozenset((f"l{k}", f"l{k + 1}")) for k in range(6)} | {frozenset(("l0", "l2"))}
    assert ready.disabled_collisions == wanted
    assert ready.digest != bare.digest
    with pytest.raises(InputError, match="'l9' is not a link or body; the arm has l0, l1"):
        with_disabled_collisions(bare, [("l0", "l9")])


def _written(folder: Path, text: str | None = None) -> Path:
    path = folder / "arm.urdf"
    path.write_text(text or urdf(UR_LIKE))
    return path


def test_limits_come_from_the_urdf(ur: Robot) -> None:
    limits = urdf_limits(ur, 4.0, margin=0.1)
    np.testing.assert_allclose(limits.upper[:3], [6.1, 6.1, 2.7])
    np.testing.assert_allclose(limits.lower, -limits.upper)
    np.testing.assert_allclose(limits.velocity, 1.5)
    by_name = urdf_limits(ur, {f"q{k}": float(k) for k in range(1, 7)}, velocity=[1, 2, 3, 4, 5, 6])
    np.testing.assert_allclose(by_name.acceleration, by_name.velocity)
    with pytest.raises(InputError, match="joint 'q2' is missing"):
        urdf_limits(ur, {"q1": 1.0})
    with pytest.raises(InputError, match=r"joint q1: acceleration 0 must be positive"):
        urdf_limits(ur, 0.0)
    with pytest.raises(
        InputError, match=r"joint q2: velocity 0 must be positive \(<limit> of the URDF: velocity\)"
    ):
        urdf_limits(ur, 1.0, velocity=[1, 0, 1, 1, 1, 1])
    with pytest.raises(InputError, match=r"joint q3: range 0.2 to -0.2"):
        urdf_limits(ur, 1.0, margin=3.0)


def test_a_range_in_degrees_or_millimetres_is_told(tmp_path: Path) -> None:
    """A screw of two turns each way and a track of 40 m are none."""
    joints = [(*joint[:4], -2.0, 2.0) for joint in UR_LIKE[:3]]
    text = urdf(joints)
    for new, told in (
        (
            'lower="-2.0" upper="126"',
            r"joint q1: range -2 to 126 must be within \+-12.57 rad \(are these degrees\? ",
        ),
        ('lower="-12.5" upper="12.5"', ""),
    ):
        limited = text.replace('lower="-2.0" upper="2.0"', new, 1)
        assert limited != text
        robot = load_robot(_written(tmp_path, limited), "l3", np.eye(4))
        if told:
            with pytest.raises(InputError, match=told):
                urdf_limits(robot, 1.0)
        else:
            assert urdf_limits(robot, 1.0).upper[0] == 12.5
    for high, fits in ((40.0, True), (1200.0, False)):
        slides = [("0 0 0.05", "0 0 0", "0 1 0", "prismatic", 0.0, high), *joints[1:]]
        robot = load_robot(_written(tmp_path, urdf(slides)), "l3", np.eye(4))
        if fits:
            assert urdf_limits(robot, 1.0).upper[0] == 40.0
        else:
            with pytest.raises(
                InputError, match=r"joint q1: range 0 to 1200 must be within \+-100 m \(is it in mm\?\)"
            ):
                urdf_limits(robot, 1.0)


def test_a_continuous_joint_has_a_turn_each_way(ur: Robot) -> None:
    limits = urdf_limits(ur, 1.0)
    assert limits.upper[4] == pytest.approx(2 * np.pi)
    q = np.array([0.3, -1.0, 0.7, 0.2, -0.4, 1.1])
    turned = q + 2 * np.pi * np.eye(6)[4]
    np.testing.assert_allclose(ur.T_base_tool(q), ur.T_base_tool(turned), atol=1e-12)


def test_a_joint_of_more_freedoms_is_refused(tmp_path: Path) -> None:
    text = urdf(UR_LIKE).replace('type="continuous"', 'type="floating"')
    with pytest.raises(FileInputError, match="one degree of freedom"):
        load_robot(_written(tmp_path, text), "l6", np.eye(4))
    with pytest.raises(FileInputError, match="is not a URDF"):
        load_robot(_written(tmp_path, "<robot"), "l6", np.eye(4))


def test_a_fixed_tool_is_on_the_bare_flange_of_the_a465() -> None:
    """The arm is the shipped one without its gripper; the tool stands in the flange frame."""
    T = transform(rot_x(np.pi), (-0.135, 0.0, 0.013))
    handle = Body("handle", Box((0.07, 0.01, 0.0066)), transform(t=(-0.05, 0.0, 0.013)), "tool")
    robot, shipped = FixedTool(T, (handle,)).robot(), load_a465(0.134112, 0.06)
    assert {b.name for b in robot.bodies} == {b.name for b in shipped.bodies} - set(HAND) | {"handle"}
    assert frozenset(("wrist", "handle")) in robot.disabled_collisions
    assert frozenset(("forearm", "handle")) not in robot.disabled_collisions
    rng = np.random.default_rng(21)
    for q in rng.uniform(-1.5, 1.5, (20, 6)):
        T_base_flange = shipped.T_base_tool(q) @ transform(t=(0.0, 0.0, -0.134112))
        np.testing.assert_allclose(robot.T_base_tool(q), T_base_flange @ T, atol=1e-12)
        body = next(b for b in robot.bodies_at(q) if b.name == "handle")
        np.testing.assert_allclose(body.T_base_body, T_base_flange @ handle.T_base_body, atol=1e-12)
    other = FixedTool(T, (Body("handle", Box((0.07, 0.01, 0.0067)), handle.T_base_body, "tool"),))
    assert other.robot().digest != robot.digest
    with pytest.raises(InputError, match="already has a body named 'wrist'"):
        FixedTool(T, (Body("wrist", Box((0.1, 0.1, 0.1)), T, "tool"),)).robot()
