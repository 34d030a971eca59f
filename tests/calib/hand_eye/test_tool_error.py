"""The predicted error of the tool in the holes is what camera and arm together really miss by."""

from __future__ import annotations

import numpy as np
import pytest

from arm.se3 import apply, inverse
from calib.hand_eye.calibrate import calibrate_hand_eye
from calib.hand_eye.chain import OFFSETS, arm_chain
from calib.hand_eye.result import HandEye
from calib.hand_eye.tool_error import TOOL, _pointing_down, image_holes, tool_error
from recorded.arm_sets import NOMINAL, TARGETS, Truth, draw_truth, recorded, wide

HOLES = np.array([(0.4, 0.1, 0.05), (0.45, -0.12, 0.1), (0.55, 0.0, 0.03)])


def drawn(links: bool) -> tuple[HandEye, Truth]:
    rng = np.random.default_rng([41, links])
    truth = draw_truth(rng, links=links)
    return calibrate_hand_eye(
        recorded(truth, wide(truth, TARGETS["charuco"], 24, rng), "charuco", rng)
    ), truth


@pytest.mark.few(1)
@pytest.mark.parametrize("links", [False, True])
def test_the_tool_misses_by_what_is_told(links: bool) -> None:
    found, truth = drawn(links)
    told = tool_error(found, HOLES)
    assert told.holes == len(HOLES)
    assert told.scatter == 0.0
    misses = []
    beyond = np.array([(3.0, 0.0, 0.05)])
    joints, reached = _pointing_down(found, np.concatenate([beyond, HOLES]), TOOL)
    assert reached.tolist() == [1, 2, 3]
    for hole, q in zip(HOLES, joints, strict=True):
        at = arm_chain(NOMINAL, np.eye(4), TOOL).evaluate(q[None], np.zeros(OFFSETS + 24)).T[0]
        assert at[:3, 3] == pytest.approx(hole, abs=2e-4)
        assert at[:3, 2] == pytest.approx([0.0, 0.0, -1.0], abs=3e-4)
        x = np.zeros(OFFSETS + 24)
        x[OFFSETS:] = np.concatenate([found.joint_offsets, *found.link_errors])
        believed = arm_chain(NOMINAL, np.eye(4), TOOL).evaluate(q[None], x).T[0, :3, 3]
        true = (truth.T_base_gripper(q[None]) @ TOOL)[0, :3, 3]
        assert believed == pytest.approx(hole, abs=0.02), "the arm's own errors move it a little"
        seen = apply(found.T_base_camera, apply(inverse(truth.T_base_camera), hole))
        misses.append((seen - hole) - (believed - true))
    off = np.abs(np.array(misses))
    assert np.linalg.norm(off[:, :2], axis=1).max() < 4.0 * told.sideways
    assert off[:, 2].max() < 4.0 * told.height
    assert max(told.sideways, told.height) < (1.5e-3 if links else 0.2e-3)
    assert (told.parts["links"] > 0.5) == links


def test_the_camera_sees_the_holes_that_are_looked_at_by_default() -> None:
    found, _ = drawn(False)
    holes = image_holes(found)
    assert set(np.round(holes[:, 2], 6)) == {0.03, 0.1}
    pixels = found.camera.project_base(holes)
    assert ((pixels > 0) & (pixels < np.array(found.camera.size))).all()
    assert found.tool.holes > 10
    away = np.array([(3.0, 0.0, 0.05), (0.45, 0.0, 0.05)])
    assert tool_error(found, away).holes == 1
    assert tool_error(found, away[:1]).holes == 0
