"""Lists of poses on arms of other kinds, judged by forward kinematics and MuJoCo."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.plan_file import Pause, read_plan, write_plan
from arm.robot.model import Robot
from arm.robot.shapes import Body, Cylinder, Sphere, convex
from arm.robot.tool import urdf_limits
from arm.se3 import inverse, transform
from arms.made_up import PANDA, RAIL, SEVEN, UR5, UR_LIKE, XARM7, Joint, MujocoArm, arm
from cell.preview.page import preview_page
from plan.collision.world import World
from plan.kinematics.numeric_ik import solve_ik
from plan.program.goals.target import Target
from plan.program.planned import Planned
from plan.program.pose_lists import plan_poses
from plan.scene import scene_from_json
from plan.verify import replay
from tasks.pose_lists import EFFORT, FAST, TABLE, check_plan, down, off

SHORT_LINKS = [("l0", "l2"), ("l2", "l4"), ("l3", "l5"), ("l4", "l6"), ("l5", "l7")]


def rock() -> Body:
    """A mesh: the hull of 30 random points on a ball."""
    points = np.random.default_rng(5).normal(size=(30, 3))
    points *= 0.09 / np.linalg.norm(points, axis=1)[:, None]
    return Body("rock", convex(points), transform(t=(0.42, 0.0, 0.2)), "rock")


def hovering(robot: Robot, limits, bodies: list[Body], T: np.ndarray) -> np.ndarray:  # type: ignore[no-untyped-def]
    """The solution for a pose that is nearest to zero and clear of all."""
    world = World(robot, bodies)
    found = [q for q in solve_ik(robot, T, limits.lower, limits.upper).q if not world.in_collision(q, 0.02)]
    return np.asarray(min(found, key=lambda q: round(float(np.abs(q).sum()), 6)))


def _judged(plan: Planned, judge: MujocoArm, least: float) -> None:
    for move in plan.moves:
        q = plan.unit.positions(move.path.sample(0.05))
        seen = min(judge.least(x) for x in q)
        assert seen >= min(move.clearance, 0.1) - 2e-6, move.name
        assert move.clearance >= least


def test_an_arm_without_a_spherical_wrist_around_a_mesh(tmp_path: Path) -> None:
    robot = arm(tmp_path, UR_LIKE, [("l0", "l2")])
    limits = urdf_limits(robot, 4.0)
    bodies = [TABLE, rock()]
    q = hovering(robot, limits, bodies, down(0.3, -0.35, 0.35))
    targets = [
        Target("left", down(0.42, -0.22, 0.2), free="rz", approach=0.05),
        Target("over", down(0.42, 0.0, 0.36), free="rz", by="line", blend_radius=0.02),
        Target("right", down(0.42, 0.22, 0.2), free="rz", by="line"),
        Target("back", down(0.42, -0.2, 0.25), free=("rz", "z")),
    ]
    plan = plan_poses(robot, bodies, targets, q, limits, options=FAST, effort=EFFORT)
    check_plan(plan, targets, limits)
    _judged(plan, MujocoArm(tmp_path / "arm.urdf", robot, bodies), FAST.line_clearance)


def test_a_seven_joint_arm_carries_a_body_past_a_mesh(tmp_path: Path) -> None:
    robot = arm(tmp_path, SEVEN, [("l0", "l2"), ("l2", "l4"), ("l4", "l6")])
    limits = urdf_limits(robot, 4.0)
    stone = Body("stone", Sphere(0.03), transform(t=(0.4, -0.25, 0.1)), "cube")
    bodies = [TABLE, replace(rock(), T_base_body=transform(t=(0.45, 0.0, 0.12))), stone]
    touching = {("stone", "l7")}
    targets = [
        Target(
            "pick",
            down(0.4, -0.25, 0.1),
            free="rz",
            approach=0.1,
            retract=0.1,
            attach="stone",
            allowed_collisions=touching,
        ),
        Target(
            "place",
            down(0.35, 0.3, 0.15),
            free="rz",
            approach=0.1,
            retract=0.1,
            detach=True,
            allowed_collisions=touching,
        ),
    ]
    q = np.array([0.0, 0.3, 0.0, 1.5, 0.0, 1.2, 0.0])
    plan = plan_poses(robot, bodies, targets, q, limits, q_end=q, options=FAST, effort=EFFORT)
    check_plan(plan, targets, limits)
    assert [(s.name, s.attached, s.detached) for s in plan.steps if isinstance(s, Pause)] == [
        ("pick", "stone", None),
        ("place", None, "stone"),
    ]
    # MuJoCo, with the stone where it is at each instant
    judge = MujocoArm(tmp_path / "arm.urdf", robot, bodies)
    held, T = None, stone.T_base_body
    T_tool_held = inverse(plan.reached[0].T_base_tool) @ T
    for step in plan.steps:
        if isinstance(step, Pause):
            held = step.attached
            continue
        assert step.held == held
        allowed = frozenset(map(frozenset, touching)) if step.role != "transit" else frozenset()
        times = np.append(np.arange(0.0, step.path.duration_s, 0.1), step.path.duration_s)
        for x in plan.unit.positions(step.path.at(times)):
            T = robot.T_base_tool(x) @ T_tool_held if held else T
            assert judge.least(x, held, {"stone": T}, allowed) >= min(step.clearance, 0.1) - 2e-6
    np.testing.assert_allclose(T[:3, 3], (0.35, 0.3, 0.15), atol=1e-5)
    _verified_from_its_file(plan, tmp_path)


def _verified_from_its_file(plan: Planned, folder: Path) -> None:
    """The file alone gives the worlds again, with what is carried and what may touch; and the page is drawn from it."""
    write_plan(folder / "plan.json", plan.plan())
    read = read_plan(folder / "plan.json")
    assert read == plan.plan()
    scene = scene_from_json(read.scene, plan.robot, plan.robot)
    assert len(replay(read, scene, plan.unit, plan.setting.limits)) == len(plan.moves)
    page = preview_page(read, plan.robot, plan.robot, plan.unit)
    assert all(name in page for name in ("lift off pick", *plan.robot.joint_names))
    forbidden = replace(scene, allowed=frozenset())
    with pytest.raises(ImpossibleError, match="lets touch l7 and stone, which the scene does not allow"):
        replay(read, forbidden, plan.unit, plan.setting.limits)


def test_five_joints_and_a_rail(tmp_path: Path) -> None:
    robot = arm(tmp_path, RAIL, [("l1", "l3")])
    limits = urdf_limits(robot, {"q1": 1.0, "q2": 3.0, "q3": 3.0, "q4": 3.0, "q5": 3.0})
    bodies = [TABLE, Body("post", Cylinder(0.03, 0.4), transform(t=(0.4, 0.0, 0.15)), "post")]
    targets = [
        Target("a", down(0.4, -0.3, 0.2), free=("rx", "rz")),
        Target("b", down(0.4, 0.3, 0.2), free=("rx", "rz")),
    ]
    plan = plan_poses(robot, bodies, targets, np.zeros(5), limits, options=FAST, effort=EFFORT)
    assert off(plan, targets).max() < 1e-5
    check_plan(plan, targets, limits)
    _judged(plan, MujocoArm(tmp_path / "arm.urdf", robot, bodies), FAST.clearance)


@pytest.mark.parametrize(
    ("joints", "q", "overlapping"),
    [
        (UR5, [-0.9, -0.6, 1.2, 0.4, 1.57, 0.0], [("l0", "l2")]),
        (
            PANDA,
            [-0.8, 0.0, 0.0, -1.9, 0.0, 1.9, 0.8],
            [*SHORT_LINKS, ("l4", "l7")],
        ),
        (
            XARM7,
            [-0.8, 0.0, 0.0, 1.2, 0.0, 1.2, 0.0],
            SHORT_LINKS,
        ),
    ],
    ids=["UR5", "Panda", "xArm7"],
)
def test_arms_that_are_sold_go_around_a_post(
    tmp_path: Path, joints: list[Joint], q: list[float], overlapping: list[tuple[str, str]]
) -> None:
    robot = arm(tmp_path, joints, overlapping)
    limits = urdf_limits(robot, 4.0)
    bodies = [TABLE, Body("post", Cylinder(0.04, 0.6), transform(t=(0.45, 0.0, 0.26)), "post")]
    targets = [
        Target("fetch", down(0.4, -0.25, 0.15), free="rz", approach=0.06, retract=0.06),
        Target("bring", down(0.4, 0.25, 0.15)),
    ]
    plan = plan_poses(robot, bodies, targets, q, limits, options=FAST, effort=EFFORT)
    check_plan(plan, targets, limits)
    _judged(plan, MujocoArm(tmp_path / "arm.urdf", robot, bodies), FAST.line_clearance)
    assert plan.duration_s < 2.0 * plan.lower_bound_s
