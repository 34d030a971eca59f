"""The arm file: what it says becomes the arm that Python would make; what is wrong is told by file, key and value."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from arm.errors import InputError
from arm.robot.model import load_robot
from arm.robot.shapes import Body, Cylinder
from arm.robot.tool import urdf_limits, with_disabled_collisions, with_tool
from arm.se3 import transform
from cell.config.arm_file import read_arm_file
from cell.files.task import place_or_arm
from plans.other_arms import scara_files
from typed.command_line import a465, replace_in


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return scara_files(tmp_path)


def test_the_arm_is_the_one_that_python_makes(file: Path) -> None:
    found = read_arm_file(file)
    robot = load_robot(file.with_suffix(".urdf"), "flange", transform(t=(0, 0, 0.08)))
    robot = with_tool(
        robot, robot.T_end_tool, [Body("cup", Cylinder(0.012, 0.03), transform(t=(0, 0, 0.065)), "tool")]
    )
    robot = with_disabled_collisions(robot, neighbours=True)
    assert found.robot.digest == robot.digest
    limits = urdf_limits(robot, {"j1": 20.0, "j2": 25.0, "j3": 8.0, "j4": 50.0})
    for name, value in vars(limits).items():
        assert np.array_equal(getattr(found.limits, name), value)
    assert found.q_start.tolist() == [0.9, 0.8, 0.0, 0.0]
    assert [body.name for body in found.bodies] == ["table", "post"]
    assert (found.speed, found.options.clearance, found.options.line_clearance) == (0.5, 0.01, 0.01)


def test_locked_joints_and_pairs(file: Path) -> None:
    """The last joint is beyond the frame that carries the tool, so it is locked."""
    replace_in(file, 'end_frame = "flange"', 'end_frame = "quill"\nlocked = { j4 = 0.5 }')
    replace_in(file, "tool_mm", 'disabled_collisions = [["base", "quill"]]\ntool_mm')
    replace_in(file, ", j4 = 50 }", " }")
    replace_in(file, "q_start = [0.9, 0.8, 0.0, 0.0]", "q_start = [0.9, 0.8, 0.0]")
    found = read_arm_file(file)
    assert dict(found.robot.locked) == {"j4": 0.5}
    assert frozenset(("base", "quill")) in found.robot.disabled_collisions


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('urdf = "scara.urdf"', 'urdf = "none.urdf"', "arm.urdf = 'none.urdf': names a file that does not exist"),
        ('end_frame = "flange"', 'end_frame = "hand"', "end_frame = 'hand': must be the name of one of its links"),
        ("[0.9, 0.8, 0.0, 0.0]", "[0.9, 0.8]", "number for each joint: j1, j2, j3, j4 (it has 2, not 4)"),
        ("j4 = 50", "j5 = 50", "for every joint (j5: no joint that moves has this name)"),
        ("j4 = 50", "j4 = 50, j5 = 50", "'j5' is no joint that moves; these are j1, j2, j3, j4"),
        ("[0.9, 0.8, 0.0, 0.0]", "[9, 0.8, 0.0, 0.0]", "q_start = [9, 0.8, 0.0, 0.0]: j1 must be from -2.2 to 2.2"),
        ("[0.9, 0.8, 0.0, 0.0]", "[-9, 0.8, 0.0, 0.0]", "q_start = [-9, 0.8, 0.0, 0.0]: j1 must be from -2.2 to 2.2"),
        ("[0.9, 0.8, 0.0, 0.0]", "[9, 0.8, 0.0, 4.0]", "2.2, in rad (m where a joint slides)"),
        ("[0.9, 0.8, 0.0, 0.0]", "[51, 45, 0, 0]", "2.2, in rad (m where a joint slides) (are these degrees?)"),
        (", j4 = 50 }", " }", "acceleration: joint 'j4' is missing"),
        ("j4 = 50", "j4 = 0", "arm.acceleration = {'j1': 20, 'j2': 25, 'j3': 8, 'j4': 0}: must be a number above 0"),
        ("clearance_mm = 10", "clearance_mm = 2", "clearance_mm = 2: must be a number in mm from 5 to 100"),
        ('name = "post"', 'name = "cup"', "bodies[1].name = 'cup': is used twice, or is a body of the arm"),
        ("neighbours_may_touch", "neighbors_may_touch", "arm.neighbors_may_touch = True: is not a known key"),
        ("tool_mm", 'disabled_collisions = [["base", "cap"]]\ntool_mm', "pairs: 'cap' is not a link or body"),
        ("tool_mm", 'locked = { j9 = 0.0 }\ntool_mm', "locked = ['j9']: must be names of its joints, which are j1"),
        ("tool_mm = [0, 0, 80]", "tool_mm = [0, 0, 0.08]", "arm.tool_mm = [0, 0, 0.08]: must be [0, 0, 0], or 0.5 mm"),
        ("tool_mm", 'locked = { j4 = "in" }\ntool_mm', "arm.locked.j4 = 'in'"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told(file: Path, old: str, new: str, told: str) -> None:
    replace_in(file, old, new)
    with pytest.raises(InputError) as refusal:
        read_arm_file(file)
    assert str(refusal.value).startswith(str(file))
    assert told in str(refusal.value)


def test_a_plan_is_bound_to_all_that_decides_it(file: Path) -> None:
    """The plan states its speed; what is in the URDF and the SRDF is compared as such."""
    inputs = read_arm_file(file).inputs
    assert {"clearance_mm", "q_start", "arm.end_frame", "arm.tool_mm"} <= {*inputs}
    assert not {"speed", "arm.urdf", "arm.srdf"} & {*inputs}
    assert any(key.startswith("bodies") for key in inputs)


def test_only_what_is_said_may_touch(file: Path) -> None:
    """A pair, the neighbours, or the pairs of an SRDF, whatever its name."""
    free = read_arm_file(file).robot.disabled_collisions
    replace_in(file, "neighbours_may_touch = true", "")
    bare = read_arm_file(file).robot.disabled_collisions
    assert free > bare
    replace_in(file, "tool_mm", 'disabled_collisions = [["base", "quill"]]\ntool_mm')
    assert read_arm_file(file).robot.disabled_collisions == bare | {frozenset(("base", "quill"))}
    srdf = '<robot name="scara"><disable_collisions link1="base" link2="forearm" reason="Never"/></robot>'
    links = sorted({name for pair in free for name in pair})
    file.with_name("may touch.srdf").write_text(
        srdf.replace("forearm", next(n for n in links if n != "base"))
    )
    replace_in(file, 'urdf = "scara.urdf"', 'urdf = "scara.urdf"\nsrdf = "may touch.srdf"')
    with_srdf = read_arm_file(file).robot.disabled_collisions
    assert len(with_srdf) == len(bare) + 2


def test_an_arm_of_which_nothing_would_be_checked_is_refused(file: Path) -> None:
    """A URDF of a CAD exporter may have <visual> alone; the tool and the base do not stand for the arm."""
    urdf = file.with_suffix(".urdf")
    text = urdf.read_text()
    base, rest = text.split("</link>", 1)
    urdf.write_text(f"{base}</link>{rest.replace('collision>', 'visual>')}")
    with pytest.raises(InputError) as refusal:
        read_arm_file(file)
    assert str(refusal.value) == (
        f"{file}: arm.urdf = 'scara.urdf': no link that moves has a <collision>: nothing of the arm would be checked "
        "(a <visual> is not checked; give the links a <collision> too)"
    )


def test_links_that_are_only_shown_are_told(file: Path) -> None:
    assert [*read_arm_file(file).doubts()] == []
    urdf, plan = file.with_suffix(".urdf"), file.with_name("plan.json")
    before, quill = urdf.read_text().split('<link name="quill">')
    urdf.write_text(f'{before}<link name="quill">{quill.replace("collision>", "visual>")}')
    told = "scara.toml: arm.urdf: quill has a <visual> and no <collision>, and nothing checks a <visual>"
    assert [*read_arm_file(file).doubts()] == [told]
    points = [
        {"positions": [0.6, 0.7 + x, 0.02, 0.0], "time_from_start": {"sec": x, "nanosec": 0}} for x in (0, 1)
    ]
    trajectory = {"joint_names": ["j1", "j2", "j3", "j4"], "points": points}
    file.with_name("t.json").write_text(json.dumps(trajectory))
    for words in (
        ("plan", file, file.with_name("poses.json"), "-o", plan),
        ("check", plan, file),
        ("certify", file.with_name("t.json"), file, "--clearance-mm", "1"),
    ):
        said, _ = a465(*words)
        assert f"NOTE: {told}" in said


def test_a_file_without_the_header_of_its_table_is_an_arm_file(file: Path) -> None:
    replace_in(file, "[arm]", "")
    with pytest.raises(InputError, match="arm: is missing; it must be a table"):
        place_or_arm(file)


def test_a_locked_joint_has_no_place_in_q_start(file: Path) -> None:
    replace_in(file, 'end_frame = "flange"', 'end_frame = "quill"\nlocked = { j4 = 0.5 }')
    replace_in(file, ", j4 = 50 }", " }")
    with pytest.raises(InputError, match=r"each joint: j1, j2, j3 \(j4: locked, and has none\)$"):
        read_arm_file(file)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('velocity="4"', 'velocity="230"', "joint j1: its velocity in the URDF is 230 rad/s: is it in deg/s?"),
        ('velocity="1"', 'velocity="1000"', "joint j3: its velocity in the URDF is 1000 m/s: is it in mm/s?"),
        ("j2 = 25", "j2 = 1432", "joint j2: arm.acceleration is 1432 rad/s^2: is it in deg/s^2? Then it must be 24.99"),
        ("j3 = 8", "j3 = 8000", "joint j3: arm.acceleration is 8000 m/s^2: is it in mm/s^2? Then it must be 8 m/s^2"),
        ("j1 = 20", "j1 = 0.02", "joint j1: at arm.acceleration = 0.02 rad/s^2 it needs 200 s to reach 4 rad/s"),
        ("tool_mm = [0, 0, 80]", "", "arm.tool_mm is missing although there are arm.tool_bodies"),
    ],
)  # fmt: skip
def test_limits_of_another_unit_are_a_note(file: Path, old: str, new: str, told: str) -> None:
    replace_in(file.with_suffix(".urdf") if '="' in old else file, old, new)
    (found,) = read_arm_file(file).doubts()
    assert found.startswith(f"scara.toml: {told}")


def test_an_arm_that_is_not_checked_against_itself_is_a_note(file: Path) -> None:
    links = "".join(
        f'<disable_default_collisions link="{name}"/>' for name in ("base", "upper", "lower", "quill")
    )
    file.with_suffix(".srdf").write_text(f'<robot name="scara">{links}</robot>')
    (found,) = (doubt for doubt in read_arm_file(file).doubts() if "against itself" in doubt)
    assert found.startswith("scara.toml: the SRDF or arm.disabled_collisions disable all pairs of links")
