"""The first step of a profile is located, also beside a second one that the lens does not resolve."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ndtr

from arm.se3 import Array
from vision.loose.steps import OFFSETS, first_steps


def _profile(at: float, blur: float = 1.1, gap: float = 2.0, second: float = 0.0) -> Array:
    """A top of 200 that ends at `at` px, something of 120 beyond it, and a second step after `gap` px."""
    clean = 200.0 - 80.0 * ndtr((OFFSETS - at) / blur) + second * ndtr((OFFSETS - at - gap) / blur)
    noise = np.random.default_rng(round(100.0 * (at + gap))).normal(0.0, 0.2, len(OFFSETS))
    return np.asarray(clean + noise)


def test_clean_steps_are_located_to_a_few_hundredths_of_a_pixel() -> None:
    places = np.array([-0.5, -0.1, 0.0, 0.4])
    found, std = first_steps(np.array([_profile(at) for at in places]), np.zeros(4, dtype=np.intp))
    assert np.abs(found - places).max() < 0.05
    assert std.max() < 0.1


@pytest.mark.parametrize("second", [-60.0, 60.0])
@pytest.mark.parametrize("gap", [1.5, 2.5, 4.5])
def test_a_second_step_is_taken_into_account_if_the_blur_is_known_from_another_side(
    gap: float, second: float
) -> None:
    profiles = np.array([_profile(0.2, gap=gap, second=second), _profile(0.0), _profile(0.1)])
    found, std = first_steps(profiles, np.zeros(3, dtype=np.intp))
    assert abs(found[0] - 0.2) < max(3.0 * std[0], 0.1)
    assert std[0] < 0.35


def test_each_group_has_its_own_blur() -> None:
    """A blurred clean step is not taken for two steps because others are sharper."""
    profiles = np.array(
        [_profile(0.0, blur=0.9), _profile(0.0, blur=0.9), _profile(0.0, 1.5), _profile(0.0, 1.5)]
    )
    own = first_steps(profiles, np.array([0, 0, 1, 1]))
    one = first_steps(profiles, np.zeros(4, dtype=np.intp))
    assert np.abs(own[0]).max() < 0.06
    assert own[1].max() < 0.15
    assert max(np.abs(one[0]).max(), one[1].max()) > 0.3
