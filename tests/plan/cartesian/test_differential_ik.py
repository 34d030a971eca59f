"""Lines by differential inverse kinematics: bodies are gone around with what is free, and no more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from arm.controller.unit import Unit
from arm.errors import ImpossibleError, InputError
from arm.robot.model import Robot
from arm.se3 import rot_x, rot_z, transform
from plan.cartesian.collision_barrier import collision_barrier
from plan.cartesian.line import SOLVERS, Barrier, Line, LineOptions, follow_line
from plan.collision.world import World
from plan.kinematics.product_of_exponentials import product_of_exponentials
from plans.barred_lines import GRASP, START, start_above, start_at, up, with_post

CLEARANCE, NEAR = 0.005, 0.05

YAW = 1.0

END = transform(rot_x(np.pi), (0.40, 0.10, 0.08))


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_free_yaw_bends_around_a_post(robot: Robot, crs97: Unit, solver: str) -> None:
    world = with_post(robot)
    barrier = collision_barrier(world, CLEARANCE, NEAR)
    q = start_above(robot, crs97, YAW)
    options = LineOptions(barrier=barrier, free_axis="z", solver=solver)
    path = follow_line(robot, q, START, END, crs97.limits(), options)
    clear = [world.distance(each).value for each in path.q]
    assert min(clear) >= CLEARANCE - 1e-8
    assert min(clear) < CLEARANCE + 1e-5  # it keeps no more away than asked
    deviation = Line(START, END).deviation(product_of_exponentials(robot).tool_poses(path.q), "z")
    assert deviation.distance.max() < 1e-6  # osqp meets its tolerance, no more
    assert deviation.angle.max() < 1e-6
    np.testing.assert_allclose(robot.T_base_tool(path.q[-1])[:3, 3], END[:3, 3], atol=1e-6)
    without = follow_line(robot, q, START, END, crs97.limits(), LineOptions(free_axis="z"))
    assert min(world.distance(each).value for each in without.q) < CLEARANCE
    turned = path.q[np.argmin(clear)] - without.q[np.argmin(clear)]
    assert np.abs(turned).max() > 0.02


def test_without_freedom_the_pair_that_stops_the_line_is_named(robot: Robot, crs97: Unit) -> None:
    world = with_post(robot)
    q = start_above(robot, crs97, YAW)
    T_start, T_end = START @ transform(rot_z(YAW)), END @ transform(rot_z(YAW))
    options = LineOptions(barrier=collision_barrier(world, CLEARANCE, NEAR))
    with pytest.raises(
        ImpossibleError, match=r"line stops after \d+\.\d of 200\.0 mm: .* / post \(5\.\d\d mm apart\)"
    ) as caught:
        follow_line(robot, q, T_start, T_end, crs97.limits(), options)
    data = caught.value.data
    assert data["constraint"].endswith("/ post")
    assert data["distance_m"] == pytest.approx(CLEARANCE, abs=0.001)
    # where it stops is where the line without a barrier would come too near with its next step
    free = follow_line(robot, q, T_start, T_end, crs97.limits())
    clear = np.array([world.distance(each).value for each in free.q])
    stop = int(np.searchsorted(free.s, data["done_m"] - 1e-9))
    assert clear[: stop + 1].min() >= CLEARANCE > clear[stop + 1]


def test_a_free_axis_turns_no_more_than_needed(robot: Robot, crs97: Unit) -> None:
    """Without a barrier the joints move less than with the yaw held."""
    q = start_above(robot, crs97, YAW)
    T_start, T_end = START @ transform(rot_z(YAW)), END @ transform(rot_z(YAW))
    held = follow_line(robot, q, T_start, T_end, crs97.limits())
    free = follow_line(robot, q, T_start, T_end, crs97.limits(), LineOptions(free_axis="z"))
    assert np.abs(np.diff(free.q, axis=0)).sum() < np.abs(np.diff(held.q, axis=0)).sum()
    with pytest.raises(InputError, match="free_axis = 'yaw': must be one of None, x, y, z"):
        follow_line(robot, q, T_start, T_end, crs97.limits(), LineOptions(free_axis="yaw"))


def test_a_barrier_needs_room(robot: Robot) -> None:
    with pytest.raises(InputError, match="near = 5 mm: must be above the clearance of 5 mm"):
        collision_barrier(with_post(robot), 0.005, 0.005)
    assert isinstance(collision_barrier(World(robot, []), 0.0, 1e-6)(np.zeros(6)), Barrier)


@pytest.mark.parametrize("solver", SOLVERS)
def test_solvers_agree(robot: Robot, crs97: Unit, solver: str) -> None:
    q, top = start_at(robot, crs97), up(GRASP, 0.1)
    path = follow_line(robot, q, GRASP, top, crs97.limits(), LineOptions(solver=solver))
    exact = follow_line(robot, q, GRASP, top, crs97.limits())
    np.testing.assert_allclose(path.q, exact.q, atol=1e-7)


@pytest.mark.parametrize("axes", ["z", "xy", "xyz"])
def test_what_is_free_turns_and_the_rest_does_not(robot: Robot, crs97: Unit, axes: str) -> None:
    """The tip keeps to the line, and so does what is held of the rotation; what is free turns for the least motion."""
    q = start_above(robot, crs97, YAW)
    T_start, T_end = START @ transform(rot_z(YAW)), END @ transform(rot_z(YAW))
    free = follow_line(robot, q, T_start, T_end, crs97.limits(), LineOptions(free_axis=axes))
    line, poses = Line(T_start, T_end), product_of_exponentials(robot).tool_poses(free.q)
    off = line.deviation(poses, axes)
    assert off.distance.max() < 1e-6
    assert off.angle.max() < 1e-6
    assert line.deviation(poses).angle.max() > 0.01
    held = follow_line(robot, q, T_start, T_end, crs97.limits())
    assert np.abs(np.diff(free.q, axis=0)).sum() < np.abs(np.diff(held.q, axis=0)).sum()


def test_way_points_are_searched_near_the_way(robot: Robot, crs97: Unit) -> None:
    q = start_above(robot, crs97, 0.0)
    turn = np.array([0.0, 0.0, 0.0, 0.0, 0.0, -0.4])
    plain = follow_line(robot, q, START, END, crs97.limits(), LineOptions(free_axis="z"))
    spline = CubicSpline(plain.s / plain.s[-1], plain.q)
    options = LineOptions(free_axis="z", way=lambda u: spline(u) + u * turn)
    path = follow_line(robot, q, START, END, crs97.limits(), options)
    np.testing.assert_allclose(
        path.q, spline(path.s / path.s[-1]) + path.s[:, None] / path.s[-1] * turn, atol=1e-4
    )


def test_a_spline_that_meets_a_joint_limit_stays_within(robot: Robot, crs97: Unit) -> None:
    """The way turns J6 into its limit; without room for what lies between way-points that is refused."""
    q, limits = start_above(robot, crs97, 0.0), crs97.limits()
    turn = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 2.0 * (limits.upper[5] - q[5])])
    plain = follow_line(robot, q, START, END, limits, LineOptions(free_axis="z"))
    spline = CubicSpline(plain.s / plain.s[-1], plain.q)
    options = LineOptions(free_axis="z", way=lambda u: spline(u) + u * turn)
    with pytest.raises(ImpossibleError, match="a joint limit bends the path sharply"):
        follow_line(robot, q, START, END, limits, options)
    path = follow_line(robot, q, START, END, limits, replace(options, room=1e-2))
    dense = CubicSpline(path.s, path.q)(np.linspace(0.0, path.s[-1], 5000))
    assert (dense <= limits.upper + 1e-6).all()
    assert dense[:, 5].max() > limits.upper[5] - 0.02
