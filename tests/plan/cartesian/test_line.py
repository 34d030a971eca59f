"""Lines: on the line, inside the constraints, or an error that names what stopped them."""

from __future__ import annotations

import numpy as np
import pytest

from arm.controller.unit import Limits, Unit
from arm.errors import ImpossibleError, InputError
from arm.robot.model import Robot
from arm.se3 import rot_x, rot_z, rotation, transform
from plan.cartesian.line import Barrier, Line, LineOptions, follow_line
from plan.cartesian.reachability import reach
from plan.kinematics.product_of_exponentials import product_of_exponentials
from plans.barred_lines import GRASP, start_at, up


def _random_lines(robot: Robot, unit: Unit, count: int, seed: int):  # type: ignore[no-untyped-def]
    """Approach lines of tilted grasps that the reach table says can be served."""
    rng = np.random.default_rng(seed)
    grasps = {}
    for k in range(count):
        tilt = rotation(rng.uniform(-0.26, 0.26, 3) * (1, 1, 0))
        place = (rng.uniform(0.3, 0.55), rng.uniform(-0.25, 0.25), rng.uniform(0.02, 0.2))
        grasps[str(k)] = [transform(tilt @ rot_x(np.pi) @ rot_z(rng.uniform(-3, 3)), place)]
    table = reach(robot, unit.limits(), grasps, 0.1)
    for hole in table.holes:
        for choice in hole.feasible():
            yield choice, grasps[hole.hole][0]


@pytest.mark.few(1)
def test_random_lines_are_straight_at_and_between_way_points(robot: Robot, unit: Unit) -> None:
    limits, arm, count = unit.limits(), product_of_exponentials(robot), 0
    for choice, T in _random_lines(robot, unit, 40, seed=11):
        top = up(T, 0.1)
        path = follow_line(robot, choice.q_hole, T, top, limits)
        count += 1
        line = Line(T, top)
        at_points = line.deviation(arm.tool_poses(path.q))
        assert at_points.distance.max() < 1e-8
        assert at_points.angle.max() < 1e-7
        between = line.deviation(arm.tool_poses(path.spline(np.linspace(0, 0.1, 777))))
        assert between.distance.max() < 1e-5
        assert between.angle.max() < np.radians(0.005)
        np.testing.assert_array_equal(path.q[0], choice.q_hole)
        np.testing.assert_allclose(
            path.q[-1], choice.q_offset, atol=1e-7
        )  # on the branch that reach promised
        assert (path.q >= limits.lower).all()
        assert (path.q <= limits.upper).all()
    assert count > 40


def test_steps_are_halved_until_the_spline_is_straight(robot: Robot, crs97: Unit) -> None:
    q, top, arm = start_at(robot, crs97), up(GRASP, 0.1), product_of_exponentials(robot)
    coarse = follow_line(robot, q, GRASP, top, crs97.limits(), LineOptions(step=0.1))
    fine = follow_line(robot, q, GRASP, top, crs97.limits(), LineOptions(step=0.1, tolerance=1e-8))
    assert 5 <= len(coarse.q) < len(fine.q)
    for path, tolerance in ((coarse, 1e-5), (fine, 1e-8)):
        between = arm.tool_poses(path.spline(np.linspace(0, 0.1, 777)))
        assert Line(GRASP, top).deviation(between).distance.max() < 1.05 * tolerance
    with pytest.raises(ImpossibleError, match=r"between way-points .* mm apart the tool is") as caught:
        follow_line(robot, q, GRASP, top, crs97.limits(), LineOptions(step=0.1, tolerance=1e-13))
    assert caught.value.data["constraint"] == "smoothness"


def test_turning_on_the_way_and_on_the_spot(robot: Robot, crs97: Unit) -> None:
    q, arm = np.radians([-10.0, -40.0, -80.0, 20.0, -60.0, 0.0]), product_of_exponentials(robot)
    GRASP = robot.T_base_tool(q)
    for T_end in (up(GRASP, 0.1) @ transform(rot_z(0.5)), GRASP @ transform(rot_x(0.2))):
        path = follow_line(robot, q, GRASP, T_end, crs97.limits())
        np.testing.assert_allclose(robot.T_base_tool(path.q[-1]), T_end, atol=1e-9)
        assert Line(GRASP, T_end).deviation(arm.tool_poses(path.q)[[0, -1]]).distance.max() < 1e-8
        assert np.abs(np.diff(path.q, axis=0)).max() < 0.06


