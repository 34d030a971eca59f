"""Points of a target and where they were seen."""

from dataclasses import replace

import numpy as np
import pytest

from arm.errors import CalibrationRefused
from arm.se3 import frozen
from calib.hand_eye.calibrate import calibrate_hand_eye
from calib.recordings.points import plausible_numbers
from recorded.arm_sets import TARGETS, draw_truth, recorded, wide


def test_numbers_beyond_belief_are_one_reason():
    rng = np.random.default_rng(12)
    truth = draw_truth(rng)
    recording = recorded(truth, wide(truth, TARGETS["marker"], 20, rng), "marker", rng)
    homed = recording.joints + np.radians([0, 8, -8, 8, 8, 0])
    c = calibrate_hand_eye(replace(recording, joints=frozen(homed))).chain
    assert not c.accepted
    assert sum("at most 5 is plausible, and 3 more such parameters" in reason for reason in c.reasons) == 1
    assert max(map(len, c.reasons)) < 400


def test_a_matrix_that_cannot_be_factored_is_a_refusal():
    with (
        pytest.raises(CalibrationRefused, match=r"\(Singular matrix\): are lengths in m"),
        plausible_numbers(),
    ):
        np.linalg.inv(np.zeros((6, 6)))


@pytest.mark.slow
@pytest.mark.parametrize("scale", [1e-3, pytest.param(1e-6, marks=pytest.mark.slow)])
def test_points_in_another_unit_are_refused(scale, capfd):
    rng = np.random.default_rng(13)
    truth = draw_truth(rng)
    recording = recorded(truth, wide(truth, TARGETS["marker"], 20, rng), "marker", rng)
    try:
        c = calibrate_hand_eye(replace(recording, points=frozen(scale * recording.points))).chain
        accepted, said = c.accepted, " ".join(c.reasons)
    except CalibrationRefused as refused:  # which of the two it is hangs on rounding
        accepted, said = False, str(refused)
    assert not accepted
    assert "are lengths in m" in said or "in m and rad?" in said
    assert capfd.readouterr().out == "", "LAPACK is not asked"
