"""What acts on the image and not on the arm changes the corners as a projection with it changed says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.se3 import rotation, transform
from calib.chain.per_image_poses import fit_per_image_poses
from calib.hand_eye.image_effects import (
    BIAS,
    SIZE,
    ImageEffects,
    inwards,
    lens_factor,
    poses_without_bias,
    refined_lens,
)
from calib.model.intrinsics import vector_of
from calib.recordings.arm import ArmRecording
from recorded.arm_sets import LENS, NOMINAL, TARGETS
from vision.camera.projection import Projection

SIGMA = np.array([5.0, 5.0, 8.0, 8.0, 0.02, 0.3, 1e-3, 1e-3, 0.0])
T = np.array([transform(rotation([0.3, 2.9, 0.2 * k]), (0.02 * k, 0.03, 0.8 + 0.1 * k)) for k in range(3)])


def recording(covariance: np.ndarray | None) -> ArmRecording:
    points = TARGETS["charuco"]
    camera = replace(LENS, lens_covariance=covariance)
    return ArmRecording(camera, NOMINAL, points, "charuco", np.zeros((3, 6)), np.zeros((3, len(points), 2)))


def correlated() -> np.ndarray:
    mix = np.eye(9)
    mix[0, 1], mix[4, 5] = 0.95, -0.9
    L = SIGMA[:, None] * mix
    return np.asarray(L @ L.T)


def test_without_a_covariance_the_lens_is_held() -> None:
    effects = ImageEffects.of(recording(None), T)
    assert effects.names == (SIZE, BIAS)
    assert effects.lens.shape == (9, 0)


def test_the_factor_gives_the_covariance_and_holds_what_does_not_vary() -> None:
    C = correlated()
    L = lens_factor(replace(LENS, lens_covariance=C))
    assert L.shape == (9, 8)
    assert np.abs(L @ L.T - C).max() < 1e-9 * C.max()


def test_each_column_is_the_change_of_the_picture() -> None:
    r = recording(correlated())
    effects = ImageEffects.of(r, T)
    before = Projection(r.camera, T, r.points).pixels
    for k in range(effects.lens.shape[1]):
        lens = refined_lens(r.camera, 1e-3 * effects.lens[:, k], np.zeros((9, 9)))
        change = (Projection(lens, T, r.points).pixels - before) / 1e-3
        assert effects.columns[..., k] == pytest.approx(change, abs=2e-3 * np.abs(change).max())
        assert vector_of(lens) == pytest.approx(vector_of(r.camera) + 1e-3 * effects.lens[:, k])
    larger = Projection(r.camera, T, (1.0 + r.size_within) * r.points).pixels - before
    assert effects.columns[..., -2] == pytest.approx(larger, abs=1e-3 * np.abs(larger).max())
    bias = effects.columns[..., -1]
    assert np.linalg.norm(bias, axis=-1) == pytest.approx(r.corners_within)
    assert (np.sum(bias * (before.mean(axis=1, keepdims=True) - before), axis=-1) > 0.0).all()


def biased(px: float) -> ArmRecording:
    """Twelve images with corners that scatter by 0.05 px, and lie inwards of the true ones; one corner is wrong."""
    rng = np.random.default_rng(5)
    turns = [rotation(np.array([0.3, 2.9, 0.0]) + 0.3 * rng.standard_normal(3)) for _ in range(12)]
    poses = np.array([transform(R, (0.01 * k, 0.0, 0.7 + 0.03 * k)) for k, R in enumerate(turns)])
    r = recording(None)
    clean = Projection(r.camera, poses, r.points).pixels
    pixels = clean + px * inwards(clean) + 0.05 * rng.standard_normal(clean.shape)
    pixels[3, 4] += 40.0
    pixels[5, 6] = np.nan
    return replace(r, joints=np.zeros((12, 6)), pixels=pixels)


@pytest.mark.parametrize("px", [0.3, -0.1, 0.0])
def test_the_bias_of_corners_is_no_noise(px: float) -> None:
    r = biased(px)
    alone = poses_without_bias(r)
    assert alone.pixel_sigma == pytest.approx([0.05, 0.05], rel=0.12)
    assert alone.wrong.sum() == 1
    usual = fit_per_image_poses(r.camera, r.points, r.pixels)
    if px:
        assert (usual.pixel_sigma > 1.08 * alone.pixel_sigma).all()
    else:
        assert alone.T_camera_target.tobytes() == usual.T_camera_target.tobytes(), "nothing is taken off"
