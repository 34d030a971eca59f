"""Profiles across a side of a cube's top: what is known of their noise."""

from __future__ import annotations

import numpy as np

from vision.occupancy.cube_side import ACROSS, whitening

PX_PER_M = 1200.0


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
