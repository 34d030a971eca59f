"""Freedom within limits: samples stay inside and reach the limits, and the nearest pose is the nearest."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.errors import InputError
from arm.robot.model import Robot
from arm.robot.shapes import Body, Box, Cylinder
from arm.se3 import inverse, rot_x, rot_y, rot_z, rotation, transform
from plan.kinematics.freedom import Freedom, coordinates_of, placed
from plan.kinematics.numeric_ik import FREE
from plan.program.goals.target import Target
from plans.waypoints import planned, refusal_of
from tasks.pose_lists import TABLE, down

T = transform(rot_x(0.3) @ rot_y(-0.7), (0.3, 0.2, 0.4))
TILT = Freedom({"rz": (-0.5, 1.0)}, np.radians(20.0))


def random_pose(rng: np.random.Generator) -> np.ndarray:
    return T @ transform(rotation(rng.normal(size=3)), 0.1 * rng.normal(size=3))


def violation(freedom: Freedom, T: np.ndarray, T_now: np.ndarray, free: tuple[str, ...] = ()) -> float:
    """Largest excess of a tool at T_now beyond the limits about T, m or rad."""
    now = coordinates_of(T, T_now)
    worst = max(0.0, float(np.hypot(*now[3:5])) - freedom.tilt) if freedom.tilt > 0.0 else 0.0
    for value, name in zip(now, FREE, strict=True):
        if name not in free and not (freedom.tilt > 0.0 and name in ("rx", "ry")):
            low, high = freedom.ranges.get(name, (0.0, 0.0))
            worst = max(worst, low - value, value - high)
    return worst


def test_coordinates_give_the_pose_again() -> None:
    rng = np.random.default_rng(1)
    turned = [
        rotation((a, b, 0.0)) @ rot_z(1.0) for a, b in np.radians([[0, 0], [90, 0], [0, -90], [179, 0]])
    ]
    for now in [random_pose(rng) for _ in range(200)] + [T @ transform(R) for R in turned]:
        c = coordinates_of(T, now)
        swing, twist = rotation((c[3], c[4], 0.0)), rot_z(c[5])
        np.testing.assert_allclose(T @ transform(swing @ twist, c[:3]), now, atol=1e-12)
        assert np.hypot(c[3], c[4]) == pytest.approx(np.arccos(T[:3, 2] @ now[:3, 2]), abs=1e-9)


def some_coordinates(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Coordinates (*shape, 6): positions to 0.2 m, swings to 3 rad, all twists."""
    angle, size = rng.uniform(-np.pi, np.pi, (2, *shape))
    swing = (np.abs(size) * 3.0 / np.pi)[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    twist = rng.uniform(-np.pi, np.pi, (*shape, 1))
    return np.concatenate([rng.uniform(-0.2, 0.2, (*shape, 3)), swing, twist], axis=-1)


def test_placed_poses_have_their_coordinates() -> None:
    """`placed` and `coordinates_of` invert each other, for arrays of any shape."""
    rng = np.random.default_rng(7)
    for shape in ((), (5,), (4, 3)):
        c = some_coordinates(rng, shape)
        poses = placed(T, c)
        assert poses.shape == (*shape, 4, 4)
        np.testing.assert_allclose(coordinates_of(T, poses), c, atol=1e-9)
        R = poses[..., :3, :3]
        np.testing.assert_allclose(
            R @ np.swapaxes(R, -1, -2), np.broadcast_to(np.eye(3), R.shape), atol=1e-12
        )
    assert np.array_equal(placed(T, np.zeros(6))[3], (0.0, 0.0, 0.0, 1.0))


def test_arrays_give_what_single_poses_give() -> None:
    rng = np.random.default_rng(8)
    about = np.stack([random_pose(rng) for _ in range(4)])
    tools = np.stack([random_pose(rng) for _ in range(4)])
    c = coordinates_of(about[:, None], tools)
    away, turned = TILT.excess(about[:, None], tools, ("rz",))
    assert c.shape == (4, 4, 6)
    assert away.shape == turned.shape == (4, 4)
    for i, j in np.ndindex(4, 4):
        np.testing.assert_allclose(c[i, j], coordinates_of(about[i], tools[j]), atol=1e-12)
        single = TILT.excess(about[i], tools[j], ("rz",))
        np.testing.assert_allclose((away[i, j], turned[i, j]), single, atol=1e-12)
        np.testing.assert_allclose(placed(about[i], c[i, j]), tools[j], atol=1e-9)


LIMITED = Freedom({"y": (-0.02, 0.05), "z": (0.01, 0.02), "rz": (-0.5, 1.0)}, np.radians(20.0))


def test_the_box_has_the_limits_of_every_direction() -> None:
    low, high = LIMITED.box(("x",))
    tilt = LIMITED.tilt
    assert low.tolist() == [-np.inf, -0.02, 0.01, -tilt, -tilt, -0.5]
    assert high.tolist() == [np.inf, 0.05, 0.02, tilt, tilt, 1.0]
    assert Freedom({}).box() == (pytest.approx(np.zeros(6)), pytest.approx(np.zeros(6)))
    low, high = Freedom({"rx": (-0.1, 0.2)}).box(("rz",))
    assert (low[3:].tolist(), high[3:].tolist()) == ([-0.1, 0.0, -np.inf], [0.2, 0.0, np.inf])


@pytest.mark.parametrize("free", [(), ("rz",), ("x", "rz")])
def test_the_excess_is_0_within_the_limits_and_what_is_beyond_them(free: tuple[str, ...]) -> None:
    """Moved beyond a limit by a known amount: positions as one distance, a tilt and a twist as one angle."""
    rng = np.random.default_rng(9)
    inside = coordinates_of(T, LIMITED.sampled(T, 100, seed=1))
    for name in free:
        inside[:, FREE.index(name)] = rng.uniform(-3.0, 3.0, len(inside))
    away, turned = LIMITED.excess(T, placed(T, inside), free)
    assert max(away.max(), turned.max()) < 1e-9
    low, high = LIMITED.box()
    for _ in range(100):
        beyond = rng.uniform(0.0, 0.3, 6) * (rng.random(6) < 0.5)
        up = rng.random(6) < 0.5
        c = np.where(beyond > 0.0, np.where(up, high + beyond, low - beyond), np.clip(0.0, low, high))
        angle = rng.uniform(0.0, 2.0 * np.pi)
        c[3:5] = (LIMITED.tilt + beyond[3]) * np.array([np.cos(angle), np.sin(angle)])
        beyond[4] = 0.0
        beyond[[FREE.index(name) for name in free]] = 0.0
        found = LIMITED.excess(T, placed(T, c), free)
        assert float(found[0]) == pytest.approx(np.linalg.norm(beyond[:3]), abs=1e-9)
        assert float(found[1]) == pytest.approx(np.linalg.norm(beyond[3:]), abs=1e-9)


def test_a_twist_just_beyond_half_a_revolution_is_just_beyond() -> None:
    """Its angle jumps there from pi to -pi."""
    half = Freedom({"rz": (0.0, np.pi)})
    for beyond in (-0.01, 1e-6, 0.01, 0.4):
        tool = placed(T, np.array([0.0, 0.0, 0.0, 0.0, 0.0, np.pi + beyond]))
        assert float(half.excess(T, tool)[1]) == pytest.approx(max(0.0, beyond), abs=1e-9)
        mirrored = Freedom({"rz": (-np.pi, 0.0)}).excess(T, T @ inverse(inverse(T) @ tool))
        assert float(mirrored[1]) == pytest.approx(max(0.0, beyond), abs=1e-9)


@pytest.mark.parametrize(
    "freedom",
    [TILT, Freedom({"x": (-0.02, 0.05)}), Freedom({"x": (0.01, 0.02), "y": (-0.1, 0.1), "rz": (-3.0, 3.0)})],
)
def test_samples_are_within_the_limits_and_come_near_all_of_them(freedom: Freedom) -> None:
    poses = freedom.sampled(T, 400, seed=3)
    assert max(violation(freedom, T, pose) for pose in poses) < 1e-12
    found = np.array([coordinates_of(T, pose) for pose in poses])
    for name, (low, high) in freedom.ranges.items():
        column = found[:, ("x", "y", "z", "rx", "ry", "rz").index(name)]
        assert column.min() < low + 0.02 * (high - low)
        assert column.max() > high - 0.02 * (high - low)
    if freedom.tilt:
        assert np.hypot(found[:, 3], found[:, 4]).max() > 0.98 * freedom.tilt
    np.testing.assert_array_equal(poses, freedom.sampled(T, 400, seed=3))


def test_the_nearest_pose_is_the_tool_s_own_where_that_is_allowed() -> None:
    rng = np.random.default_rng(2)
    for pose in TILT.sampled(T, 50, seed=4):
        np.testing.assert_allclose(TILT.nearest(T, pose, ()), pose, atol=1e-9)
    for _ in range(50):
        nearest = TILT.nearest(T, random_pose(rng), ())
        assert violation(TILT, T, nearest) < 1e-9
        np.testing.assert_allclose(nearest[:3, 3], T[:3, 3], atol=1e-12)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"ranges": {"roll": (0, 1)}}, "ranges = 'roll': must be one of x, y"),
        ({"ranges": {"rz": (0, 1)}, "free": "rz"}, "must not be in `free` too"),
        ({"ranges": {"rz": (1, 0)}}, r"ranges\['rz'\] = .*lowest and a highest"),
        ({"ranges": {"rz": (0, 4)}}, "to 3.1416"),
        ({"tilt": -0.1}, "tilt = -0.1: must be from 0"),
        ({"tilt": 0.1, "free": "rx"}, "cannot be combined with rx or ry"),
    ],
)
def test_wrong_limits(change: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        Target("a", T, **change)


def test_a_tilt_leads_past_what_an_exact_pose_would_hit(robot: Robot, crs97: Unit) -> None:
    """A ceiling over the pose: the tool has to come in tilted."""
    at = down(0.45, 0.1, 0.12)
    lid = Body("lid", Box((0.3, 0.05, 0.02)), transform(t=(0.45, 0.06, 0.24)), "wall")
    exact = Target("a", at)
    assert "lid" in str(refusal_of(robot, crs97, [TABLE, lid], exact))
    target = Target("a", at, tilt=np.radians(30.0), ranges={"rz": (-np.pi, np.pi)})
    plan = planned(robot, crs97, [TABLE, lid], target)
    reached = plan.reached[0].T_base_tool
    assert violation(target.freedom, at, reached) < 1e-4
    assert np.arccos(at[:3, 2] @ reached[:3, 2]) > np.radians(2.0)


@pytest.mark.slow
def test_a_box_of_positions_and_a_line_to_it(robot: Robot, crs97: Unit) -> None:
    post = Body("post", Cylinder(0.02, 0.3), transform(t=(0.45, 0.0, 0.1)), "post")
    box = {"x": (-0.1, 0.1), "y": (-0.1, 0.1)}
    first = Target("a", down(0.45, 0.0, 0.15), free="rz", ranges=box)
    second = Target("b", down(0.40, 0.2, 0.15), free="rz", ranges={"x": (-0.08, 0.08)}, by="line")
    plan = planned(robot, crs97, [TABLE, post], first, second)
    for target, reached in zip((first, second), plan.reached, strict=True):
        assert violation(target.freedom, target.poses[0], reached.T_base_tool, ("rz",)) < 1e-4
