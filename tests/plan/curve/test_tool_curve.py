"""Curves of the tool: places and poses belong to each other, and deviations are what is beyond the freedom."""

from __future__ import annotations

import numpy as np
import pytest

from arm.errors import InputError
from arm.se3 import Array, angle_between, frozen, rot_x, rot_y, rot_z, transform
from plan.curve.tool_curve import ToolCurve, directions
from plan.kinematics.freedom import Freedom
from plans.curves import arc, some_coordinates, some_curve

PER_TURN = 0.05  # m of the curve for each rad, as `ToolCurve.s` says
RESOLUTION = 3e-6  # m, of the search for the nearest place
FREEDOMS = [
    (Freedom({}), ()),
    (Freedom({}), ("rz",)),
    (Freedom({}, 0.5), ("rz",)),
    (Freedom({"x": (-0.02, 0.03), "y": (-0.01, 0.01), "rz": (-0.4, 1.0)}, 0.3), ()),
    (Freedom({"z": (-0.03, 0.0), "rx": (-0.2, 0.3), "ry": (-0.4, 0.1)}), ()),
]


@pytest.mark.parametrize("seed", range(20))
def test_places_and_poses_belong_to_each_other(seed: int) -> None:
    rng = np.random.default_rng(seed)
    curve = some_curve(rng)
    places = rng.uniform(0.0, curve.length, 50)
    np.testing.assert_allclose(curve.nearest(curve.poses(places)[:, :3, 3]), places, atol=1e-9)
    np.testing.assert_allclose(curve.poses(curve.s), curve.T, atol=1e-12)
    points = curve.poses(places)[:, :3, 3] + rng.uniform(-0.05, 0.05, (50, 3))
    every = curve.poses(curve.stations(1e-3))[:, :3, 3]
    away = np.linalg.norm(curve.poses(curve.nearest(points))[:, :3, 3] - points, axis=1)
    assert (away <= np.linalg.norm(points[:, None] - every, axis=2).min(axis=1) + 1e-9).all()


@pytest.mark.parametrize("seed", range(20))
def test_a_place_is_a_distance_and_a_turn(seed: int) -> None:
    """Within a piece both grow evenly: the tool goes straight, about a fixed axis."""
    rng = np.random.default_rng(seed)
    curve = some_curve(rng)
    for begin, end in zip(curve.s, curve.s[1:], strict=False):
        a, b = np.sort(rng.uniform(begin, end, 2))
        one, two = curve.poses(np.array([a, b]))
        way = float(np.linalg.norm(two[:3, 3] - one[:3, 3]))
        assert way + PER_TURN * angle_between(one[:3, :3], two[:3, :3]) == pytest.approx(b - a, abs=1e-9)


def test_a_pose_that_is_given_twice_changes_nothing() -> None:
    curve = some_curve(np.random.default_rng(0))
    twice = ToolCurve(frozen(np.repeat(curve.T, 2, axis=0)))
    places = curve.stations(1e-3)
    assert twice.length == pytest.approx(curve.length, abs=1e-12)
    np.testing.assert_allclose(twice.poses(places), curve.poses(places), atol=1e-9)
    np.testing.assert_allclose(twice.nearest(curve.poses(places)[:, :3, 3]), places, atol=1e-9)


@pytest.mark.parametrize("seed", range(10))
def test_a_reversed_curve_has_the_same_poses_from_its_other_end(seed: int) -> None:
    rng = np.random.default_rng(seed)
    curve = some_curve(rng, Freedom({"x": (0.0, 0.1)}), ("rz",))
    back = curve.reversed()
    places = rng.uniform(0.0, curve.length, 40)
    assert back.length == pytest.approx(curve.length, abs=1e-12)
    np.testing.assert_allclose(back.poses(back.length - places), curve.poses(places), atol=1e-9)
    assert np.array_equal(back.T_start, curve.T_end)
    assert np.array_equal(back.T_end, curve.T_start)
    assert (back.freedom, back.free) == (curve.freedom, curve.free)


@pytest.mark.parametrize("step", [0.5, 0.02, 0.008, 0.001])
def test_stations_lead_from_end_to_end_in_equal_steps(step: float) -> None:
    curve = ToolCurve(arc())
    places = curve.stations(step)
    assert (places[0], places[-1]) == (0.0, curve.length)
    steps = np.diff(places)
    assert steps.max() <= step + 1e-12
    assert np.ptp(steps) < 1e-12
    assert len(places) == 2 or steps.max() > 0.5 * step


