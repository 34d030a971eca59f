"""The tree of links of a URDF, also of one that someone changed in a plan file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest

from arm.errors import InputError
from arm.robot.model import load_a465
from arm.robot.tool import urdf_limits
from arms.made_up import RAIL, arm
from cell.export.link_tree import base_link, end_link, links_beyond, urdf_root
from cell.export.urdf import Surroundings, describe


def test_base_end_and_hand() -> None:
    robot = load_a465(0.134112, 0.04)
    root = urdf_root(robot)
    assert (base_link(root), end_link(root, robot)) == ("base", "flange")
    assert end_link(root, replace(robot, end_frame="flange_joint")) == "flange"
    hand = {"gripper": "gripper_mount", "palm": "palm_mount", "finger_l": "jaw_l", "finger_r": "jaw_r"}
    assert links_beyond(root, "flange") == hand
    assert list(links_beyond(root, "wrist")) == ["hub", "flange", *hand]
    assert links_beyond(root, "finger_l") == {}


def test_no_base() -> None:
    with pytest.raises(InputError, match="no link that stands still"):
        base_link(ElementTree.fromstring("<robot/>"))


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("</robot>", "", "the arm's URDF is not XML"),
        ('<child link="l3"/>', "", "the arm's URDF: joint q3 has no child"),
        ('name="l3"><collision>', 'name="l3"><collision/><collision>', "link l3 has 2 bodies, the arm has 1"),
        ('<joint name="q3"', '<joint name="q33"', "the arm's URDF has no joint q3"),
        ('<parent link="l4"/>', '<parent link="l5"/>', ""),  # in a circle
        ('<child link="l1"/>', '<child link="l0"/>', ""),
    ],
)
def test_a_changed_urdf_is_refused_or_read(old: str, new: str, told: str, tmp_path: Path) -> None:
    robot = arm(tmp_path, RAIL)
    assert old in robot.urdf
    there = Surroundings(replace(robot, urdf=robot.urdf.replace(old, new, 1)), urdf_limits(robot, 1.0), ())
    if told:
        with pytest.raises(InputError, match=told):
            describe(there)
    else:
        assert describe(there).files
