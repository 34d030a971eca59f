"""Poses of boards from one marker and their outline: as exact as they say, or refused with what was missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from arm.board import Board, Outline
from arm.robot.shapes import Body, Box
from arm.se3 import Array, frozen, transform
from outlined.puzzle import (
    DICTIONARY,
    FOAM_GREY,
    PLAIN,
    PUZZLE,
    Look,
    Made,
    as_designed,
    corners_of,
    lying,
    made,
    picture,
    real_look,
    view_of,
    wire,
)
from pictures.boards import twist_between
from vision.boards.checks import BoardLimits
from vision.boards.outline_pose import assess_with_outline
from vision.boards.pose import BoardAssessment
from vision.camera.model import Camera
from vision.markers.detect import Marker, detect_markers
from vision.markers.edge_profiles import Grey

LIMITS = BoardLimits(height_m=4e-3)
EXACT = replace(PUZZLE, tolerance=1e-4)


@dataclass(frozen=True)
class Shot:
    """A drawn picture, where the board is in it, and its markers."""

    camera: Camera
    image: Grey
    T: Array
    frame: list[Marker]

    def assessed(self, frame: Sequence[Marker], board: Board = EXACT) -> BoardAssessment:
        return assess_with_outline(board, [frame], self.image, self.camera, DICTIONARY, LIMITS)


def shot(
    seed: int,
    tilt: float,
    one: Made | None = None,
    look: Look = PLAIN,
    bodies: Sequence[Body] = (),
    foam_grey: float = FOAM_GREY,
) -> Shot:
    rng = np.random.default_rng(seed)
    T = lying((0.46, rng.uniform(-0.1, 0.1), 0.034), rng.uniform(-180, 180), tilt, rng.uniform(-180, 180))
    camera = view_of(corners_of(T))
    there = [replace(b, T_base_body=T @ b.T_base_body) for b in bodies]
    image = picture(camera, [(one or as_designed(), T)], look, rng, there, foam_grey)
    frame = detect_markers(image, camera, DICTIONARY)
    return Shot(camera, np.asarray(image, dtype=np.float32), T, frame)


def over(name: str, x: float, y: float, width: float, height: float) -> Body:
    """A bar just above the board, in its frame."""
    return Body(name, Box((width, height, 0.002)), transform(t=(x, y, 0.004)), "wire")


@pytest.mark.parametrize(
    ("seed", "tilt"),
    [(3, 15.0), *(pytest.param(*of, marks=pytest.mark.slow) for of in ((1, 0.0), (2, 7.0), (4, 20.0)))],
)
def test_a_pose_from_one_marker_is_off_by_what_it_says(seed: int, tilt: float) -> None:
    """Of boards as reality has them, in bad light, with either marker."""
    rng = np.random.default_rng(seed)
    taken = shot(seed, tilt, made(EXACT, rng), real_look(rng))
    assert [m.id for m in taken.frame] == [1, 2]
    for marker in taken.frame:
        seen = taken.assessed([marker])
        assert seen.pose is not None
        assert all("uncertain" in str(doubt) for doubt in seen.doubts)
        twist = twist_between(seen.pose.T_base_board, taken.T)
        assert twist @ np.linalg.solve(seen.pose.covariance, twist) < 22.5  # chi-square with 6, 0.1 %
        again = seen.pose.repeatability
        assert again is not None
        assert np.linalg.eigvalsh(seen.pose.covariance - again).min() > 0.0


def test_a_marker_behind_a_wire_is_no_longer_missed() -> None:
    bodies = [replace(b, T_base_body=b.T_base_body) for b in wire("c", np.eye(4))]
    cover = over("bar", 0.075, -0.075, 0.02, 0.044)
    taken = shot(7, 7.0, bodies=[*bodies, cover])
    assert [m.id for m in taken.frame] == [1]
    seen = taken.assessed(taken.frame)
    assert seen.accepted
    assert seen.pose is not None
    assert np.linalg.norm(twist_between(seen.pose.T_base_board, taken.T)[3:]) < np.radians(1.5)


@pytest.mark.slow
def test_both_markers_with_the_outline_are_more_certain_than_one() -> None:
    taken = shot(3, 7.0)
    both = taken.assessed(taken.frame).pose
    assert both is not None
    for marker in taken.frame:
        one = taken.assessed([marker]).pose
        assert one is not None
        assert np.trace(both.covariance[3:, 3:]) < 0.9 * np.trace(one.covariance[3:, 3:])
    twist = twist_between(both.T_base_board, taken.T)
    assert twist @ np.linalg.solve(both.covariance, twist) < 22.5


def test_a_board_without_tolerance_has_a_pose_from_corners_of_unknown_light() -> None:
    taken = shot(3, 7.0)
    bare = replace(taken.frame[0], side_sigma_px=None, noise=None)
    pose = taken.assessed([bare], replace(EXACT, tolerance=0.0)).pose
    assert pose is not None
    assert np.linalg.norm(twist_between(pose.T_base_board, taken.T)[3:]) < np.radians(2.0)


@pytest.mark.slow
def test_a_less_exact_outline_leaves_the_pose_less_certain() -> None:
    taken, spreads = shot(3, 7.0), []
    for within in (1e-4, 5e-4, 2e-3):
        board = replace(EXACT, outline=Outline(_corners(EXACT), within))
        pose = taken.assessed(taken.frame[:1], board).pose
        assert pose is not None
        spreads.append(np.trace(pose.covariance[3:, 3:]))
    assert spreads[0] < spreads[1] < spreads[2]


def _corners(board: Board) -> tuple[tuple[float, float], ...]:
    assert board.outline is not None
    return board.outline.corners


def test_too_little_of_the_outline_is_refused_with_what_shows() -> None:
    """Bars over the left, bottom and right side, beside marker 1, which stays whole."""
    bars = [
        over("left", -0.025, -0.06, 0.012, 0.072),
        over("bottom", 0.037, -0.1, 0.125, 0.02),
        over("right", 0.1, -0.04, 0.02, 0.13),
    ]
    taken = shot(5, 7.0, bodies=bars)
    assert [m.id for m in taken.frame] == [1]
    (doubt,) = taken.assessed(taken.frame).doubts
    assert "its outline does not confirm the pose from marker 1 alone: of its sides show top" in str(doubt)
    assert "\n" not in str(doubt)
    assert doubt.data["seen"]["top"] > 0.9
    assert max(doubt.data["seen"].get(name, 0.0) for name in ("right", "bottom")) < 0.5


def test_a_board_as_bright_as_the_foam_is_refused() -> None:
    taken = shot(5, 7.0, foam_grey=235.0)
    (doubt,) = taken.assessed(taken.frame[:1]).doubts
    assert "does not confirm" in str(doubt)


@pytest.mark.few(1)
@pytest.mark.parametrize("larger", [-2.5e-3, 2.5e-3])
def test_a_plate_of_another_size_is_refused_with_the_side_that_is_off(larger: float) -> None:
    one = as_designed()
    middle = one.outline.mean(axis=0)
    other = replace(one, outline=middle + (1.0 + larger / 0.125) * (one.outline - middle))
    taken = shot(6, 7.0, other)
    for marker in taken.frame:
        (doubt,) = taken.assessed([marker]).doubts
        assert f"marker {marker.id} alone and the outline do not fit one board" in str(doubt)
        assert doubt.data["side"] in ("top", "right", "bottom", "left")


def test_markers_that_are_not_whole_move_or_show_twice_are_refused() -> None:
    taken = shot(3, 7.0)
    marker = taken.frame[0]
    cases = (
        ([[replace(marker, method="subpix")]], "all four borders of marker 1 show in 0 of 1 images"),
        (
            [[marker], [replace(marker, corners_px=frozen(marker.corners_px + 7.0))]],
            "the board moved between images",
        ),
        (
            [[marker, replace(marker, corners_px=frozen(marker.corners_px + 300.0))]],
            "marker 1 is in view twice",
        ),
    )
    for frames, words in cases:
        seen = assess_with_outline(EXACT, frames, taken.image, taken.camera, DICTIONARY)
        assert seen.pose is None
        assert words in str(seen.doubts[0])


def test_tilts_are_compared_and_change_nothing() -> None:
    taken = shot(3, 7.0)
    plain, told = (
        assess_with_outline(
            EXACT, [taken.frame[:1]], taken.image, taken.camera, DICTIONARY, LIMITS, tilts
        ).pose
        for tilts in ((), tuple(np.radians((0.0, 7.0))))
    )
    assert plain is not None
    assert told is not None
    assert np.array_equal(plain.T_base_board, told.T_base_board)
    assert told.tilt_hypothesis is not None
    assert told.tilt_hypothesis.nearest == pytest.approx(np.radians(7.0))
