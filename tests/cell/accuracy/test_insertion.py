"""The probability of insertion: against closed forms, and monotonic in what makes it harder."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr

from arm.board import CAPTURE_TILT
from arm.se3 import Array
from cell.accuracy.insertion import PocketFit, insertion_probability

FIT = PocketFit(0.040, 0.044, 0.0)
FEW = 5e-4


def _covariance(**sigmas: float) -> Array:
    names = ("x", "y", "z", "rx", "ry", "yaw")
    return np.diag([sigmas.get(name, 0.0) ** 2 for name in names])


@pytest.mark.parametrize("sigma_mm", [0.3, 0.5, 0.8, 1.0, 1.5])
def test_without_rotation_it_is_the_product_of_both_directions(sigma_mm: float) -> None:
    exact = (2.0 * ndtr(2.0 / sigma_mm) - 1.0) ** 2
    assert insertion_probability(_covariance(x=1e-3 * sigma_mm, y=1e-3 * sigma_mm), FIT) == pytest.approx(
        exact, abs=FEW
    )


@pytest.mark.parametrize("sigma_mm", [0.5, 1.0, 1.5])
def test_errors_that_go_together_count_once(sigma_mm: float) -> None:
    covariance = _covariance(x=1e-3 * sigma_mm, y=1e-3 * sigma_mm)
    covariance[0, 1] = covariance[1, 0] = covariance[0, 0]
    assert insertion_probability(covariance, FIT) == pytest.approx(2.0 * ndtr(2.0 / sigma_mm) - 1.0, abs=FEW)


def test_a_rotated_cube_is_wider() -> None:
    """At 0.1 rad its half section is 20 (cos 0.1 + sin 0.1) = 21.9 mm, so 0.1 mm is left."""
    yaw = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.1])
    left = 0.022 - 0.020 * (np.cos(0.1) + np.sin(0.1))
    exact = 2.0 * ndtr(left / 1e-4) - 1.0
    assert insertion_probability(_covariance(x=1e-4), FIT, yaw) == pytest.approx(exact, abs=FEW)
    assert insertion_probability(_covariance(), FIT, 1.1 * yaw) == 0.0


def test_a_cube_that_leans_too_far_does_not_enter() -> None:
    """Lean is the length of two normal components: a Rayleigh distribution."""
    exact = 1.0 - np.exp(-0.5 * (CAPTURE_TILT / 0.02) ** 2)
    assert insertion_probability(_covariance(rx=0.02, ry=0.02), FIT) == pytest.approx(exact, abs=FEW)


def test_sizes_count_too() -> None:
    """A gap of 4 mm whose standard deviation is 1.6 mm is wider than 0 by 2.5 standard deviations."""
    assert insertion_probability(_covariance(), replace(FIT, sigma=1.6e-3)) == pytest.approx(
        float(ndtr(2.5)), abs=FEW
    )


@pytest.mark.parametrize("seed", range(5))
def test_it_falls_with_every_error_and_has_the_same_bytes(seed: int) -> None:
    root = np.random.default_rng(seed).normal(0.0, 4e-4, (6, 6))
    covariance = root @ root.T
    found = [
        insertion_probability(scale * covariance, replace(FIT, sigma=1e-4)) for scale in (1.0, 2.0, 4.0, 9.0)
    ]
    assert found == sorted(found, reverse=True)
    assert found == [
        insertion_probability(scale * covariance, replace(FIT, sigma=1e-4)) for scale in (1.0, 2.0, 4.0, 9.0)
    ]
