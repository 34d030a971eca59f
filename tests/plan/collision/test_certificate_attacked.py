"""Proofs under attack: motions put so that they graze, each held against dense sampling (see bench/certificate.py)."""

from __future__ import annotations

import numpy as np
import pytest

from arms.grazing import NEAR, Case, dense, draw
from plan.collision.certificate import RESOLUTION, ClearanceCertificate, certify_curve
from plan.collision.world import DISTANCE_ERROR

CASES = 300
DENSER = 20
LEAST_SAMPLES = 60  # the campaign takes more
TOLERANCE = 1e-6  # m, of the distances that both sides rest on


def wrong(case: Case, checks: dict[str, ClearanceCertificate], least: np.ndarray) -> list[str]:
    """What contradicts the smallest distances that were sampled on each cubic."""
    # how deep bodies overlap is no matter: whatever is below 0 states nothing
    least = np.maximum(least, 0.0)
    found, truth, asked = [], float(least.min()), case.clearance
    for mode, check in checks.items():
        if not check.clearance <= truth + TOLERANCE:
            found.append(f"{mode} bound above the truth")
        if not (np.array(check.bounds) <= least + TOLERANCE).all() or len(check.bounds) != len(least):
            found.append(f"{mode} bound of a cubic above its truth")
        if check.proved and truth < asked - TOLERANCE:
            found.append(f"{mode} proves too much")
        if not check.proved and truth > asked + RESOLUTION + 2 * DISTANCE_ERROR + TOLERANCE:
            found.append(f"{mode} proves too little")
    return found


@pytest.mark.slow
def test_grazing_motions_are_bounded_from_below_and_judged_right() -> None:
    gaps, near, proved, grazing = [], [], 0, 0
    for seed in range(CASES):
        case = draw(seed)
        checks = {
            "tight": certify_curve(case.world, case.curve, case.clearance, tight=True),
            "decide": certify_curve(case.world, case.curve, case.clearance),
        }
        looked = max(check.evaluations for check in checks.values())
        least = dense(case.world, case.curve, max(LEAST_SAMPLES, DENSER * looked), zooms=2)
        assert not wrong(case, checks, least), (seed, case.kind)
        truth = float(least.min())
        proved += checks["decide"].proved
        grazing += NEAR[0] - 1e-4 <= truth - case.clearance <= NEAR[1] + 1e-4
        if truth > 0.0:
            gaps.append(truth - checks["tight"].clearance)
            near.append(gaps[-1] <= max(1e-3, 0.2 * truth))
    assert grazing > 0.8 * CASES
    assert 0.4 * CASES < proved < 0.8 * CASES  # both verdicts are put to the test
    assert np.median(gaps) < 5e-4
    assert np.mean(near) > 0.95
