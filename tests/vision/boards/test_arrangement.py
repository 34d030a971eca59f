"""Markers that are swapped, turned or of another board are named."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.se3 import frozen
from pictures.board_errors import BOARD, CAMERA, TILTS
from pictures.boards import random_pose, seen_corners
from vision.boards.pose import estimate_board_pose
from vision.markers.detect import Marker


def test_swapped_and_turned_markers_are_refused_and_named() -> None:
    for seed, tilt in enumerate(TILTS):
        rng = np.random.default_rng(seed)
        frames = seen_corners(BOARD, random_pose(rng, tilt), CAMERA, rng)
        swapped = [[replace(f[0], id=2), replace(f[1], id=1)] for f in frames]
        with pytest.raises(ImpossibleError, match=r"corners do not fit .*; markers 1 and 2 are swapped"):
            estimate_board_pose(BOARD, swapped, CAMERA)
        for which, quarters in ((0, 1), (1, 2), (1, 3)):
            turned = [
                [
                    replace(m, corners_px=frozen(np.roll(m.corners_px, quarters, axis=0)))
                    if i == which
                    else m
                    for i, m in enumerate(f)
                ]
                for f in frames
            ]
            words = rf"marker {which + 1} is rotated by {90 * quarters} deg"
            with pytest.raises(ImpossibleError, match=words):
                estimate_board_pose(BOARD, turned, CAMERA)


def test_a_marker_of_another_board_is_told_by_where_it_stands() -> None:
    rng = np.random.default_rng(8)
    T = random_pose(rng, 7.0)
    corners = np.array(BOARD.marker_corners())
    corners[1] += (-0.031, 0.012, 0.0)
    px = CAMERA.project_base(corners @ T[:3, :3].T + T[:3, 3])
    frames = [
        [
            Marker(i, frozen(c + 0.1 * rng.standard_normal((4, 2))), "lines")
            for i, c in zip(BOARD.marker_ids, px, strict=True)
        ]
        for _ in range(5)
    ]
    with pytest.raises(ImpossibleError, match=r"marker 2 is at 149, 152 mm from marker 1, not 180, 140 mm"):
        estimate_board_pose(BOARD, frames, CAMERA)


def test_corners_that_no_arrangement_explains_are_refused_without_one() -> None:
    """A second marker a tenth too large stands nowhere on the plate as one of the board's size."""
    rng = np.random.default_rng(9)
    T = random_pose(rng, 7.0)
    corners = np.array(BOARD.marker_corners())
    corners[1] = corners[1].mean(axis=0) + 1.1 * (corners[1] - corners[1].mean(axis=0))
    px = CAMERA.project_base(corners @ T[:3, :3].T + T[:3, 3])
    frames = [[Marker(i, frozen(c), "lines") for i, c in zip(BOARD.marker_ids, px, strict=True)]] * 5
    with pytest.raises(ImpossibleError, match=r"corners do not fit") as refused:
        estimate_board_pose(BOARD, frames, CAMERA)
    assert not re.search("swapped|rotated by|is at", str(refused.value))


@pytest.mark.parametrize(
    ("x", "y", "told"),
    [
        (2.0, 1.0, "with fx 4738 and fy 4738 px they fit"),
        (1.0, 0.92, "with fx 4746 and fy 4746 px they fit"),
        (0.5, 0.5, "with fx 4746 and fy 4738 px they fit"),
    ],
)
def test_a_focal_length_of_other_images_is_told_and_not_the_markers(x: float, y: float, told: str) -> None:
    """The images are those of CAMERA; the camera file has one of its focal lengths wrong, or both of half the size."""
    rng = np.random.default_rng(3)
    frames = seen_corners(BOARD, random_pose(rng, 15.0), CAMERA, rng)
    K = CAMERA.K.copy()
    K[0, 0] *= x
    K[1, 1] *= y
    with pytest.raises(
        ImpossibleError, match=f"corners do not fit .*; {told} .*: is it that of these images"
    ):
        estimate_board_pose(BOARD, frames, replace(CAMERA, K=K))
