"""Straight lines of the tool, and how far poses are from them."""

from __future__ import annotations

import numpy as np
import pytest

from arm.se3 import Array, rotation, transform
from plan.kinematics.straight_line import Line


def _lines(count: int) -> list[Line]:
    rng = np.random.default_rng(3)
    ends = [transform(rotation(rng.normal(size=3)), rng.uniform(-0.5, 0.5, 3)) for _ in range(2 * count)]
    return [Line(a, b) for a, b in zip(ends[::2], ends[1::2], strict=True)]


def _off(T: Array, shift: Array, turn: Array) -> Array:
    """Poses displaced in the base frame and turned in their own."""
    return np.array([transform(t[:3, :3] @ rotation(turn), t[:3, 3] + shift) for t in T])


@pytest.mark.parametrize("line", _lines(5))
def test_poses_begin_and_end_at_the_ends_and_are_on_the_line(line: Line) -> None:
    u = np.linspace(0.0, 1.0, 9)
    T = line.poses(u)
    assert np.abs(T[[0, -1]] - [line.T_start, line.T_end]).max() < 1e-12
    steps = np.linalg.norm(np.diff(T[:, :3, 3], axis=0), axis=1)
    assert steps == pytest.approx(line.length / 8.0)
    off = line.deviation(T)
    assert off.distance.max() < 1e-12
    assert off.angle.max() < 1e-7


@pytest.mark.parametrize("line", _lines(5))
def test_a_deviation_is_the_shift_across_and_the_turn(line: Line) -> None:
    u = np.linspace(0.2, 0.8, 5)
    along = (line.T_end[:3, 3] - line.T_start[:3, 3]) / line.length
    across = np.cross(along, [0.0, 0.0, 1.0])
    across *= 1e-3 / np.linalg.norm(across)
    off = line.deviation(_off(line.poses(u), across, np.array([0.0, 0.02, 0.0])), fraction=u)
    assert off.distance == pytest.approx(1e-3)
    assert off.angle == pytest.approx(0.02)
    nearest = line.deviation(_off(line.poses(u), across, np.zeros(3)))
    assert nearest.distance == pytest.approx(1e-3)


@pytest.mark.parametrize("line", _lines(3))
def test_a_turn_about_the_free_axis_is_no_deviation(line: Line) -> None:
    u = np.linspace(0.0, 1.0, 5)
    T = _off(line.poses(u), np.zeros(3), np.array([0.0, 0.0, 0.7]))
    assert line.deviation(T, free_axis="z", fraction=u).angle.max() < 1e-7
    assert line.deviation(T, free_axis="x", fraction=u).angle == pytest.approx(0.7)
    # two free axes: only the turn about the third counts, by the rotation vector; three: none does
    turned = _off(line.poses(u), np.zeros(3), np.array([0.5, -0.2, 0.4]))
    assert line.deviation(turned, free_axis="xy", fraction=u).angle == pytest.approx(0.4)
    assert line.deviation(turned, free_axis="xz", fraction=u).angle == pytest.approx(0.2)
    assert line.deviation(turned, free_axis="xyz", fraction=u).angle.max() == 0.0
