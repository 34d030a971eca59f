"""The tilts of the stands are a hypothesis: told, asked where photographs do not decide, never a pose of their own."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from arm.poses import BoardPose
from arm.se3 import Array, frozen, rotation, transform
from cell.commands.look_recorded import detections_step
from cell.console import Console
from pictures.boards import lab_board, lab_camera, leaning, random_pose, seen_corners, twist_between
from recorded.sets import recorded_set
from typed.command_line import replace_in
from vision.boards.pose import BoardAssessment, assess_board
from vision.boards.pose_fit import planar_poses
from vision.boards.tilt_prior import ANYWHERE, MOST_SAY, log_odds_of_tilts, tilt_hypothesis
from vision.markers.detect import Marker

CAMERA, BOARD = lab_camera(), lab_board()
SET = tuple(np.radians((0.0, 7.0, 15.0)))
STD = np.radians(0.3)


def standing(tilt_deg: float, azimuth_deg: float = 20.0, std: float = STD) -> BoardPose:
    T = leaning((0.44, 0.0, 0.05), 30.0, tilt_deg, azimuth_deg)
    return BoardPose(BOARD, T, frozen(np.diag([1e-8] * 3 + [std**2] * 3)), 0.1, 10.0)


@pytest.mark.parametrize(
    ("tilt_deg", "nearest_deg", "fits"),
    [(0.0, 0, True), (0.4, 0, True), (6.5, 7, True), (15.6, 15, True), (11.0, 7, False), (3.5, 0, False)],
)
def test_which_member_fits(tilt_deg: float, nearest_deg: float, fits: bool) -> None:
    for azimuth in (0.0, 77.0, 180.0):
        told = tilt_hypothesis(standing(tilt_deg, azimuth), SET)
        assert told.fits == fits
        assert (told.probability > 0.8) == fits
        assert told.z == pytest.approx((tilt_deg - np.degrees(told.nearest)) / np.hypot(0.3, 0.5), abs=1e-6)
        if fits:
            assert np.degrees(told.nearest) == pytest.approx(nearest_deg)


def test_densities_integrate_to_one() -> None:
    """Over the plane of tilt vectors: that of any member, by the log odds against an even plane."""
    from vision.boards import tilt_prior as tilt_set

    angles = np.radians(np.arange(0.005, 40.0, 0.01))
    for tilt in SET:
        values = [np.exp(tilt_set._Tilt(a, STD**2, STD**2).log_density(tilt)) for a in angles]
        assert np.sum(2.0 * np.pi * angles * values) * np.radians(0.01) == pytest.approx(1.0, rel=2e-3)
    assert 0.0 < ANYWHERE < 1.0


def test_what_the_set_says_is_bounded_and_turns_with_the_order() -> None:
    a, b = standing(7.0), standing(11.0)
    assert log_odds_of_tilts(a, b, SET) == pytest.approx(MOST_SAY)
    assert log_odds_of_tilts(b, a, SET) == pytest.approx(-MOST_SAY)
    assert log_odds_of_tilts(standing(11.0), standing(10.0), SET) == pytest.approx(0.0, abs=0.05)
    wide = log_odds_of_tilts(standing(7.0, std=np.radians(8.0)), standing(10.0, std=np.radians(8.0)), SET)
    assert 0.0 < wide < 0.5 * MOST_SAY


@pytest.mark.few(1)
@pytest.mark.parametrize("tilt_deg", [0.0, 4.0, 7.0, 11.0, 15.0])
def test_no_pose_changes_and_no_board_is_refused_because_of_the_set(tilt_deg: float) -> None:
    for seed in range(25):
        rng = np.random.default_rng(seed)
        T = random_pose(rng, tilt_deg)
        frames = seen_corners(BOARD, T, CAMERA, rng)
        free, asked = assess_board(BOARD, frames, CAMERA), assess_board(BOARD, frames, CAMERA, tilts=SET)
        assert free.pose is not None
        assert asked.pose is not None
        assert np.array_equal(free.pose.T_base_board, asked.pose.T_base_board)
        assert np.array_equal(free.pose.covariance, asked.pose.covariance)
        assert [str(d) for d in free.doubts] == [str(d) for d in asked.doubts]
        assert free.pose.tilt_hypothesis is None
        assert asked.pose.tilt_hypothesis is not None
        assert asked.pose.tilt_hypothesis.fits == (tilt_deg in (0.0, 7.0, 15.0))


TOWARDS = rotation(np.radians([0.0, 20.0, 0.0])) @ CAMERA.T_base_camera[:3, :3]
FAR = CAMERA.at(transform(TOWARDS, np.array([0.44, 0.0, 0.05]) - 8.0 * TOWARDS[:, 2]))


def between(T: Array, seed: int, share: float) -> list[list[Marker]]:
    """Corners seen from 8 m and 20 deg aside, between a board at T (share 0) and its mirrored solution (share 1)."""
    points = BOARD.marker_corners().reshape(8, 3)
    exact = FAR.project_base(points @ T[:3, :3].T + T[:3, 3])
    mirrored = planar_poses(exact, points, FAR)[1]
    other = FAR.project(points @ mirrored[:3, :3].T + mirrored[:3, 3])
    noise = 0.02 * np.random.default_rng(seed).standard_normal((3, 8, 2))
    corners = (1.0 - share) * exact + share * other + noise
    ids = BOARD.marker_ids
    return [
        [Marker(i, frozen(c), "lines") for i, c in zip(ids, f.reshape(2, 4, 2), strict=True)] for f in corners
    ]


def turned_by(a: BoardAssessment, T: Array) -> float:
    assert a.pose is not None
    return float(np.degrees(np.linalg.norm(twist_between(a.pose.T_base_board, T)[3:])))


def is_ambiguous(seen: BoardAssessment) -> bool:
    return any("its tilt cannot be distinguished" in str(d) for d in seen.doubts)


@pytest.mark.slow
@pytest.mark.parametrize("tilt_deg", [15.0, pytest.param(11.0, marks=pytest.mark.slow)])
def test_the_set_is_asked_where_photographs_do_not_decide(tilt_deg: float) -> None:
    """It can decide for a board of the set, but accepts no board the other way round than photographs alone have it.

    Seen from straight above, a mirrored board has the same tilt, and the set says nothing.
    """
    chosen = decided = 0
    for seed in range(12):
        T = leaning((0.44, 0.0, 0.05), 30.0 * seed, tilt_deg, 90.0 + seed)
        for share in (0.2, 0.4, 0.45, 0.5, 0.55, 0.6, 0.8):
            frames = between(T, seed, share)
            free, asked = assess_board(BOARD, frames, FAR), assess_board(BOARD, frames, FAR, tilts=SET)
            chosen += turned_by(asked, T) < 6.0 < turned_by(free, T)
            decided += is_ambiguous(free) and not is_ambiguous(asked)
            assert is_ambiguous(free) or not is_ambiguous(asked)
            if not is_ambiguous(asked):
                assert np.array_equal(free.pose.T_base_board, asked.pose.T_base_board)
    if tilt_deg == 15.0:
        assert chosen >= 3
        assert decided >= 3


def test_look_tells_the_member(tmp_path: Path, scenes: Path) -> None:
    shown = []
    for seed, tilt in enumerate((7.0, 11.0)):
        rng = np.random.default_rng(seed)
        T = random_pose(rng, tilt)
        shown.append((seen_corners(BOARD, T, CAMERA, rng, noise_px=0.05), T))
    content = recorded_set(BOARD, CAMERA, shown, 0.05)
    file = tmp_path / "set.json"
    file.write_text(json.dumps(content))
    seven, eleven = (
        s["boards"][0] for s in detections_step(file, scenes / "task2.toml", None, Console(True))["scenes"]
    )
    assert seven["verdict"] == eleven["verdict"] == "accepted"
    assert seven["tilt_hypothesis"]["nearest_deg"] == pytest.approx(7.0)
    assert seven["tilt_hypothesis"]["fits"] is True
    assert seven["tilt_deg"] == pytest.approx(7.0, abs=0.3)
    assert eleven["tilt_deg"] == pytest.approx(11.0, abs=0.3)
    assert eleven["tilt_hypothesis"]["fits"] is False
    assert abs(eleven["tilt_hypothesis"]["z"]) > 3.0
    alone = detections_step(file, None, None, Console(True))["scenes"][0]["boards"][0]
    assert alone["tilt_hypothesis"] is None
    replace_in(scenes / "cell.toml", "# least_certain_deg = 1.0", "least_certain_deg = 0.01")
    refused = detections_step(file, scenes / "task2.toml", None, Console(True))["scenes"][0]["boards"][0]
    assert refused["verdict"] == "refused"
    assert "too uncertain to grasp" in refused["reasons"][0]
