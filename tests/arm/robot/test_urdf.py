"""URDFs as ROS and pip ship them: several bodies a link, SRDF pairs of links, packages, xacro."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm.errors import FileInputError, InputError
from arm.robot.model import Robot, load_robot
from arm.robot.shapes import Convex
from arm.robot.tool import with_disabled_collisions, with_tool
from arm.se3 import rotation
from arms.made_up import BOX_OBJ, MESH_ARM, SEVEN, several_bodies, urdf
from plan.collision.world import World

LAST = f"l{len(SEVEN)}"


def srdf(*pairs: tuple[str, str], more: str = "") -> str:
    lines = "".join(f'<disable_collisions link1="{a}" link2="{b}" reason="Adjacent"/>' for a, b in pairs)
    return f'<robot name="made_up">{more}{lines}</robot>'


NEIGHBOURS = [(f"l{k}", f"l{k + 1}") for k in range(len(SEVEN))] + [
    (f"l{k}", f"l{k + 2}") for k in range(len(SEVEN) - 1)
]


def written(folder: Path, bodies: int = 3, pairs: str = "") -> Path:
    """The arm of seven joints, each link of several bodies."""
    path = folder / "arm.urdf"
    path.write_text(several_bodies(urdf(SEVEN), bodies))
    if pairs:
        path.with_suffix(".srdf").write_text(pairs)
    return path


def own_pairs(robot: Robot) -> set[frozenset[str]]:
    world = World(robot, [])
    return {frozenset(world.pair_names(i)) for i in range(len(world.pairs))}


@pytest.mark.parametrize("bodies", [1, 2, 4])
def test_an_srdf_pair_holds_for_all_bodies_of_both_links(tmp_path: Path, bodies: int) -> None:
    robot = load_robot(written(tmp_path, bodies, srdf(*NEIGHBOURS)), LAST, np.eye(4))
    assert len(robot.bodies) == bodies * (len(SEVEN) + 1)
    assert len({b.name for b in robot.bodies}) == len(robot.bodies)
    link = {b.name: b.link for b in robot.bodies}
    left = {frozenset(link[name] for name in pair) for pair in own_pairs(robot)}
    assert left == {frozenset((f"l{i}", f"l{j}")) for i in range(8) for j in range(i + 3, 8)}
    assert World(robot, []).distance(np.full(7, 0.1)).value > 0.0  # at rest nothing touches


def test_pairs_to_ignore_may_name_links_or_bodies(tmp_path: Path) -> None:
    bare = load_robot(written(tmp_path), LAST, np.eye(4))
    links = with_disabled_collisions(bare, NEIGHBOURS)
    assert (
        links.disabled_collisions
        == load_robot(written(tmp_path, 3, srdf(*NEIGHBOURS)), LAST, np.eye(4)).disabled_collisions
    )
    one = with_disabled_collisions(bare, [("l0_1", "l1_2")])
    assert one.disabled_collisions == {frozenset(("l0_1", "l1_2"))}
    with pytest.raises(InputError, match="'l9' is not a link or body"):
        with_disabled_collisions(bare, [("l0", "l9")])


def test_names_of_further_bodies_differ_from_link_names(tmp_path: Path) -> None:
    text = several_bodies(urdf(SEVEN[:2]), 2).replace('"l2"', '"l1_1"')
    path = tmp_path / "arm.urdf"
    path.write_text(text)
    names = [b.name for b in load_robot(path, "l1_1", np.eye(4)).bodies]
    assert names == ["l0", "l0_1", "l1", "l1 body 1", "l1_1", "l1_1_1"]


def test_defaults_that_an_srdf_turns_off_and_on(tmp_path: Path) -> None:
    more = '<disable_default_collisions link="l7"/><enable_collisions link1="l7" link2="l0"/>'
    robot = load_robot(written(tmp_path, 2, srdf(("l0", "l1"), more=more)), LAST, np.eye(4))
    link = {b.name: b.link for b in robot.bodies}
    pairs = {frozenset(link[name] for name in pair) for pair in robot.disabled_collisions}
    assert pairs == {frozenset(("l7", f"l{k}")) for k in range(1, 7)} | {frozenset(("l0", "l1"))}


def test_a_given_srdf_must_exist(tmp_path: Path) -> None:
    path = written(tmp_path)
    for wrong in (tmp_path / "other.srdf", str(tmp_path / "other.srdf"), path.with_suffix(".srdf")):
        with pytest.raises(FileInputError, match=r"\.srdf: cannot be read"):
            load_robot(path, LAST, np.eye(4), srdf=wrong)
    (tmp_path / "other.srdf").write_text(srdf(("l0", "l1")))
    assert load_robot(path, LAST, np.eye(4), srdf=str(tmp_path / "other.srdf")).disabled_collisions
    (tmp_path / "other.srdf").write_text('<robot><disable_collisions link1="l0"/></robot>')
    with pytest.raises(FileInputError, match="disable_collisions: has no link2"):
        load_robot(path, LAST, np.eye(4), srdf=tmp_path / "other.srdf")


@pytest.mark.parametrize(
    ("line", "key"),
    [
        ('<disable_collisions link1="l0" link2="forarm"/>', "disable_collisions link2"),
        ('<enable_collisions link1="forarm" link2="l1"/>', "enable_collisions link1"),
        ('<disable_default_collisions link="forarm"/>', "disable_default_collisions link"),
    ],
)
def test_a_misspelt_link_of_an_srdf_is_told(tmp_path: Path, line: str, key: str) -> None:
    """Its pair would stay checked. Links beside the chain may be named, and a hand that the URDF does not have."""
    path = written(tmp_path, 3, f"<robot>{line}</robot>")
    text = path.read_text()
    path.write_text(text.replace('"l2"', '"forearm"'))
    with pytest.raises(FileInputError) as refusal:
        load_robot(path, LAST, np.eye(4))
    told = f"{path.with_suffix('.srdf')}: {key} = 'forarm': is no link of the URDF (did you mean 'forearm'?)"
    assert str(refusal.value) == told
    beside = (
        '<link name="forarm"/><joint name="m" type="fixed"><parent link="l0"/><child link="forarm"/></joint>'
    )
    path.write_text(path.read_text().replace("</robot>", f"{beside}</robot>"))
    load_robot(path, LAST, np.eye(4))
    path.write_text(text)
    for other in ("hand", "l9"):
        path.with_suffix(".srdf").write_text(f"<robot>{line.replace('forarm', other)}</robot>")
        load_robot(path, LAST, np.eye(4))


def test_an_srdf_of_another_robot_is_told(tmp_path: Path) -> None:
    path = written(tmp_path)
    other = srdf(*((f"m{k}", f"m{k + 1}") for k in range(5)))
    path.with_suffix(".srdf").write_text(other)
    with pytest.raises(FileInputError, match=r"m0 - m1 and all others are no pairs of links .*another robot"):
        load_robot(path, LAST, np.eye(4))
    path.with_suffix(".srdf").write_text(srdf(("l0", "l1"), *((f"m{k}", f"m{k + 1}") for k in range(5))))
    load_robot(path, LAST, np.eye(4))


def test_what_is_given_as_an_srdf_must_be_one(tmp_path: Path) -> None:
    path, other = written(tmp_path), tmp_path / "other.srdf"
    for text, rule in (("<foo/>", "begins with <foo>"), (path.read_text(), "is a URDF")):
        other.write_text(text)
        with pytest.raises(FileInputError, match=rule):
            load_robot(path, LAST, np.eye(4), srdf=other)


@pytest.mark.parametrize(
    ("given", "rule"),
    [
        ({"T_end_tool": np.eye(3)}, r"T_end_tool = array of shape \(3, 3\): must be a 4x4 pose"),
        ({"T_end_tool": np.full((4, 4), np.nan)}, "T_end_tool: the pose has a number that is not finite"),
        ({"T_end_tool": 2.0 * np.eye(4)}, "T_end_tool: the last row"),
        ({"T_end_tool": "tool"}, "T_end_tool = 'tool': must be a 4x4 pose"),
        ({"package_dirs": [3]}, "package_dirs: 3: must be a list of folders"),
        ({"package_dirs": "ros"}, "package_dirs: 'ros': must be a list of folders"),
        ({"package_dirs": 3}, "package_dirs: 3: must be a list of folders"),
        ({"locked": {"q1": "shut"}}, "locked: q1 = 'shut': must be a number"),
        ({"end_frame": 3}, "end_frame = 3: must be the name of one of its links"),
    ],
)
def test_what_is_given_with_a_urdf_is_refused_by_name_value_and_rule(
    tmp_path: Path, given: dict[str, Any], rule: str
) -> None:
    arguments: dict[str, Any] = {"end_frame": LAST, "T_end_tool": np.eye(4), **given}
    with pytest.raises(InputError, match=rule):
        load_robot(written(tmp_path), **arguments)


@pytest.mark.parametrize("T", [np.eye(3), np.full((4, 4), np.nan), None])
def test_a_tool_frame_must_be_a_pose(tmp_path: Path, T: Any) -> None:
    robot = load_robot(written(tmp_path), LAST, np.eye(4))
    with pytest.raises(InputError, match="T_end_tool"):
        with_tool(robot, T)


def package(folder: Path, name: str = "two") -> Path:
    """A package with a mesh; its folder."""
    (folder / name / "meshes").mkdir(parents=True)
    (folder / name / "meshes" / "box.obj").write_text(BOX_OBJ)
    return folder / name


def mesh_arm(folder: Path, mesh: str = "package://two/meshes/box.obj") -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "two.urdf"
    path.write_text(MESH_ARM.format(mesh=mesh))
    return path


@pytest.mark.parametrize("kind", [str, Path])
@pytest.mark.parametrize("given", ["folder", "package", "prefix", "renamed"])
def test_packages_are_found_in_the_folders_that_are_given(tmp_path: Path, kind: type, given: str) -> None:
    folder = tmp_path / "ros"
    made = package(
        folder / "share" if given == "prefix" else folder, "src-2.1" if given == "renamed" else "two"
    )
    (made / "package.xml").write_text("<package><name> two </name></package>")
    where = {"folder": folder, "package": made, "prefix": folder, "renamed": made}[given]
    urdf_file = mesh_arm(tmp_path / "elsewhere")
    robot = load_robot(
        kind(urdf_file), "rod", np.eye(4), package_dirs=[kind(tmp_path / "nothing"), kind(where)]
    )
    assert isinstance(robot.bodies[0].shape, Convex)
    # what the arm is does not depend on where its files are
    moved = load_robot(mesh_arm(package(tmp_path / "third") / "urdf"), "rod", np.eye(4))
    assert moved.digest == robot.digest


@pytest.mark.parametrize(("variable", "inside"), [("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share")])
def test_packages_are_found_where_ros_keeps_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, variable: str, inside: str
) -> None:
    path = mesh_arm(tmp_path / "elsewhere")
    with pytest.raises(FileInputError) as caught:
        load_robot(path, "rod", np.eye(4))
    assert "link foot: mesh = 'package://two/meshes/box.obj': could not be found" in str(caught.value)
    for word in ("package_dirs", "two", "ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"):
        assert word in str(caught.value)
    assert "not a URDF" not in str(caught.value)
    package(tmp_path / "workspace" / inside)
    monkeypatch.setenv(variable, f"{tmp_path / 'empty'}:{tmp_path / 'workspace'}")
    assert isinstance(load_robot(path, "rod", np.eye(4)).bodies[0].shape, Convex)


def test_packages_are_found_above_the_urdf_as_pip_ships_them(tmp_path: Path) -> None:
    """share/two/robots/family/arm/urdf/two.urdf, which names package://two."""
    made = package(tmp_path / "share")
    path = mesh_arm(made / "robots" / "family" / "arm" / "urdf")
    assert isinstance(load_robot(path, "rod", np.eye(4)).bodies[0].shape, Convex)


