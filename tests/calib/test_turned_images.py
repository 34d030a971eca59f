"""Images of a target that was taken for turned are told from those that are wrong otherwise."""

from __future__ import annotations

import numpy as np
import pytest

from arm_sets import TARGETS, draw_truth, recorded, spoilt, wide
from calib.hand_eye import calibrate_hand_eye
from calib.turned_images import turned_images


@pytest.mark.parametrize(("kind", "turn"), [("marker", 90), ("charuco", 180)])
def test_turned_targets_are_named_with_their_turn(kind: str, turn: int) -> None:
    rng = np.random.default_rng(6)
    truth = draw_truth(rng)
    recording = recorded(truth, wide(truth, TARGETS[kind], 40, rng), kind, rng)
    turned, wrong = spoilt(recording, 0.15, "turned", rng)
    found = calibrate_hand_eye(turned)
    told = turned_images(found.chain)
    assert sum(told.values(), ()) == tuple(wrong) or sorted(sum(told.values(), ())) == sorted(wrong)
    assert set(told) <= {turn, 360 - turn}
    assert any("flipped marker" in remark for remark in found.chain.remarks)
    shifted, _ = spoilt(recording, 0.15, "shifted", rng)
    other = calibrate_hand_eye(shifted)
    assert len(other.chain.wrong[0]) == 6
    assert turned_images(other.chain) == {}
    assert not any("flipped" in remark for remark in other.chain.remarks)
