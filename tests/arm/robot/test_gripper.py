"""A gripper by its measures: the arm ends where they say, and the shipped one is one of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm.errors import InputError
from arm.io.storage import data_file, read_text
from arm.robot.gripper import Gripper
from arm.robot.jaws import FINGERS
from arm.robot.model import load_a465
from arm.robot.shapes import Box, Cylinder
from arm.se3 import inverse

LONG = Gripper(
    length=0.21, opening=0.12, shut=0.01, finger=(0.03, 0.012, 0.09), palm=(0.06, 0.15, 0.04), close_to=0.02
)


def test_the_shipped_gripper_is_the_shipped_description() -> None:
    assert Gripper().description() == read_text(data_file("urdf/a465/a465.urdf"))
    assert Gripper().robot(0.06).digest == load_a465(0.134112, 0.06).digest


@pytest.mark.parametrize("width", [0.01, 0.04, 0.12])
def test_bodies_follow_the_gripper_dimensions(width: float) -> None:
    robot, shipped = LONG.robot(width), load_a465(0.134112, 0.06)
    assert robot.digest != shipped.digest
    q = np.radians([10.0, -40.0, -80.0, 20.0, -60.0, 30.0])
    tool = robot.T_base_tool(q)
    flange = shipped.T_base_tool(q) @ inverse(shipped.T_end_tool)
    assert (inverse(flange) @ tool)[:3, 3] == pytest.approx((0.0, 0.0, LONG.length))
    at = {b.name: (b.shape, inverse(tool) @ b.T_base_body) for b in robot.bodies_at(q)}
    for name, side in zip(FINGERS, (1.0, -1.0), strict=True):
        shape, T = at[name]
        assert shape == Box(LONG.finger)
        assert T[:3, 3] == pytest.approx((0.0, side * (width / 2.0 + 0.006), -0.045))
        assert np.abs(T[:3, :3] - np.eye(3)).max() < 1e-9
    shape, T = at["palm"]
    assert shape == Box(LONG.palm)
    assert T[:3, 3] == pytest.approx((0.0, 0.0, -0.09 - 0.02))
    shape, T = at["gripper"]
    assert isinstance(shape, Cylinder)
    assert (shape.radius, shape.length) == pytest.approx((0.032, 0.08))
    assert T[:3, 3] == pytest.approx((0.0, 0.0, -LONG.length + 0.04))
    arm = {b.name for b in shipped.bodies}
    assert set(at) == arm
    assert robot.disabled_collisions == shipped.disabled_collisions


def test_a_palm_that_begins_at_the_flange_has_no_round_body() -> None:
    robot = replace(LONG, length=0.13).robot(0.05)
    assert "gripper" not in {b.name for b in robot.bodies}
    with pytest.raises(
        InputError, match="length = 129 mm: must be at least that of fingers and palm, 130 mm"
    ):
        replace(LONG, length=0.129)


def test_widths_are_linear_in_the_stroke() -> None:
    assert LONG.width(0.0) == LONG.opening
    assert LONG.width(1.0) == pytest.approx(LONG.shut)
    for width in np.linspace(LONG.shut, LONG.opening, 7):
        assert LONG.width(LONG.fraction_closed(width)) == pytest.approx(width)
    assert Gripper().fraction_closed(0.006) == pytest.approx(0.9)


def test_a_users_urdf_defines_fingers_and_palm(tmp_path: Path) -> None:
    file = tmp_path / "mine.urdf"
    file.write_text(LONG.description())
    (tmp_path / "mine.srdf").write_text(read_text(data_file("urdf/a465/a465.srdf")))
    own = Gripper(length=LONG.length, opening=LONG.opening, urdf=file).robot(0.05)
    for a, b in zip(own.bodies, LONG.robot(0.05).bodies, strict=True):
        assert (a.name, a.shape) == (b.name, b.shape)
        assert np.abs(a.T_joint_body - b.T_joint_body).max() < 1e-12
    with pytest.raises(InputError, match=r"the fingers in mine\.urdf end 210 mm beyond the flange"):
        Gripper(length=0.2, urdf=file).robot(0.05)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"length": 0.0}, "gripper: length = 0 m: must be from"),
        ({"opening": float("nan")}, "gripper: opening = nan"),
        ({"close_to": 0.13}, "close_to = 130 mm: must be from 10 mm, .* to less than 120 mm"),
        ({"close_to": 0.005}, "close_to = 5 mm: must be from 10 mm"),
    ],
)
def test_measures_that_cannot_be_are_refused(change: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        replace(LONG, **change)
