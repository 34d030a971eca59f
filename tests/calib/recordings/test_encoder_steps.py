"""Steps of encoders, seen from their readings."""

import numpy as np
import pytest

from calib.recordings.encoder_steps import encoder_sigmas, encoder_step

STEP = np.radians(0.1)


def rounded(seed, step, count=60):
    return np.rint(np.random.default_rng(seed).uniform(-1.0, 1.0, count) / step) * step


@pytest.mark.parametrize("step_deg", [0.02, 0.1, 0.25])
def test_a_step_is_seen(step_deg):
    step = np.radians(step_deg)
    assert encoder_step(rounded(1, step)) == pytest.approx(step, rel=1e-6)


def test_a_step_is_seen_in_readings_that_were_written_with_few_digits():
    assert encoder_step(np.radians(np.round(np.degrees(rounded(2, STEP)), 3))) == pytest.approx(
        STEP, rel=1e-3
    )


def test_no_step_is_seen_in_exact_few_or_commanded_readings():
    assert encoder_step(np.random.default_rng(3).uniform(-1.0, 1.0, 60)) == 0.0
    assert encoder_step(STEP * np.array([1.0, 5.0, 9.0])) == 0.0
    assert encoder_step(rounded(4, np.radians(2.5))) == 0.0, "what is turned by 2.5 deg each time was told to"
    assert encoder_step(rounded(5, np.radians(0.002))) == 0.0, "finer than a pixel"


def test_encoders_of_a_kind_have_one_step():
    columns = np.stack([rounded(6, STEP), rounded(7, 3.0 * STEP), np.zeros(60)], axis=1)
    assert encoder_sigmas([columns]) == pytest.approx([STEP / np.sqrt(12.0)] * 2 + [0.0], rel=1e-6)


def test_a_grid_that_few_columns_have_is_that_of_the_commands():
    exact = np.random.default_rng(8).uniform(-1.0, 1.0, (60, 5))
    assert encoder_sigmas([np.column_stack([rounded(9, STEP), exact])]).tolist() == [0.0] * 6


def test_what_one_chain_does_not_show_another_may():
    one = np.column_stack([rounded(10, STEP), np.zeros(60)])
    other = np.column_stack([np.zeros(60), rounded(11, STEP)])
    assert encoder_sigmas([one, other]) == pytest.approx([STEP / np.sqrt(12.0)] * 2, rel=1e-6)
