"""Poses along outlines: on them, with axes that turn no more and no faster than they must."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from arm.errors import InputError
from arm.se3 import rotation_vector
from cell.program.biarcs import rounded
from cell.program.frames import CHORD_ERROR, LONGEST, TURN, poses_along, smoothed_directions, transported
from cell.program.outline import through
from programs.drawn import SEEDS, some_outline

WIRE_C = through([(0, 0, 0), (0, 0, 0.05), (-0.05, 0, 0.1), (-0.05, -0.05, 0.15), (-0.05, -0.05, 0.2)])


@pytest.mark.few(6)
@pytest.mark.parametrize("seed", SEEDS)
def test_poses_are_rigid_dense_and_on_the_outline(seed: int) -> None:
    outline = rounded(some_outline(seed), 2e-3)
    if len(outline.corners()):
        pytest.skip("a corner that is too sharp to round")
    found = poses_along(outline, None)
    R, at = found.T_work_tool[:, :3, :3], found.T_work_tool[:, :3, 3]
    np.testing.assert_allclose(np.swapaxes(R, 1, 2) @ R, np.tile(np.eye(3), (len(R), 1, 1)), atol=1e-12)
    assert np.linalg.det(R).min() > 0.0
    np.testing.assert_allclose(at, outline.at(found.s), atol=1e-12)
    np.testing.assert_allclose(R[:, :, 2], outline.directions(found.s), atol=1e-9)
    assert np.arccos(np.clip((R[1:, :, 2] * R[:-1, :, 2]).sum(axis=1), -1, 1)).max() <= TURN * (1 + 1e-6)
    assert np.diff(found.s).max() <= LONGEST + 1e-12
    chords = np.diff(at, axis=0)[:, None]
    between = outline.at(np.linspace(found.s[:-1], found.s[1:], 7, axis=1).ravel()).reshape(-1, 7, 3)
    off = np.linalg.norm(np.cross(between - at[:-1, None], chords), axis=2) / np.linalg.norm(chords, axis=2)
    assert off.max() <= CHORD_ERROR * (1 + 1e-6)
    assert not len(found.stops)


@pytest.mark.parametrize("seed", SEEDS)
def test_no_frame_turns_about_its_own_axis(seed: int) -> None:
    """From pose to pose the rotation vector is normal to both z axes."""
    rng = np.random.default_rng([8, seed])
    turning = np.cumsum(rng.normal(0.0, 0.3, (50, 3)), axis=0) + rng.normal(0.0, 5.0, 3)
    z = turning / np.linalg.norm(turning, axis=1)[:, None]
    R = transported(z, rng.normal(size=3))
    for before, after in pairwise(R):
        turned = rotation_vector(after @ before.T)
        assert abs(turned @ before[:, 2]) < 1e-9
        assert abs(turned @ after[:, 2]) < 1e-9


def test_the_axis_turns_over_the_window_about_a_corner_and_nowhere_else() -> None:
    window = 0.02
    found = poses_along(WIRE_C, None, window=window)
    z, corners = found.T_work_tool[:, :3, 2], WIRE_C.joints[1:-1]
    near = np.abs(found.s[:, None] - corners).min(axis=1)
    straight = near > window + 1e-6
    np.testing.assert_allclose(z[straight], WIRE_C.directions(found.s)[straight], atol=1e-9)
    np.testing.assert_allclose(found.stops, corners)
    at = WIRE_C.at(found.s)
    np.testing.assert_allclose(found.T_work_tool[:, :3, 3], at, atol=1e-12)
    h = 1e-5  # the axis turns at a bounded rate: by the corner's angle within twice the window
    s = np.linspace(h, WIRE_C.length - h, 2000)
    rate = np.linalg.norm(
        smoothed_directions(WIRE_C, s + h, window) - smoothed_directions(WIRE_C, s - h, window), axis=1
    )
    assert (rate / (2 * h)).max() <= 1.2 * np.radians(60.0) / (2.0 * window)


def test_the_axis_points_along_against_or_where_it_is_told() -> None:
    straight = through([(0, 0, 0), (0, 0, 0.2)])
    for sign in (1.0, -1.0):
        z = poses_along(straight, None, sign).T_work_tool[:, :3, 2]
        np.testing.assert_allclose(z, np.tile([0, 0, sign], (len(z), 1)))
    fixed = poses_along(WIRE_C, np.array([0.0, 0.0, -1.0]), turn=np.pi / 2)
    R = fixed.T_work_tool[:, :3, :3]
    np.testing.assert_allclose(R, np.tile(R[0], (len(R), 1, 1)))
    np.testing.assert_allclose(R[0, :, 2], [0, 0, -1])
    np.testing.assert_allclose(
        R[0, :, 0], [0, -1, 0], atol=1e-12
    )  # x turned by 90 deg about z, which is down
    assert set(np.round(WIRE_C.joints, 9)) <= set(np.round(fixed.s, 9))


def test_what_cannot_turn_is_refused() -> None:
    with pytest.raises(InputError, match=r"has a corner at 50 mm.*give window_mm"):
        poses_along(WIRE_C, None)
    there_and_back = through([(0, 0, 0), (0, 0, 0.1), (0, 0, 0.01)])
    with pytest.raises(InputError, match=r"turns back on itself at 100 mm, within 20 mm"):
        poses_along(there_and_back, None, window=0.02)
    with pytest.raises(InputError, match="parallel to the first z axis"):
        transported(np.array([[0.0, 0.0, 1.0]]), np.array([0.0, 0.0, 2.0]))
    with pytest.raises(InputError, match="turns by 180 deg at once"):
        transported(np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]), np.array([1.0, 0.0, 0.0]))
