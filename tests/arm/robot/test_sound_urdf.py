"""What is wrong in a URDF is told in one line, with link or joint, value and rule; what others write is read."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from arm.errors import FileInputError
from arm.robot.model import load_robot

SOUND = (
    '<robot name="r"><link name="base"/><link name="arm"><collision><geometry><box size="0.3 0.1 0.1"/></geometry>'
    '</collision></link><joint name="j1" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 0 0.5" '
    'rpy="0 0 1.5"/><axis xyz="0 0 1"/><limit lower="-2" upper="2" velocity="4" effort="1"/></joint></robot>'
)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('<robot name="r">', "<sdf>", "is not a URDF: it begins with <sdf>, must be <robot>"),
        ('<link name="base"/>', '<link name="base"/><link name="arm"/>', "link name = 'arm': is used twice"),
        ("revolute", "revolut", "joint j1: type = 'revolut': must be one of revolute, .* (did you mean 'revolute'?)"),
        ("revolute", "linear", "joint j1: type = 'linear': must be one of revolute, continuous, prismatic, fixed"),
        ('parent link="base"', 'parent link="bas"', "parent = 'bas': must name a link .*"),
        ('child link="arm"', 'child link="base"', "joint j1: child = 'base': is its parent too"),
        ('<link name="base"/>', '<link name="base"/><link name="post"/>', "it has base, post (is a joint missing"),
        (' velocity="4"', "", "joint j1: has a <limit> without velocity; must have one with"),
        ('<limit lower="-2" upper="2" velocity="4" effort="1"/>', "", "joint j1: has no <limit>; must have one with"),
        ('xyz="0 0 0.5"', 'xyz="0 0 0,5"', "origin xyz = '0 0 0,5': must .* (the decimal sign is a point"),
        ('xyz="0 0 0.5"', 'xyz="0 0"', "joint j1: origin xyz = '0 0': must be 3 numbers"),
        ('xyz="0 0 1"', 'xyz="0 0 0"', "joint j1: axis xyz = '0 0 0': must not be 0 along all three axes"),
        ('rpy="0 0 1.5"', 'rpy="0 0 90"', "'0 0 90': must be within 6.293 rad (is it in degrees?)"),
        ('size="0.3 0.1 0.1"', 'size="300 100 100"', "box size = '300 100 100': must be within 20 m (is it in mm?)"),
        (' effort="1"', "", "is not a URDF: joint [j1]: limit has no effort"),  # told by the parser alone
    ],
)  # fmt: skip
def test_what_is_wrong_in_a_urdf_is_told_in_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], old: str, new: str, told: str
) -> None:
    path, text = tmp_path / "arm.urdf", SOUND
    path.write_text(text)
    load_robot(path, "arm", np.eye(4))
    text = text.replace(old, new)
    path.write_text(text.replace("</robot>", "</sdf>") if "<sdf>" in text else text)
    with pytest.raises(FileInputError) as refused:
        load_robot(path, "arm", np.eye(4))
    assert re.search(re.escape(told).replace(r"\.\*", ".*"), str(refused.value)), str(refused.value)
    assert capfd.readouterr().err == ""  # what the parser itself writes is caught


def test_what_other_programs_write_is_read(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    fixed = (
        '<link name="floor"><collision><geometry><box size="200 200 0.1"/></geometry></collision></link>'
        '<joint name="j0" type="fixed"><parent link="base"/><child link="floor"/><axis xyz="0 0 0"/></joint>'
        '<gazebo><plugin file="$(find it)"/></gazebo></robot>'
    )
    path.write_text(SOUND.replace("</robot>", fixed))
    assert load_robot(path, "arm", np.eye(4)).joint_names == ("j1",)


def test_an_srdf_of_another_name_needs_one_pair_of_this_arm(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(SOUND)
    pair = '<disable_collisions link1="a" link2="b"/></robot>'
    path.with_suffix(".srdf").write_text(f'<robot name="r">{pair}')
    load_robot(path, "arm", np.eye(4))
    path.with_suffix(".srdf").write_text(f'<robot name="ur5">{pair}')
    with pytest.raises(FileInputError, match=r"a - b and all others are no pairs of links .*another robot"):
        load_robot(path, "arm", np.eye(4))
    path.with_suffix(".srdf").write_text("")
    with pytest.raises(FileInputError, match=r"arm\.srdf: is empty; must be an SRDF"):
        load_robot(path, "arm", np.eye(4))
