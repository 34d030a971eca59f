"""Images of a target that was taken for turned are told from those that are wrong otherwise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from arm.se3 import Array, frozen
from calib.chain.flipped_targets import FITS, flipped_targets
from calib.chain.result import ChainCalibration
from calib.hand_eye.calibrate import calibrate_hand_eye
from recorded.arm_sets import TARGETS, draw_truth, recorded, spoilt, wide

SQUARE = frozen([(0.0, 0.0, 0), (0.06, 0.0, 0), (0.06, 0.06, 0), (0.0, 0.06, 0), (0.03, 0.03, 0)])
"""Counted from a corner, which is not its middle; the last point is."""


@pytest.fixture(scope="module")
def calibration() -> ChainCalibration:
    rng = np.random.default_rng(3)
    truth = draw_truth(rng)
    joints = wide(truth, TARGETS["marker"], 20, rng)
    return calibrate_hand_eye(recorded(truth, joints, "marker", rng)).chain


def pictures(c: ChainCalibration, points: Array, wrong: Sequence[int]) -> tuple[ChainCalibration, Array]:
    """The same poses with a target of other points, its corners where they are expected; and these corners."""
    s = c.problem.sightings[0]
    T = s.evaluate(c.fit.unknowns, np.zeros_like(s.readings)).T
    at = np.einsum("nij,mj->nmi", T[:, :3, :3], points) + T[:, None, :3, 3]
    pixels = c.problem.camera.project(at)
    weights = np.ones(len(pixels))
    weights[list(wrong)] = 0.0
    there = replace(s, points=points, pixels=pixels, noise=np.ones(len(pixels)), effects=None)
    problem = replace(c.problem, sightings=[there], pixel_sigma=np.array([0.3, 0.3]))
    return replace(c, problem=problem, fit=replace(c.fit, weights=(weights,))), pixels


def seen(c: ChainCalibration, pixels: Array) -> ChainCalibration:
    (s,) = c.problem.sightings
    return replace(c, problem=replace(c.problem, sightings=[replace(s, pixels=pixels)]))


QUARTER, HALF = [1, 2, 3, 0, 4], [2, 3, 0, 1, 4]


def test_each_turn_is_told_with_its_own_images(calibration: ChainCalibration) -> None:
    c, pixels = pictures(calibration, SQUARE, range(8))
    for images, order in (([0, 5], QUARTER), ([2], HALF), ([3, 4, 6], np.argsort(QUARTER))):
        pixels[images] = pixels[images][:, order]
    pixels[[1, 7]] = pixels[[7, 1]]
    told = flipped_targets(seen(c, pixels))
    assert set(told) == {90, 180, 270}
    assert told[180] == (2,)
    assert told[90] == (0, 5)  # corner i was taken for the one that a quarter turn brings there
    assert told[270] == (3, 4, 6)


def test_only_images_that_were_left_out_are_told(calibration: ChainCalibration) -> None:
    c, pixels = pictures(calibration, SQUARE, [4])
    pixels[[4, 9]] = pixels[[4, 9]][:, HALF]
    assert flipped_targets(seen(c, pixels)) == {180: (4,)}


def test_corners_that_were_not_seen_do_not_matter(calibration: ChainCalibration) -> None:
    c, pixels = pictures(calibration, SQUARE, [4])
    pixels[4] = pixels[4][HALF]
    pixels[4, [0, 4]] = np.nan
    assert flipped_targets(seen(c, pixels)) == {180: (4,)}


@pytest.mark.parametrize("noise", [1.0, 5.0])
def test_a_turned_image_fits_as_well_as_its_noise_allows(calibration: ChainCalibration, noise: float) -> None:
    c, pixels = pictures(calibration, SQUARE, [4, 5])
    (s,) = c.problem.sightings
    c = replace(
        c,
        problem=replace(
            c.problem,
            pixel_sigma=np.array([0.3, 0.6]),
            sightings=[replace(s, noise=np.where(np.arange(len(pixels)) >= 4, noise, 1.0))],
        ),
    )
    pixels[[4, 5]] = pixels[[4, 5]][:, HALF]
    pixels[4] += 0.95 * FITS * noise * np.array([0.3, -0.6])
    pixels[5] += 1.05 * FITS * noise * np.array([0.3, -0.6])
    assert flipped_targets(seen(c, pixels)) == {180: (4,)}


UNEVEN = frozen(SQUARE + np.array([(0.03, 0.0, 0), (0, 0, 0), (0, 0, 0), (0, 0, 0), (0, 0.01, 0)]))
OBLONG = [(0.05, 0.04, 0), (0.01, 0.04, 0), (0.01, 0.02, 0), (0.05, 0.02, 0)]
"""Inside the square, and meeting itself by half a turn alone."""


@pytest.mark.parametrize(
    ("points", "order"),
    [(UNEVEN, HALF), (frozen([*SQUARE[:4], *OBLONG]), [1, 2, 3, 0, 5, 6, 7, 4])],
    ids=["no corner meets another", "some do"],
)
def test_a_target_that_does_not_meet_itself_is_not_told_as_turned(
    calibration: ChainCalibration, points: Array, order: list[int]
) -> None:
    c, pixels = pictures(calibration, points, [4])
    pixels[4] = pixels[4][order]
    assert flipped_targets(seen(c, pixels)) == {}


@pytest.mark.parametrize(
    ("kind", "turn"), [("marker", 90), pytest.param("charuco", 180, marks=pytest.mark.slow)]
)
def test_turned_targets_are_named_with_their_turn(kind: str, turn: int) -> None:
    rng = np.random.default_rng(6)
    truth = draw_truth(rng)
    recording = recorded(truth, wide(truth, TARGETS[kind], 40, rng), kind, rng)
    turned, wrong = spoilt(recording, 0.15, "turned", rng)
    found = calibrate_hand_eye(turned)
    told = flipped_targets(found.chain)
    assert sorted(sum(told.values(), ())) == wrong.tolist()
    assert set(told) <= {turn, 360 - turn}
    assert any("flipped marker" in remark for remark in found.chain.remarks)
    shifted, _ = spoilt(recording, 0.15, "shifted", rng)
    other = calibrate_hand_eye(shifted)
    assert len(other.chain.wrong[0]) == 6
    assert flipped_targets(other.chain) == {}
    assert not any("flipped" in remark for remark in other.chain.remarks)
