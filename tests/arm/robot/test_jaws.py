"""Jaws that may be anywhere."""

from __future__ import annotations

import pytest

from arm.robot.gripper import Gripper
from arm.robot.jaws import with_any_jaws
from arm.robot.shapes import Box

LONG = Gripper(
    length=0.21, opening=0.12, shut=0.01, finger=(0.03, 0.012, 0.09), palm=(0.06, 0.15, 0.04), close_to=0.02
)


def test_jaws_that_may_be_anywhere_follow_the_fingers() -> None:
    drawn = {b.name: b.shape for b in with_any_jaws(LONG.robot(LONG.opening)).bodies}
    shape = drawn["finger_l"]
    assert isinstance(shape, Box)
    assert shape.size == pytest.approx((0.03, 0.06 + 0.012, 0.09))
