"""Score tests of what may be wrong with a chain: the cause is named, and nothing where nothing is wrong."""

import numpy as np
import pytest

from calib.chain.score_tests import sudden_change
from calib.chain.verdict import describe
from calib.hand_eye.calibrate import calibrate_hand_eye
from recorded.arm_sets import TARGETS, draw_truth, recorded, wide
from recorded.faults import FAULTS, faulty


@pytest.mark.slow
@pytest.mark.parametrize("name", list(FAULTS))
def test_the_cause_is_named(name):
    recording, truth = faulty(name)
    c = calibrate_hand_eye(recording).chain
    hypothesis = c.hypotheses[0]
    assert hypothesis.sure
    assert hypothesis.name == FAULTS[name][1]
    told = describe(hypothesis)
    assert told in " ".join((*c.reasons, *c.remarks))
    s = c.problem.sightings[0]
    T = s.evaluate(c.fit.unknowns).T
    off = np.sqrt(np.mean(np.sum((T - truth.T_camera_target(recording.joints))[:, :3, 3] ** 2, axis=1)))
    if c.accepted:
        assert off < 1.1 * c.limits.held_out, "accepted only if targets are where they are predicted"
    if "moved" in hypothesis.name:
        assert not c.accepted
        assert hypothesis.image == pytest.approx(15, abs=3)
        assert hypothesis.amount == pytest.approx(1e-3, rel=0.25)
    elif "geared" in name:
        assert hypothesis.amount == pytest.approx(0.002, abs=4.0 * hypothesis.sigma)
    elif "larger" in name:
        assert not c.accepted, "no residual shows it, and all is a hundredth too near"
        assert hypothesis.amount == pytest.approx(0.01, abs=1e-3)
        assert off < 1e-4 or hypothesis.moves == pytest.approx(off, rel=0.1), "estimated, or its error told"


@pytest.mark.parametrize(
    ("kind", "seed"),
    [
        ("marker", 0),
        *(
            pytest.param(*of, marks=pytest.mark.slow)
            for of in (("charuco", 0), ("charuco", 1), ("charuco", 2), ("marker", 1), ("marker", 2))
        ),
    ],
)
def test_nothing_is_suspected_of_what_is_complete(kind, seed):
    rng = np.random.default_rng([seed, 4])
    truth = draw_truth(rng, links=seed == 2)
    c = calibrate_hand_eye(recorded(truth, wide(truth, TARGETS[kind], 24, rng), kind, rng)).chain
    assert c.accepted, c.reasons
    assert not [s.name for s in c.hypotheses if s.sure]
    assert c.change is None
    assert not any("worth a look" in remark for remark in c.remarks)


def test_a_change_is_told_from_wrong_images_that_are_strewn():
    wrong = np.zeros(40, dtype=bool)
    assert sudden_change(wrong) is None
    assert sudden_change(wrong[:1]) is None
    wrong[23:] = True
    assert sudden_change(wrong) == 23
    assert sudden_change(~wrong) == 23
    wrong[[25, 31]] = False
    wrong[4] = True
    assert sudden_change(wrong) == 23
    for seed in range(200):
        assert sudden_change(np.random.default_rng(seed).random(40) < 0.3) is None
