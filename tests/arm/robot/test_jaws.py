"""Jaws that may be anywhere."""

from __future__ import annotations

from pathlib import Path

import pytest

from arm.robot.gripper import Gripper
from arm.robot.jaws import after_closing, with_any_jaws
from arm.robot.shapes import Box
from arms.made_up import RAIL, arm

LONG = Gripper(
    length=0.21, opening=0.12, shut=0.01, finger=(0.03, 0.012, 0.09), palm=(0.06, 0.15, 0.04), close_to=0.02
)


def test_jaws_that_may_be_anywhere_follow_the_fingers() -> None:
    drawn = {b.name: b.shape for b in with_any_jaws(LONG.robot(LONG.opening)).bodies}
    shape = drawn["finger_l"]
    assert isinstance(shape, Box)
    assert shape.size == pytest.approx((0.03, 0.06 + 0.012, 0.09))


def test_jaws_of_another_arm_stay_where_they_are(tmp_path: Path) -> None:
    other, ours = arm(tmp_path, RAIL), LONG.robot(LONG.opening)
    assert after_closing(other) is other
    assert after_closing(ours).digest == with_any_jaws(ours).digest
