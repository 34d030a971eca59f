"""Whether an arm scatters, or a single cause explains why its images disagree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.se3 import Array
from calib.chain.result import ChainCalibration, scatters
from calib.hand_eye.calibrate import calibrate_hand_eye
from recorded.arm_sets import TARGETS, draw_truth, recorded, wide


@pytest.fixture(scope="module")
def plain() -> ChainCalibration:
    rng = np.random.default_rng(12)
    truth = draw_truth(rng)
    return calibrate_hand_eye(recorded(truth, wide(truth, TARGETS["charuco"], 24, rng), "charuco", rng)).chain


def test_a_cause_that_explains_the_images_that_are_left_does_not_explain_the_others(
    plain: ChainCalibration,
) -> None:
    n = len(plain.problem.sightings[0].readings)
    cost = plain.fit.cost + 20.0 * plain.fit.freedom
    cause = replace(plain.hypotheses[0], drop=cost - plain.fit.cost, amount=1e-3, limit=1.0, image=-1)

    def judged(used: Array, change: int | None) -> bool:
        fit = replace(plain.fit, cost=cost, weights=(used.astype(float),))
        return scatters(replace(plain, fit=fit, hypotheses=(cause,), change=change))

    assert not scatters(plain)
    few = np.arange(n) > n // 10 - 1
    assert not judged(np.ones(n, dtype=bool), None), "the cause explains all"
    assert not judged(few, None), "wrong detections"
    few[5] = False
    assert judged(few, None)
    every_other = np.arange(n) % 2 == 0
    assert judged(every_other, None)
    assert not judged(np.arange(n) < n // 2, n // 2), "one half does not fit the other: something moved"
