"""URDF of a scene: angles, meshes and names."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pinocchio as pin

from arm.robot.mesh import read_mesh_points
from arm.robot.model import load_a465, load_robot
from arm.robot.shapes import Body, Sphere, convex
from arm.robot.tool import urdf_limits, with_tool
from arm.se3 import rot_x, rot_y, rot_z, rotation, transform
from arms.made_up import BOX_OBJ, MESH_ARM
from cell.export.urdf import COLOURS, Surroundings, describe, link_names, rpy_of, stl_of
from tasks.described import require_same


def test_roll_pitch_yaw_also_where_the_pitch_is_a_right_angle() -> None:
    rng = np.random.default_rng(7)
    turns = [rotation(v) for v in rng.normal(size=(200, 3)) * 2.0]
    for a, b in rng.normal(size=(50, 2)):
        for off in (0.0, 1e-12, 1e-9, 1e-6):
            turns += [rot_z(a) @ rot_y(sign * (np.pi / 2 - off)) @ rot_x(b) for sign in (-1.0, 1.0)]
    for R in turns:
        roll, pitch, yaw = rpy_of(R)
        assert np.abs(np.array(pin.rpy.rpyToMatrix(roll, pitch, yaw)) - R).max() < 1e-14


def test_hulls_as_stl_have_their_corners_and_face_outwards(tmp_path: Path) -> None:
    shape = convex(np.random.default_rng(8).normal(size=(30, 3)) + (1.0, 2.0, 3.0))
    (tmp_path / "hull.stl").write_bytes(stl_of(shape))
    read = read_mesh_points(tmp_path / "hull.stl")
    wanted = np.unique(np.array(shape.points, dtype=np.float32).astype(float), axis=0)
    assert np.array_equal(read, wanted)
    layout = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    triangles = np.frombuffer((tmp_path / "hull.stl").read_bytes(), dtype=layout, offset=84)
    a, b, c = np.moveaxis(triangles["corners"].astype(float), 1, 0)
    turned = np.cross(b - a, c - a)
    assert np.all((turned * triangles["normal"]).sum(axis=1) > 0.0)
    assert np.all(((a - wanted.mean(axis=0)) * triangles["normal"]).sum(axis=1) > 0.0)


def test_link_names_are_plain_and_differ() -> None:
    found = link_names(["a b", "a.b", "a_b", "", "č", "base"], {"base", "a_b_2"})
    assert len(set(found.values()) | {"base", "a_b_2"}) == 8
    assert all(name.isascii() and name.replace("_", "a").isalnum() for name in found.values() if name)


def test_an_arm_of_meshes_is_exported_with_the_hulls_that_are_checked(tmp_path: Path) -> None:
    """Scaled and placed as in its URDF; its files are not needed, and a link named tool keeps its name."""
    (tmp_path / "box.obj").write_text(BOX_OBJ)
    shown = '<visual><geometry><mesh filename="box.obj"/></geometry></visual></link>\n<joint name="J1"'
    wrist = '<link name="tool"/><joint name="fixed" type="fixed"><parent link="rod"/><child link="tool"/>'
    wrist += '<origin xyz="0.05 0 0.2" rpy="0.3 0 0"/></joint>'
    text = MESH_ARM.format(mesh="box.obj").replace("</robot>", f"{wrist}</robot>")
    (tmp_path / "arm.urdf").write_text(text.replace('</link>\n<joint name="J1"', shown))
    robot = load_robot(tmp_path / "arm.urdf", "fixed", transform(rot_x(0.4), (0.0, 0.1, 0.3)))
    robot = with_tool(
        robot, robot.T_end_tool, [Body("tip", Sphere(0.02), transform(t=(0.0, 0.1, 0.3)), "tool")]
    )
    (tmp_path / "box.obj").unlink()
    ball = Body("ball", Sphere(0.1), transform(t=(0.9, 0.3, 0.5)), "wall")
    described = describe(Surroundings(robot, urdf_limits(robot, 1.0), (ball,)))
    assert "meshes/arm/foot.stl" in described.files
    urdf = str(described.files["cell.urdf"])
    assert "box.obj" not in urdf
    assert (
        re.findall("<mesh .*?>", urdf) == ['<mesh filename="meshes/arm/foot.stl" />'] * 2
    )  # collision, visual
    assert 'tip_link="tool_2"' in str(described.files["cell.srdf"])
    require_same(Surroundings(robot, urdf_limits(robot, 1.0), (ball,)), tmp_path / "out", seed=9)


def test_every_link_that_is_shown_has_the_colour_of_its_kind() -> None:
    robot = load_a465(0.134112, 0.06)
    bodies = [
        Body(kind, Sphere(0.1), transform(t=(x, 0.9, 0.5)), kind) for x, kind in enumerate(("table", "cube"))
    ]
    root = ElementTree.fromstring(
        str(describe(Surroundings(robot, urdf_limits(robot, 1.0), tuple(bodies))).files["cell.urdf"])
    )
    known = {m.get("name"): m.find("color") for m in root.findall("material")}
    for name, colour in known.items():
        assert colour is not None
        rgba = [float(part) for part in str(colour.get("rgba")).split()]
        assert rgba == list(COLOURS[str(name).removeprefix("a465_").replace("other", "")])
    worn = {
        str(link.get("name")): {material.get("name") for material in link.findall("visual/material")}
        for link in root.findall("link")
        if link.find("collision") is not None
    }
    assert worn.pop("table") == {"a465_table"}
    assert worn.pop("cube") == {"a465_cube"}
    assert set().union(*worn.values()) == {"a465_robot"}
    assert all(len(names) == 1 for names in worn.values())
