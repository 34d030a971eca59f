"""Touches of a ring and a wire are counted, timed and located as every millisecond of the motion has them."""

from __future__ import annotations

import numpy as np
import pytest

from arm.robot.shapes import Body, Box, Torus
from arm.robot.tool import FixedTool
from arm.se3 import Array, frozen, rotation, transform
from cell.sim.touches import APART_MS, Touches, TouchJudge, TrueWire

TOOL = FixedTool(
    transform(t=(-0.135, 0.0, 0.013)),
    (
        Body("ring", Torus(0.0348, 0.00583), transform(t=(-0.135, 0.0, 0.013)), "tool"),
        Body("handle", Box((0.08, 0.008, 0.0066)), transform(t=(-0.06, 0.0, 0.013)), "tool"),
    ),
)
RING = [0.060, 0.0696, 0.0066]
WIRE = TrueWire("w", (Body("bar", Box((0.01, 0.01, 0.2)), transform(t=(0.4, 0.1, 0.2)), "work"),))
ON_WIRE = np.array([0.4, 0.1, 0.2])
ROOM = 0.030 - 0.005 * np.sqrt(2.0)  # of the ring on the bar's axis, m


def _moved(places: Array, turned: Array | None = None) -> Array:
    turns = np.zeros((len(places), 3)) if turned is None else turned
    return np.array([transform(rotation(w), ON_WIRE + p) for w, p in zip(turns, places, strict=True)])


def _aside(x: list[float]) -> Array:
    return np.stack([np.array(x), 0.0 * np.array(x), np.linspace(-0.05, 0.05, len(x))], axis=1)


def _judged(T: Array, time_ms: Array | None = None, ring: list[float] | None = RING) -> Touches:
    times = np.arange(1, len(T) + 1) if time_ms is None else time_ms
    return TouchJudge(TOOL, ring, WIRE).judged(T, times.astype(np.int64))


@pytest.mark.slow
def test_a_ring_on_the_axis_of_the_bar_has_the_room_that_its_sizes_say() -> None:
    found = _judged(_moved(_aside([0.0] * 500)))
    assert (found.count, found.seconds) == (0, 0.0)
    assert found.least == pytest.approx(ROOM, abs=2e-5)
    torus = _judged(_moved(_aside([0.0] * 500)), ring=None)
    assert torus.least == pytest.approx(ROOM - 0.030 + 0.0348 - 0.00583, abs=6e-5)


@pytest.mark.parametrize(("pause_ms", "count"), [(APART_MS // 2, 1), (2 * APART_MS, 2)])
def test_a_touch_ends_when_ring_and_wire_have_been_apart_for_some_time(pause_ms: int, count: int) -> None:
    x = [0.0] * 100 + [0.026] * 30 + [0.0] * pause_ms + [0.027] * 40 + [0.0] * 50
    found = _judged(_moved(_aside(x)))
    assert (found.count, found.seconds, found.least) == (count, pytest.approx(0.07), 0.0)
    assert ("touched once" if count == 1 else "touched 2 times") in found.words()


def test_an_arm_that_rests_on_the_wire_touches_it_for_so_long() -> None:
    times = np.concatenate([np.arange(1, 101), np.arange(5101, 5201)])
    found = _judged(_moved(_aside([0.0] * 50 + [0.026] * 60 + [0.0] * 90)), times)
    assert (found.count, found.seconds) == (1, pytest.approx(5.06))


def test_the_handle_touches_too_but_the_least_distance_is_the_rings() -> None:
    beside = _moved(_aside([-0.1] * 20))  # the bar passes through the handle
    found = _judged(beside)
    assert found.count == 1
    assert found.least == pytest.approx(0.1 - 0.0348 - 0.005, abs=1e-4)


@pytest.mark.few(2)
@pytest.mark.parametrize("seed", range(6))
def test_touches_are_those_of_every_millisecond(seed: int) -> None:
    rng = np.random.default_rng([11, seed])
    waves = rng.normal(size=(6, 5)) * np.array([0.02, 0.02, 0.03, 0.3, 0.3, 0.3])[:, None]
    t = np.arange(1200)[:, None] / 1200.0
    way = sum(np.sin(2.0 * np.pi * (k + 1) * t + waves[:, k]) * waves[:, k] for k in range(5))
    T = _moved(way[:, :3], way[:, 3:])
    judge = TouchJudge(TOOL, RING, WIRE)
    every = np.array([judge.distances(one) for one in T])
    found = judge.judged(T, np.arange(1, 1201))
    assert found.seconds == pytest.approx((every[:, 0] <= 0.0).sum() / 1e3)
    assert found.least == pytest.approx(max(every[:, 1].min(), 0.0), abs=1.1e-4)


def test_nothing_is_said_of_an_arm_that_never_moved() -> None:
    found = _judged(np.zeros((0, 4, 4)))
    assert (found.count, found.least, found.to_json()["least_mm"]) == (0, None, None)
    assert "never moved" in found.words()


def test_a_tool_that_is_off_takes_its_frame_and_bodies_along() -> None:
    T = transform(rotation([0.1, 0.2, -0.3]), (0.01, -0.02, 0.005))
    moved = TOOL.moved(T)
    np.testing.assert_allclose(moved.T_flange_tool, T @ TOOL.T_flange_tool, atol=1e-15)
    np.testing.assert_allclose(moved.bodies[1].T_base_body, T @ TOOL.bodies[1].T_base_body, atol=1e-15)
    ring = frozen(np.linalg.inv(moved.T_flange_tool) @ moved.bodies[0].T_base_body)
    np.testing.assert_allclose(ring, np.eye(4), atol=1e-15)
