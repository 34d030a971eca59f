"""Solutions for the poses of a list, or why there are none."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.errors import ImpossibleError
from arm.robot.model import Robot
from arm.robot.shapes import Body, Box, Cylinder, Sphere
from arm.robot.tool import urdf_limits
from arm.se3 import Array, rot_x, transform
from arms import made_up
from plan.kinematics.numeric_ik import SearchOptions, Solutions, solve_ik
from plan.options import PlanOptions
from plan.program.goals.attachments import AttachmentWorlds
from plan.program.goals.target import Target
from plan.program.sequence.candidates import Candidates
from plan.program.setting import Setting
from plan.scene import Scene
from plan.trajectory.virtual_unit import virtual_unit
from plans.waypoints import refusal_of
from tasks.pose_lists import TABLE, down


@pytest.mark.slow
def test_refusals_say_what_and_how_much(robot: Robot, crs97: Unit) -> None:
    far = refusal_of(robot, crs97, [TABLE], Target("far", down(1.2, 0.0, 0.3)))
    assert "target 'far' at (1200, 0, 300) mm is out of reach" in str(far)
    assert far.data["outside_m"] > 0.1
    small = refusal_of(robot, crs97, [TABLE], Target("small", down(0.42e-3, 0.0, 0.3e-3)))
    assert "target 'small' at (0.420, 0, 0.300) mm is out of reach" in str(small)

    low = refusal_of(robot, crs97, [TABLE], Target("low", down(0.45, 0.1, -0.055), free="rz"))
    assert "all" in str(low)
    assert "finger_" in str(low)
    assert low.data["pair"][1] == "table"
    assert low.data["distance_m"] < 0.0

    close = refusal_of(robot, crs97, [TABLE], Target("close", down(0.45, 0.1, -0.036), approach=0.05))
    assert close.data["target"] == "close"

    out = refusal_of(
        robot, crs97, [TABLE], Target("a", down(0.45, 0.1, 0.2)), Target("b", down(0.95, 0.1, 0.2), by="line")
    )
    assert "cannot be followed from any of" in str(out)
    assert "line at 'b'" in str(out)
    assert out.data["done_m"] > 0.05

    cage = [TABLE, Body("cage", Box((0.9, 0.02, 1.0)), transform(t=(0.58, 0.0, 0.45)), "wall")]
    cage.append(Body("back", Box((0.9, 0.02, 1.0)), transform(t=(-0.58, 0.0, 0.45)), "wall"))
    cage.append(Body("lid", Box((2.0, 2.0, 0.02)), transform(t=(0.0, 0.0, 0.7)), "wall"))
    at = robot.T_base_tool(np.radians([-60, -35, -85, 0, -60, 0]))
    pressed = refusal_of(
        robot, crs97, [Body("ball", Sphere(0.02), at, "post")], Target("a", down(0.3, 0.35, 0.2))
    )
    assert "q_start: palm is" in str(pressed)
    assert pressed.data["pair"][1] == "ball"
    stuck = refusal_of(robot, crs97, cage, Target("other side", down(0.3, 0.35, 0.2)))
    assert "no path to other side" in str(stuck)
    assert stuck.data["pair"][1] in ("cage", "back", "lid")
    assert sum(stuck.data["refused"].values()) >= 1


def candidates_of(robot: Robot, unit: Unit, target: Target, post: Body, options: PlanOptions) -> Candidates:
    setting = Setting(Scene(robot, robot, (TABLE, post), ()), unit, unit.limits(), options)
    return Candidates(setting, AttachmentWorlds(setting.scene, [target]), [range(1)], IK)


def solutions_of(candidates: Candidates) -> tuple[Array, Array]:
    """All solutions of the only target, and their distances from what is around."""
    (target,), limits = candidates.targets, candidates.limits
    q = solve_ik(candidates.robot, target.poses, limits.lower, limits.upper, target.free, IK).q
    return q, np.array([candidates.worlds.at_least().distance(at).value for at in q])


IK = SearchOptions(samples=72)
HOME = np.radians([-60, -35, -85, 0, -60, 0])


@pytest.mark.parametrize(("approach", "clearance"), [(0.0, 0.012), (0.05, 0.004)])
def test_solutions_keep_the_clearance_of_what_follows(
    robot: Robot, crs97: Unit, approach: float, clearance: float
) -> None:
    """That of transits if they end there, that of lines if a line does; beside a post only some yaws do."""
    target = Target("a", down(0.45, 0.1, 0.1), free="rz", approach=approach)
    options = PlanOptions(clearance=0.012, line_clearance=0.004)
    candidates = candidates_of(robot, crs97, target, beside(0.06), options)
    candidates.solve(HOME)
    every, away = solutions_of(candidates)
    assert ((away > 0.5 * clearance) & (away < 0.95 * clearance)).any()
    assert np.array_equal(ordered(candidates.ranked(0).q), ordered(every[away >= clearance]))


def beside(gap: float) -> Body:
    return Body("post", Cylinder(0.01, 0.3), transform(t=(0.45, 0.1 + gap, 0.1)), "post")


def ordered(q: Array) -> Array:
    return q[np.lexsort(q.T)]


@pytest.mark.parametrize("near_ends", [False, True])
def test_ends_that_are_too_near_are_taken_only_if_that_is_allowed(
    robot: Robot, crs97: Unit, near_ends: bool
) -> None:
    """And never those that touch; the refusal names the best."""
    options = PlanOptions(clearance=0.05, near_ends=near_ends)
    candidates = candidates_of(
        robot, crs97, Target("a", down(0.45, 0.1, 0.1), free="rz"), beside(0.05), options
    )
    every, away = solutions_of(candidates)
    assert away.min() < 0.0 < away.max() < options.clearance
    if near_ends:
        candidates.solve(HOME)
        assert np.array_equal(ordered(candidates.ranked(0).q), ordered(every[away > 0.0]))
        return
    with pytest.raises(ImpossibleError, match=r"all .* solutions are too near to a body; at best") as refused:
        candidates.solve(HOME)
    assert refused.value.data["distance_m"] == pytest.approx(away.max())


def test_whole_revolutions_are_alike_and_long_ways_on_a_rail_are_not(tmp_path: Path) -> None:
    """A post at one place of the rail; the tool is there again after a revolution, and not 6.28 m further on."""
    rail = ("0 0 0.05", "0 0 0", "0 1 0", "prismatic", -9.0, 9.0)
    turning = ("0 0 0.2", "0 0 0", "0 0 1", "revolute", -9.0, 9.0)
    robot = made_up.arm(tmp_path, [rail, turning, *made_up.RAIL[2:]])
    limits = urdf_limits(robot, 4.0)
    q = np.array([0.0, 0.0, 0.2, 0.3, 0.3])
    for joint, same in ((0, False), (1, True)):
        for post_at in (q, q + 2.0 * np.pi * np.eye(5)[joint]):
            post = Body("post", Sphere(0.05), robot.T_base_tool(post_at), "post")
            setting = Setting(
                Scene(robot, robot, (post,), ()), virtual_unit(robot, limits), limits, PlanOptions()
            )
            worlds = AttachmentWorlds(setting.scene, [Target("a", q=q)])
            rows = np.stack([q, q + 2.0 * np.pi * np.eye(5)[joint], q + 0.9 * np.eye(5)[joint]])
            some = Solutions(rows, np.zeros(3, dtype=np.intp), ("",) * 3, np.zeros(3, dtype=bool))
            kept = Candidates(setting, worlds, [range(1)], IK).free(range(1), some).q
            clear = [not worlds.at_least().in_collision(row, 0.01) for row in rows]
            assert np.array_equal(kept, rows[clear])
            assert (clear[0] == clear[1]) == same


def test_a_configuration_that_is_too_near_is_told_as_such(robot: Robot, crs97: Unit) -> None:
    """No pose of it can be turned, and it has no approach."""
    q = np.radians([0.0, -80.0, -80.0, 0.0, -20.0, 0.0])
    low = refusal_of(robot, crs97, [TABLE], Target("low", q=q))
    assert "target 'low': the configuration is too near to a body: " in str(low)
    assert str(low).endswith("choose another one")


@pytest.mark.parametrize(
    ("pose", "free", "told"),
    [
        (transform(t=(0.42, 0.0, 0.25)), (), True),
        (transform(t=(0.42, 0.0, 0.25)), "rz", True),
        (transform(t=(1.42, 0.0, 0.25)), (), False),
        (down(1.42, 0.0, 0.25), (), False),
    ],
)
def test_a_pose_with_its_z_axis_the_wrong_way_is_told(
    robot: Robot, crs97: Unit, pose: Array, free: str, told: bool
) -> None:
    candidates = candidates_of(robot, crs97, Target("a", pose, free=free), beside(0.06), PlanOptions())
    with pytest.raises(ImpossibleError) as refused:
        candidates.solve(HOME)
    there = r"; with its z axis reversed, turned by 180 deg about its [xy] axis, it is in reach; try another"
    assert bool(re.search(there, str(refused.value))) == told


@pytest.mark.parametrize("free", [(), "rz"])
def test_a_pose_that_leans_from_what_a_scara_can_is_told(tmp_path: Path, free: str) -> None:
    joints = [
        ("0 0 0.4", "0 0 0", "0 0 1", "revolute", -2.5, 2.5),
        ("0.3 0 0", "0 0 0", "0 0 1", "revolute", -2.4, 2.4),
        ("0.25 0 0", "0 0 0", "0 0 1", "prismatic", -0.2, 0.2),
        ("0 0 0", "0 0 0", "0 0 -1", "revolute", -6.0, 6.0),
    ]
    robot = made_up.arm(tmp_path, joints)
    limits = urdf_limits(robot, 4.0)
    T = robot.T_base_tool([0.3, 0.8, 0.0, 0.2])
    far = transform(t=(2.0, 0.0, 0.0))
    told = {}
    for name, pose in (("leaning", T @ transform(rot_x(np.radians(-10.0)))), ("far", far @ T)):
        setting = Setting(Scene(robot, robot, (), ()), virtual_unit(robot, limits), limits, PlanOptions())
        worlds = AttachmentWorlds(setting.scene, [Target("a", pose, free=free)])
        with pytest.raises(ImpossibleError) as refused:
            Candidates(setting, worlds, [range(1)], SearchOptions(starts=8)).solve(np.zeros(4))
        told[name] = str(refused.value)
    assert (
        "is out of reach: all joints that turn have parallel axes, so the tool keeps its tilt, and the pose leans from "
        "it by 10.0 deg; give a pose with that tilt, or free rx and ry"
    ) in told["leaning"]
    assert "none of 8 starts of the numerical search converged; try another pose" in told["far"]