def test_a_joint_limit_stops_the_line_and_is_named(robot: Robot, crs97: Unit) -> None:
    q, top = start_at(robot, crs97), up(GRASP, 0.1)
    free = follow_line(robot, q, GRASP, top, crs97.limits())
    joint = int(np.argmax(np.abs(free.q[-1] - q)))
    stop = free.q[10, joint]  # way-point 10 of 20: 50 mm of 100
    lower, upper = crs97.lower.copy(), crs97.upper.copy()
    (upper if free.q[-1, joint] > q[joint] else lower)[joint] = stop
    limits = Limits(lower, upper, *(getattr(crs97.limits(), n) for n in ("velocity", "acceleration")))
    with pytest.raises(ImpossibleError, match=rf"joint J{joint + 1} is at its \w+ limit of") as caught:
        follow_line(robot, q, GRASP, top, limits)
    assert caught.value.data["joint"] == f"J{joint + 1}"
    assert caught.value.data["done_m"] == pytest.approx(0.05, abs=1e-9)
    assert "50.0 of 100.0 mm" in str(caught.value)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_joint_that_cannot_keep_up_is_named(robot: Robot, crs97: Unit, side: float) -> None:
    """Sideways, joint 1 has to turn: to the left up, to the right down."""
    q, limits = start_at(robot, crs97), crs97.limits()
    velocity = limits.velocity.copy()
    velocity[0] = 0.01
    slow = Limits(limits.lower, limits.upper, velocity, limits.acceleration)
    T_end = transform(GRASP[:3, :3], GRASP[:3, 3] + (0.0, side * 0.05, 0.0))
    with pytest.raises(ImpossibleError, match=r"joint J1 cannot move fast enough .*singular") as caught:
        follow_line(robot, q, GRASP, T_end, slow, LineOptions(slowest=0.02))
    assert caught.value.data["constraint"] == "J1 speed"
    # 0.05 m at 0.02 m/s leave joint 1 0.025 rad, a quarter of what it needs; a tenth of the speed is enough
    follow_line(robot, q, GRASP, T_end, slow, LineOptions(slowest=0.002))


def test_leaving_the_workspace_is_reported(robot: Robot, crs97: Unit) -> None:
    T = transform(rotation((0.0, np.pi / 2, 0.0)), (0.7, 0.0, 0.3052))
    q = start_at(robot, crs97, T)
    wide = Limits(crs97.lower - 1, crs97.upper + 1, np.full(6, 50.0), crs97.limits().acceleration)
    with pytest.raises(ImpossibleError, match="out of the arm's reach") as caught:
        follow_line(robot, q, T, transform(T[:3, :3], (1.0, 0.0, 0.3052)), wide)
    reached = 0.3048 + 0.3302 + 0.0762 + 0.134112 - 0.7
    assert caught.value.data["done_m"] == pytest.approx(reached, abs=0.003)


def test_a_barrier_stops_the_line_and_is_named(robot: Robot, crs97: Unit) -> None:
    """A ceiling on the tool's height, as a row on dq."""
    q, top, ceiling = start_at(robot, crs97), up(GRASP, 0.1), 0.05 + 0.061

    def below_ceiling(q: np.ndarray) -> Barrier:
        T = robot.T_base_tool(q)
        rise = (T[:3, :3] @ robot.jacobian(q)[:3])[2]
        return Barrier(rise[None], np.array([ceiling - T[2, 3]]), ("ceiling",))

    with pytest.raises(ImpossibleError, match="ceiling is in the way") as caught:
        follow_line(robot, q, GRASP, top, crs97.limits(), LineOptions(barrier=below_ceiling))
    assert caught.value.data["done_m"] == pytest.approx(0.060, abs=1e-9)
    with pytest.raises(ImpossibleError, match="no step satisfies all of ceiling") as caught:
        follow_line(
            robot, q, GRASP, top, crs97.limits(), LineOptions(barrier=lambda q: _shut(robot, q, ceiling))
        )
    assert caught.value.data["done_m"] == pytest.approx(0.060, abs=1e-9)
    high = LineOptions(barrier=lambda q: Barrier(np.zeros((0, 6)), np.zeros(0), ()))
    assert follow_line(robot, q, GRASP, top, crs97.limits(), high).s[-1] == pytest.approx(0.1)


def _shut(robot: Robot, q: np.ndarray, ceiling: float) -> Barrier:
    """Above the ceiling nothing is allowed, below it everything; its rows do not say where it comes from."""
    above = robot.T_base_tool(q)[2, 3] > ceiling
    return Barrier(np.zeros((1, 6)), np.array([-1.0 if above else 1.0]), ("ceiling",))


def test_a_wrong_start_is_refused(robot: Robot, crs97: Unit) -> None:
    q = start_at(robot, crs97)
    with pytest.raises(InputError, match="from the tool at q_start"):
        follow_line(robot, q, up(GRASP, 0.01), up(GRASP, 0.1), crs97.limits())
    lower = crs97.lower.copy()
    lower[4] = q[4] + 0.1
    with pytest.raises(InputError, match=r"J5 5\.73 deg beyond"):
        follow_line(
            robot,
            q,
            GRASP,
            up(GRASP, 0.1),
            Limits(lower, crs97.upper, crs97.limits().velocity, crs97.limits().acceleration),
        )
    with pytest.raises(InputError, match="one of daqp, osqp"):
        follow_line(robot, q, GRASP, up(GRASP, 0.1), crs97.limits(), LineOptions(solver="magic"))
    with pytest.raises(InputError, match="two different poses"):
        follow_line(robot, q, GRASP, GRASP, crs97.limits())
