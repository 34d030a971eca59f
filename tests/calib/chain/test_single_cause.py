"""A gear ratio that is off is not taken for errors of the links, and errors of the links not for a gear ratio."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import calib.chain.single_cause as single_cause
from arm.se3 import frozen
from calib.chain.fit import ChainFit
from calib.chain.model_selection import Choice, Part, Trial
from calib.chain.result import ChainCalibration
from calib.chain.single_cause import prefer_single_causes
from calib.hand_eye.calibrate import LINKS, PRINT, calibrate_hand_eye
from calib.hand_eye.image_effects import SIZE
from recorded.arm_sets import TARGETS, draw_truth, recorded, wide
from recorded.faults import faulty


@pytest.fixture(scope="module")
def plain() -> ChainCalibration:
    return calibrate_hand_eye(faulty("J3 geared 0.2 % otherwise", 2, 24, "marker")[0]).chain


def test_a_gear_ratio_is_named_although_links_would_explain_the_images(plain: ChainCalibration) -> None:
    assert not plain.accepted
    cause = plain.hypotheses[0]
    assert (cause.name, cause.sure) == ("scale of J3", True)
    assert cause.amount == pytest.approx(0.002, abs=4.0 * cause.sigma)
    assert (plain.trials[0].needed, plain.trials[0].instead) == (False, "scale of J3")
    assert any("if the scale of J3 is not as given" in remark for remark in plain.remarks)


@pytest.mark.few(1)
@pytest.mark.parametrize(("kind", "needed"), [("marker", True), ("charuco", False)])
def test_whether_the_print_is_in_the_model_is_judged_anew_without_the_links(kind: str, needed: bool) -> None:
    c = calibrate_hand_eye(faulty("J3 geared 0.2 % otherwise", 2, 24, kind)[0]).chain
    assert next(trial for trial in c.trials if trial.part == PRINT).needed == needed
    assert c.problem.free[c.names.index(SIZE)] == needed


def test_errors_of_the_links_stay_errors_of_the_links() -> None:
    rng = np.random.default_rng(2)
    truth = draw_truth(rng, links=True)
    c = calibrate_hand_eye(recorded(truth, wide(truth, TARGETS["marker"], 24, rng), "marker", rng)).chain
    assert (c.trials[0].needed, c.trials[0].instead) == (True, "")


@pytest.fixture
def tried(plain: ChainCalibration, monkeypatch: pytest.MonkeyPatch) -> Callable[[float, float, bool], Trial]:
    """Trial of a part whose 18 unknowns explain a rise, of which a cause explains a part."""

    def trial_of(rise: float, explained: float, known: bool = False) -> Trial:
        def bare(*_: object) -> ChainFit:
            return replace(plain.fit, cost=plain.fit.cost + rise)

        cause = replace(plain.hypotheses[0], drop=explained, limit=20.0)
        monkeypatch.setattr(single_cause, "fit_chains", bare)
        monkeypatch.setattr(single_cause, "find_error_hypotheses", lambda *_: (cause,))
        part = Part(LINKS, tuple(range(18, 36)), known)
        choice = Choice(plain.problem, plain.fit, (Trial(LINKS, rise, 50.0),))
        (trial,) = prefer_single_causes(choice, [part], []).trials
        return trial

    return trial_of


@pytest.mark.parametrize(
    ("rise", "explained", "known", "replaced"),
    [
        (1000.0, 901.0, False, True),
        (1000.0, 899.0, False, False),
        (60.0, 43.0, False, True),
        (60.0, 41.0, False, False),
        (36.0, 19.0, False, False),
        (40.0, 39.0, False, False),
        (1000.0, 901.0, True, False),
    ],
)
def test_a_cause_has_to_explain_nine_tenths_or_all_but_what_chance_does(
    tried: Callable[..., Trial], rise: float, explained: float, known: bool, replaced: bool
) -> None:
    trial = tried(rise, explained, known)
    assert (trial.instead != "") == replaced
    assert trial.rise == pytest.approx(rise - explained if replaced else rise)
    assert trial.needed == (rise > 50.0 and not replaced)


@pytest.mark.slow
def test_a_print_of_another_size_is_in_the_model_again_when_links_stood_in_for_it() -> None:
    """Sway makes links seem needed, and with links the print's size is not: the size is no cause beside the model."""
    rng = np.random.default_rng(3)
    truth = draw_truth(rng)
    joints = wide(truth, TARGETS["charuco"], 24, rng)
    small = truth.pixels(joints, 0.998 * TARGETS["charuco"])
    pixels = small + 0.04 * rng.standard_normal((24, 1, 2)) + 0.13 * rng.standard_normal(small.shape)
    c = calibrate_hand_eye(replace(recorded(truth, joints, "charuco", rng), pixels=frozen(pixels))).chain
    assert c.accepted, c.reasons
    assert [(t.needed, t.instead) for t in c.trials] == [(False, ""), (True, "")]
