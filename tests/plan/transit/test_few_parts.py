"""Arms with little to them: without collision bodies, with one joint. All doors of the planner stay open to them."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.robot.model import Robot, load_robot
from arm.robot.shapes import Body, Box, Cylinder
from arm.robot.tool import urdf_limits, with_disabled_collisions, with_tool
from arm.se3 import transform
from arms.made_up import SEVEN, Z, arm, urdf
from plan.collision.bezier import curve_of_waypoints
from plan.collision.certificate import certify_curve
from plan.collision.world import World
from plan.kinematics.numeric_ik import solve_ik
from plan.options import PlanOptions
from plan.program.goals.target import Target
from plan.program.pose_lists import plan_poses
from plan.transit.planner import plan_transit

ONE = [("0 0 0.2", "0 0 0", Z, "revolute", -3.0, 3.0)]
FAST = PlanOptions(speed=1.0)


def bare(folder: Path) -> Robot:
    """The arm of seven joints without a single collision body."""
    path = folder / "bare.urdf"
    path.write_text(re.sub("<collision>.*?</collision>", "", urdf(SEVEN)))
    return load_robot(path, "l7", transform(t=(0.0, 0.0, 0.1)))


def one(folder: Path) -> Robot:
    """A turntable with an arm of 0.3 m."""
    path = folder / "one.urdf"
    path.write_text(urdf(ONE, tip="0.3 0 0"))
    return with_disabled_collisions(load_robot(path, "l1", transform(t=(0.3, 0.0, 0.0))), neighbours=True)


BLOCK = Body("block", Box((0.1, 0.1, 0.1)), transform(t=(0.4, 0.4, 0.5)), "wall")
Q0, Q1 = np.full(7, 0.3), np.full(7, -0.6)


def test_an_arm_without_bodies_touches_nothing(tmp_path: Path) -> None:
    robot = bare(tmp_path)
    assert robot.bodies == ()
    limits = urdf_limits(robot, 4.0)
    for bodies in ([], [BLOCK]):
        world = World(robot, bodies)
        assert world.pairs.shape == (0, 2)
        assert world.distance(Q0).value == np.inf
        assert world.distances_below(Q0, 10.0) == []
        assert not world.in_collision(Q0, 0.5)
        assert world.volumes.placed(np.atleast_2d(Q0)).radii[0].shape == (0, 7)
        assert len(world.near(np.stack([Q0, Q1]), 1.0).row) == 0
        for tight in (False, True):
            checked = certify_curve(world, curve_of_waypoints([Q0, Q1, Q0]), 0.01, tight)
            assert checked.proved
            assert checked.clearance == np.inf
        assert np.array_equal(plan_transit(world, Q0, Q1, limits, 0.01, 0), [Q0, Q1])
        target = Target("a", robot.T_base_tool(Q1), approach=0.02, retract=0.02)
        plan = plan_poses(robot, bodies, [target], Q0, limits, q_end=Q0, options=FAST)
        assert plan.clearance == np.inf
        assert all(move.certified for move in plan.moves)
        assert "Infinity" not in json.dumps(plan.to_json())


def test_the_held_body_of_a_bare_arm_can_collide(tmp_path: Path) -> None:
    robot = bare(tmp_path)
    load = Body("load", Cylinder(0.03, 0.2), transform(), "cube")
    world = World(robot, [BLOCK], load, transform())
    assert len(world.pairs) == 1
    rng = np.random.default_rng(0)
    at = BLOCK.T_base_body
    hit = solve_ik(robot, at, np.full(7, -2.0), np.full(7, 2.0), free=("rx", "ry", "rz")).q[0]
    assert world.distance(hit).value < 0.0
    assert world.in_collision(hit)
    for q in rng.uniform(-2.0, 2.0, (50, 7)):
        checked = certify_curve(world, curve_of_waypoints([q, hit]), 0.005)
        assert not checked.proved
        assert checked.pair == ("load", "block")
    # the bound holds between samples
    for a, b in rng.uniform(-1.0, 1.0, (40, 2, 7)):
        checked = certify_curve(world, curve_of_waypoints([a, b]), 0.0, tight=True)
        seen = min(world.distance(a + u * (b - a)).value for u in np.linspace(0.0, 1.0, 80))
        assert checked.clearance <= max(seen, checked.seen) + 1e-9
    tooled = with_tool(
        robot, transform(t=(0, 0, 0.2)), [Body("pen", Cylinder(0.01, 0.2), transform(), "tool")]
    )
    assert len(World(tooled, [BLOCK]).pairs) == 1


@pytest.mark.slow
def test_an_arm_of_one_joint_goes_through_all_doors(tmp_path: Path) -> None:
    robot = one(tmp_path)
    limits = urdf_limits(robot, 4.0)
    assert robot.jacobian([0.2]).shape == (6, 1)
    near = Body("near", Box((0.05, 0.05, 0.4)), transform(t=(0.0, 0.3, 0.2)), "wall")
    world = World(robot, [near])
    radius = world.volumes.placed(np.atleast_2d([0.1])).radii[0].max()
    assert radius == pytest.approx(np.hypot(0.33, 0.03), abs=1e-6)
    assert world.distance([0.0]).value > 0.2
    checked = certify_curve(world, curve_of_waypoints([[0.0], [1.0]]), 0.01, tight=True)
    seen = min(world.distance([u]).value for u in np.linspace(0.0, 1.0, 400))
    assert checked.proved
    assert seen - 0.02 < checked.clearance <= seen
    assert not certify_curve(world, curve_of_waypoints([[0.0], [3.0]]), 0.01).proved
    assert np.array_equal(plan_transit(world, [-2.0], [1.0], limits, 0.01, 0), [[-2.0], [1.0]])
    with pytest.raises(ImpossibleError, match="no path around near"):
        plan_transit(world, [0.0], [3.0], limits, 0.01, 0)
    target = Target("a", robot.T_base_tool([1.0]))
    plan = plan_poses(robot, [near], [target], [-1.0], limits, q_end=[-1.0], options=FAST)
    assert plan.reached[0].q == pytest.approx([1.0], abs=1e-5)
    assert plan.clearance >= FAST.clearance
    assert np.abs(np.diff(plan.sample(0.01)[1][:, 0])).max() <= limits.velocity[0] * 0.0101


def test_the_gradient_of_a_distance_is_right_for_one_joint(tmp_path: Path) -> None:
    robot = one(tmp_path)
    ball = Body("near", Cylinder(0.04, 0.4), transform(t=(0.0, 0.3, 0.2)), "post")
    world = World(robot, [ball])
    for q in np.linspace(0.2, 1.2, 20):
        found = world.near(np.array([[q]]), 1.0)
        step = 1e-5
        slope = (world.distance([q + step]).value - world.distance([q - step]).value) / (2 * step)
        closest = int(np.argmin(found.distance))
        assert found.gradient[closest] == pytest.approx([slope], abs=1e-3)


def test_radii_of_a_seven_joint_arm_have_a_column_per_joint(tmp_path: Path) -> None:
    world = World(arm(tmp_path, SEVEN), [BLOCK])
    assert world.volumes.placed(np.atleast_2d(Q0)).radii[0].shape == (len(world.robot.bodies) - 1, 7)