@pytest.mark.parametrize(("freedom", "free"), FREEDOMS)
@pytest.mark.parametrize("seed", range(4))
def test_there_is_no_deviation_within_what_is_free(
    freedom: Freedom, free: tuple[str, ...], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    curve = some_curve(rng, freedom, free)
    places = rng.uniform(0.0, curve.length, 60)
    tools = curve.placed(places, some_coordinates(rng, curve, 60))
    for fraction in (None, places / curve.length):
        off = curve.deviation(tools, None, fraction)
        assert (off.distance + PER_TURN * off.angle).max() < RESOLUTION
    away, turned = curve.excess(places, tools)
    assert max(away.max(), turned.max()) < 1e-9


@pytest.mark.parametrize(("freedom", "free"), FREEDOMS)
@pytest.mark.parametrize("seed", range(2))
def test_the_deviation_is_the_least_over_all_places(
    freedom: Freedom, free: tuple[str, ...], seed: int
) -> None:
    """Compared with the excess at places 50 um apart."""
    rng = np.random.default_rng(seed)
    curve = some_curve(rng, freedom, free)
    off = rng.uniform(-0.004, 0.004, (12, 6)) * np.array([1.0, 1.0, 1.0, 10.0, 10.0, 10.0])
    places = rng.uniform(0.0, curve.length, 12)
    tools = curve.placed(places, some_coordinates(rng, curve, 12) + off)
    every = curve.stations(5e-5)
    found = curve.deviation(tools)
    for tool, distance, angle in zip(tools, found.distance, found.angle, strict=True):
        away, turned = curve.excess(every, np.broadcast_to(tool, (len(every), 4, 4)))
        assert distance + PER_TURN * angle <= (away + PER_TURN * turned).min() + 5e-5


STRAIGHT = np.stack([transform(t=(0.1, 0.2, 0.3)), transform(t=(0.3, 0.2, 0.3))])


@pytest.mark.parametrize("beyond", [1e-5, 1e-3, 0.02])
def test_a_deviation_is_what_is_beyond_the_limits(beyond: float) -> None:
    """On a line along x: across it, in front of it, tilted and turned."""
    curve = ToolCurve(STRAIGHT, Freedom({"y": (-0.01, 0.02), "rz": (-0.3, 0.5)}, 0.2))
    within = {"y": 0.02, "rx": 0.2 / np.sqrt(2.0), "ry": 0.2 / np.sqrt(2.0), "rz": 0.5}
    names = ("x", "y", "z", "rx", "ry", "rz")
    full = np.array([within.get(name, 0.0) for name in names])

    def off(places: float, change: Array) -> tuple[float, float]:
        found = curve.deviation(curve.placed(np.array([places]), (full + change)[None]))
        return float(found.distance[0]), float(found.angle[0])

    across = np.array([0.0, beyond, 0.0, 0.0, 0.0, 0.0])
    assert off(0.1, across) == pytest.approx((beyond, 0.0), abs=1e-9)
    assert off(0.1, np.roll(across, 1)) == pytest.approx((beyond, 0.0), abs=1e-9)
    assert off(curve.length, np.roll(across, -1)) == pytest.approx((beyond, 0.0), abs=1e-9)
    tilted = np.array([0.0, 0.0, 0.0, beyond, beyond, 0.0]) / np.sqrt(2.0)
    assert off(0.1, tilted) == pytest.approx((0.0, beyond), abs=1e-6)
    assert off(0.1, np.roll(across, -2)) == pytest.approx((0.0, beyond), abs=1e-6)


def test_a_tool_that_turns_on_the_spot_is_on_the_curve() -> None:
    curve = ToolCurve(np.stack([transform(), transform(rot_z(2.0))]))
    off = curve.deviation(curve.poses(np.linspace(0.0, curve.length, 30)))
    assert off.angle.max() < 1e-4
    assert curve.length == pytest.approx(2.0 * PER_TURN)


def test_the_free_directions_of_a_curve() -> None:
    assert directions(ToolCurve(STRAIGHT)) == []
    assert directions(ToolCurve(STRAIGHT, free=("rz",))) == [5]
    assert directions(ToolCurve(STRAIGHT, Freedom({"y": (0.0, 0.1)}, 0.2), ("rz",))) == [1, 3, 4, 5]
    assert directions(ToolCurve(STRAIGHT, Freedom({"x": (0.1, 0.1), "ry": (-0.1, 0.1)}))) == [4]


@pytest.mark.parametrize(
    ("poses", "free", "says"),
    [
        (STRAIGHT[:1], (), "a path of 1 poses: must have at least two different ones"),
        (STRAIGHT[[0, 0, 0]], (), "a path of 3 poses: must have at least two different ones"),
        (STRAIGHT, ("rz", "x"), "free = 'x': on a path only rz"),
        (STRAIGHT, ("rx",), "free = 'rx': .* give it a range or a tilt"),
    ],
)
def test_what_is_no_curve(poses: Array, free: tuple[str, ...], says: str) -> None:
    with pytest.raises(InputError, match=says):
        ToolCurve(frozen(poses), Freedom({}), free)


def test_poses_that_differ_in_their_rotation_alone_are_different() -> None:
    for turn in (rot_x(0.1), rot_y(0.1), rot_z(0.1)):
        assert ToolCurve(np.stack([transform(), transform(turn)])).length == pytest.approx(0.1 * PER_TURN)