@pytest.mark.parametrize("mesh", ["file://{}", "{}", "../two/meshes/box.obj"])
def test_meshes_may_be_paths(tmp_path: Path, mesh: str) -> None:
    made = package(tmp_path)
    path = mesh_arm(tmp_path / "urdf", mesh.format(made / "meshes" / "box.obj"))
    assert isinstance(load_robot(path, "rod", np.eye(4)).bodies[0].shape, Convex)


@pytest.mark.parametrize(
    "text",
    [
        '<robot name="a" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:property name="r" value="1"/></robot>',
        '<robot name="a"><xacro:include filename="x"/></robot>',
        '<robot name="a"><link name="${prefix}base"/></robot>',
    ],
)
def test_xacro_is_named_as_such(tmp_path: Path, text: str) -> None:
    path = tmp_path / "arm.urdf.xacro"
    path.write_text(text)
    with pytest.raises(FileInputError, match=r"is xacro, .*`xacro arm.urdf.xacro > arm.urdf`"):
        load_robot(path, "flange", np.eye(4))


def test_xacro_output_is_read(tmp_path: Path) -> None:
    """A processed file still names the namespace."""
    path = tmp_path / "arm.urdf"
    text = urdf(SEVEN).replace("<robot", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"')
    path.write_text(text.replace("</robot>", '<!-- <link name="${prefix}hand"/> --></robot>'))
    assert len(load_robot(path, LAST, np.eye(4)).bodies) == 8


def test_a_joint_may_have_the_name_of_a_link(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(urdf(SEVEN))
    plain = load_robot(path, LAST, np.eye(4))
    path.write_text(urdf(SEVEN).replace('"q3"', '"l4"'))
    same = load_robot(path, LAST, np.eye(4))
    assert same.joint_names == ("q1", "q2", "l4", "q4", "q5", "q6", "q7")
    q = np.array([0.3, -0.4, 0.5, 0.6, 0.1, 0.2, -0.3])
    np.testing.assert_allclose(same.T_base_tool(q), plain.T_base_tool(q), atol=1e-12)
    path.write_text(urdf(SEVEN).replace('"q3"', f'"{LAST}"'))
    same = load_robot(path, LAST, np.eye(4), {LAST: 0.5})
    np.testing.assert_allclose(same.T_base_tool(q[[0, 1, 3, 4, 5, 6]]), plain.T_base_tool(q), atol=1e-12)


GRIPPER = """<link name="a"/><link name="b"/><link name="c"/>
<joint name="finger" type="revolute"><parent link="l7"/><child link="a"/><axis xyz="1 0 0"/>
<limit lower="0" upper="1" velocity="1" effort="1"/></joint>
<joint name="other" type="revolute"><parent link="l7"/><child link="b"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/><mimic joint="finger" multiplier="-1" offset="0.1"/></joint>
<joint name="tip" type="revolute"><parent link="b"/><child link="c"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/><mimic joint="other" multiplier="{factor}"/></joint></robot>"""


def with_gripper(folder: Path, factor: str = "2") -> Path:
    path = folder / "arm.urdf"
    path.write_text(urdf(SEVEN).replace("</robot>", GRIPPER.replace("{factor}", factor)))
    return path


def test_joints_that_follow_a_locked_one_are_locked_where_it_puts_them(tmp_path: Path) -> None:
    path = with_gripper(tmp_path)
    followed = load_robot(path, LAST, np.eye(4), {"finger": 0.3})
    stated = load_robot(path, LAST, np.eye(4), {"finger": 0.3, "other": -0.2, "tip": -0.4})
    assert followed.joint_names == stated.joint_names == tuple(f"q{k}" for k in range(1, 8))
    other = load_robot(path, "c", np.eye(4), {"finger": 0.3}).T_base_tool(np.zeros(7))
    turned = followed.T_base_tool(np.zeros(7))[:3, :3].T @ other[:3, :3]
    np.testing.assert_allclose(turned, rotation(np.array([-0.6, 0.0, 0.0])), atol=1e-12)


def test_a_joint_that_follows_a_moving_one_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileInputError, match=r"joint other: follows 'finger' \(mimic\), which moves"):
        load_robot(with_gripper(tmp_path), LAST, np.eye(4))
    with pytest.raises(FileInputError, match="joint tip: multiplier = 'two': must be a number"):
        load_robot(with_gripper(tmp_path, "two"), LAST, np.eye(4), {"finger": 0.0})


def test_fixed_joints_follow_nothing(tmp_path: Path) -> None:
    """Fingers that an author fixed, with what they followed left in: the file loads, and they are where they are."""
    path = with_gripper(tmp_path)
    moving = load_robot(path, "b", np.eye(4), {"finger": 0.0, "other": 0.0, "tip": 0.0})
    text = path.read_text()
    for name in ("finger", "other"):
        text = text.replace(f'name="{name}" type="revolute"', f'name="{name}" type="fixed"')
    path.write_text(text)
    fixed = load_robot(path, "b", np.eye(4))  # the tip follows a fixed joint
    assert fixed.joint_names == moving.joint_names
    q = np.linspace(-0.5, 0.5, 7)
    np.testing.assert_allclose(fixed.T_base_tool(q), moving.T_base_tool(q), atol=1e-12)


@pytest.mark.parametrize("folder", ["urdf", "srdf", "config"])
def test_an_srdf_is_found_where_packages_have_it(tmp_path: Path, folder: str) -> None:
    for name in ("urdf", folder):
        (tmp_path / name).mkdir(exist_ok=True)
    path = tmp_path / "urdf" / "arm.urdf"
    path.write_text(urdf(SEVEN))
    pair = '<disable_collisions link1="l0" link2="l2" reason="Never"/>'
    (tmp_path / folder / "arm.srdf").write_text(f"<robot>{pair}</robot>")
    assert load_robot(path, LAST, np.eye(4)).disabled_collisions == {frozenset(("l0", "l2"))}


def test_a_joint_that_is_far_from_the_one_before_is_asked_its_unit(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    text = urdf(SEVEN)
    place = text[text.index('xyz="', text.index("<joint")) :].split('"')[1]
    path.write_text(text.replace(f'xyz="{place}"', 'xyz="0 0 520"', 1))
    with pytest.raises(
        FileInputError, match=r"joint \w+: origin: is 520 m from the joint before it; .*is it in mm"
    ):
        load_robot(path, LAST, np.eye(4))
