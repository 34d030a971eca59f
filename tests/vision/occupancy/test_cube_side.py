"""Profiles across a side of a cube's top: their noise, and where the side is found in one that is known exactly."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from vision.occupancy.cube_fit import PIECES, PLACES
from vision.occupancy.cube_side import ACROSS, SPAN, STEP, Beside, Side, evidence, whitening

PX_PER_M = 1200.0
FINE = 20  # samples per STEP of the profile before it is blurred


def test_whitened_profiles_have_independent_noise_and_hidden_samples_hardly_count() -> None:
    n = len(ACROSS)
    level, hidden = np.linspace(60.0, 140.0, n), np.zeros(n)
    plain = whitening(level, hidden, 2.0, PX_PER_M)
    covariance = np.linalg.inv(plain.T @ plain)
    assert np.abs(covariance - covariance.T).max() < 1e-6 * covariance.max()
    samples = np.random.default_rng(3).multivariate_normal(np.zeros(n), covariance, 20000)
    white = np.cov((samples @ plain.T).T)
    assert np.abs(white - np.eye(n)).max() < 0.06
    hidden[n // 2] = 1.0
    part = whitening(level, hidden, 2.0, PX_PER_M)
    one = np.eye(n)[n // 2]
    assert np.linalg.norm(part @ one) ** 2 < 0.9 * np.linalg.norm(plain @ one) ** 2
    assert np.diag(np.linalg.inv(part.T @ part))[n // 2] > 5.0 * covariance[n // 2, n // 2]
    # brighter texture is less certain
    bright = whitening(2.0 * level, np.zeros(n), 2.0, PX_PER_M)
    assert (np.diag(np.linalg.inv(bright.T @ bright)) > np.diag(covariance)).all()


def _seen(light: np.ndarray, blur: float) -> np.ndarray:
    """Samples at `ACROSS` of finely sampled light, blurred."""
    return np.asarray(gaussian_filter1d(light, blur / STEP * FINE, mode="nearest")[::FINE])


@pytest.mark.parametrize("blur", [0.25e-3, 0.4e-3])
@pytest.mark.parametrize("place", [-0.1e-3, 0.05e-3])
@pytest.mark.parametrize("slope", [-16.0, -8.0, 8.0, 16.0])  # grey levels per mm
def test_a_wall_whose_light_slopes_and_ends_at_a_dark_cube_moves_no_side(
    slope: float, place: float, blur: float
) -> None:
    """Light that slopes and ends at an edge, blurred, is not its slope times the blurred edge."""
    fine = np.linspace(-SPAN, SPAN, FINE * (len(ACROSS) - 1) + 1)
    wall = 90.0 + slope * 1e3 * fine
    now = np.where(fine < place, 55.0, 0.75 * wall)
    grey = np.tile(_seen(now, blur), (PIECES, 1))
    white = whitening(grey[0], np.zeros(len(ACROSS)), 0.3, 3300.0)
    side = Side(grey, white, np.zeros(1), 55.0, 150.0)
    empty = np.tile(_seen(wall, blur), (PIECES, 1))
    near = PLACES[np.abs(PLACES - place) < 0.15e-3]
    at = Beside(empty, empty, np.inf, True, 1.0)
    log, _ = evidence(side, at, np.tile(near[:, None], PIECES), blur, np.ones(PIECES, dtype=bool))
    weights = np.exp(log - log.max())
    assert weights @ near / weights.sum() == pytest.approx(place, abs=blur / 35.0)
