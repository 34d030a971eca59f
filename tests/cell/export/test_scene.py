"""URDF and SRDF as another reader has them: Pinocchio's own parsers, against the project's arm and World."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from arm.calibration_file import ArmCalibration, write_arm_calibration
from arm.controller.unit import load_unit
from arm.errors import InputError
from arm.io.storage import data_file
from arm.robot.dh import A465
from arm.robot.link_errors import LinkErrors
from arm.robot.model import load_a465
from arm.robot.shapes import Body, Box, Capsule, Sphere, Torus, convex
from arm.se3 import frozen, rot_x, rot_y, rotation, transform
from cell.config.cell_file import read_cell
from cell.console import Console
from cell.export.export import ExportOptions, export_file
from cell.export.scene import surroundings_of_file
from cell.export.urdf import Surroundings, describe
from cell.files.apply_calibration import apply_calibration
from cell.files.task import read_task
from cell.scene.build import build_scene
from tasks.described import Exported, require_same
from tasks.true_look import true_look
from typed.command_line import a465, replace_in

FIXTURES = sorted(data_file("scenes/fixtures").glob("*.toml"))


@pytest.mark.few(5)
@pytest.mark.parametrize("path", FIXTURES, ids=lambda p: p.stem)
def test_shipped_scenes_read_by_pinocchio_are_ours(path: Path, tmp_path: Path) -> None:
    require_same(surroundings_of_file(path, None), tmp_path / "out", seed=1)


def test_a_cell_with_boards_and_cubes_read_by_pinocchio_is_ours(tmp_path: Path) -> None:
    task = read_task(data_file("scenes/task2.toml"))
    cell = surroundings_of_file(data_file("scenes/cell.toml"), None)
    assert {b.name for b in cell.bodies} == {"table", "camera post"}
    scene = build_scene(task.cell, true_look(task))
    there = replace(cell, bodies=(*scene.bodies, *scene.cubes), allowed=scene.allowed)
    assert {b.kind for b in there.bodies} == {"table", "wall", "board", "stand", "cube"}
    require_same(there, tmp_path / "out", seed=2)


def test_every_shape_held_and_standing(tmp_path: Path) -> None:
    """Names that no link may have, a hull, a held capsule, and what may touch."""
    rng = np.random.default_rng(3)
    hull = convex(rng.normal(size=(20, 3)) * (0.05, 0.1, 0.15))
    bodies = (
        Body("a <b> & --c", hull, transform(rotation((0.3, -1.0, 2.0)), (0.5, 0.2, 0.2)), "wall"),
        Body("a _b_ & --c", Capsule(0.03, 0.3), transform(rot_x(1.2), (0.4, -0.4, 0.3)), "wall"),
        Body("wrist_roll", Sphere(0.05), transform(t=(0.3, 0.3, 0.7)), "wall"),
        Body("tool", Box((0.1, 0.2, 0.3)), transform(rot_y(np.pi / 2), (-0.5, 0.0, 0.2)), "wall"),
    )
    unit = load_unit("crs97")
    held = Body("\u0001 pen", Capsule(0.006, 0.14), transform(), "cube")
    robot = load_a465(0.134112, 0.012)
    with pytest.raises(InputError, match="two bodies are named 'a <b>"):
        describe(Surroundings(robot, unit.limits(), (bodies[0], bodies[0])))
    there = Surroundings(
        robot,
        unit.limits(),
        bodies,
        held,
        frozen(transform(rotation((0.1, 0.2, 0.3)), (0.0, 0.01, 0.05))),
        frozenset((frozenset((held.name, "tool")),)),
        {"home": unit.soft_home},
    )
    links = describe(there).links
    assert links["a <b> & --c"] == "a__b______c"
    assert links["a _b_ & --c"] == "a__b______c_2"
    assert (links["tool"], links["wrist_roll"]) == ("tool_2", "wrist_roll_2")  # those of the arm are taken
    require_same(there, tmp_path / "out", seed=4)
    ElementTree.parse(
        tmp_path / "out/cell.urdf"
    )  # a strict reader: no two dashes in a comment, no control character
    assert r'"\u0001 pen"' in (tmp_path / "out/cell.urdf").read_text()
    disabled = {frozenset(pair) for pair in describe(there).disabled}
    assert frozenset((links[held.name], "tool_2")) in disabled
    assert frozenset((links[held.name], "finger_l")) in disabled


def test_tori_become_capsules_that_keep_the_hole(tmp_path: Path) -> None:
    """Off by no more than 0.25 % of the radius."""
    loop = Body("loop", Torus(0.1, 0.01), transform(rotation((0.3, -1.0, 2.0)), (0.5, 0.2, 0.4)), "wall")
    there = Surroundings(load_a465(0.134112, 0.012), load_unit("crs97").limits(), (loop,))
    require_same(there, tmp_path / "out", seed=5, error=0.0025 * 0.1)
    urdf = ElementTree.parse(tmp_path / "out/cell.urdf")
    origins = urdf.findall("link[@name='loop']/collision/origin")
    centres = [[float(v) for v in origin.attrib["xyz"].split()] for origin in origins]
    assert len(centres) == 3 * 32  # cylinders and balls
    assert np.linalg.norm(centres, axis=1) == pytest.approx(0.1, rel=0.0025)


def test_a_calibrated_cell_exports_the_corrected_arm(tmp_path: Path) -> None:
    shutil.copytree(data_file("scenes"), tmp_path / "scenes")
    path = tmp_path / "scenes" / "uncalibrated" / "cell.toml"
    before = read_cell(path)
    d, a, alpha = 2e-3 * np.random.default_rng(5).normal(size=(3, 6))
    offsets = frozen(np.radians([0.0, 0.3, -0.3, 0.3, -0.3, 0.0]))
    calibration = ArmCalibration(
        before.nominal_camera.T_base_camera,
        offsets,
        LinkErrors(frozen(d), frozen(a), frozen(alpha)),
        "crs93",
        before.camera.lens_digest,
        A465.digest,
    )
    write_arm_calibration(path.parent / "c.toml", calibration)
    apply_calibration(path, path.parent / "c.toml")
    there = surroundings_of_file(path, None)
    require_same(there, tmp_path / "out", seed=6)
    exported, nominal = Exported(tmp_path / "out"), before.nominal_robot()
    q = np.radians([10, -30, -60, 20, -40, 5])
    moved = exported.T_base("tool", exported.q(q, there.robot)) - nominal.T_base_tool(q)
    assert np.linalg.norm(moved[:3, 3]) > 5e-4
    calibrated = read_cell(path)
    assert exported.model.lowerPositionLimit[:6] == pytest.approx(calibrated.unit.lower, abs=1e-12)
    assert exported.model.upperPositionLimit[:6] == pytest.approx(calibrated.unit.upper, abs=1e-12)


def test_the_srdf_has_groups_states_and_a_reason_for_every_pair(tmp_path: Path) -> None:
    path = data_file("scenes/cell.toml")
    said, _ = a465("export", path, "-o", tmp_path / "out")
    assert "cell.srdf, cell.urdf" in said
    exported, cell = Exported(tmp_path / "out"), read_cell(path)
    reference = exported.model.referenceConfigurations
    assert reference["q_start"][:6] == pytest.approx(cell.q_start, abs=1e-12)
    assert reference["home"][:6] == pytest.approx(cell.unit.soft_home, abs=1e-12)
    assert reference["jaws"][6:] == pytest.approx([0.03, 0.03])
    assert exported.model.velocityLimit[:6] == pytest.approx(cell.limits.velocity, abs=1e-12)
    srdf = ElementTree.parse(tmp_path / "out/cell.srdf")
    chain = srdf.find("group[@name='arm']/chain")
    assert chain is not None
    assert chain.attrib == {"base_link": "base", "tip_link": "tool"}
    effector = srdf.find("end_effector")
    assert effector is not None
    assert effector.attrib == {"name": "hand", "parent_link": "flange", "group": "gripper"}
    urdf = ElementTree.parse(tmp_path / "out/cell.urdf")
    links = {e.attrib["name"] for e in urdf.iter("link")}
    assert {e.attrib["name"] for e in srdf.findall("group[@name='gripper']/link")} <= links
    off = [
        (e.attrib["link1"], e.attrib["link2"], e.attrib["reason"]) for e in srdf.iter("disable_collisions")
    ]
    assert all(a in links and b in links and reason for a, b, reason in off)
    assert ("table", "camera_post", "both stand still") in off
    assert ("forearm", "elbow", "adjacent") in off
    colliding = [e for e in urdf.iter("link") if e.find("collision") is not None]
    assert all(len(e.findall("visual")) == len(e.findall("collision")) for e in colliding)


def test_padding_is_told_because_urdf_has_none(tmp_path: Path) -> None:
    said, _ = a465("export", data_file("scenes/fixtures/padding.toml"), "-o", tmp_path / "out")
    assert "padding of" in said
    assert "off every distance" in (tmp_path / "out/cell.srdf").read_text()


def test_what_does_not_go_together_is_refused(tmp_path: Path) -> None:
    scene, console = data_file("scenes/fixtures/capsule.toml"), Console(as_json=True)
    named = tmp_path / "plan.json"  # what it is, is told by its content
    shutil.copy(scene, named)
    assert export_file(named, ExportOptions(output=tmp_path / "by content"), console)["format"] == "urdf"
    for asked, rule in (
        (
            ExportOptions(form="csv"),
            "--format csv: must be one of urdf, as .* is a scene, cell, task or arm file",
        ),
        (ExportOptions(planned=True), "--planned does not go with a scene"),
        (ExportOptions(period=0.1), "--period does not go with"),
        (ExportOptions(cell=scene), "--cell does not go with"),
        (ExportOptions(unit="crs93"), "--unit does not go with"),
        (ExportOptions(look=scene), "leave out --look"),
    ):
        with pytest.raises(InputError, match=rule):
            export_file(scene, asked, console)
    (tmp_path / "other.json").write_text('{"scenes": []}')
    with pytest.raises(InputError, match="is a look, and a plan belongs here"):
        export_file(tmp_path / "other.json", ExportOptions(), console)
    camera = data_file("scenes/cameras/lab.toml")
    with pytest.raises(
        InputError, match="is a camera file; export takes a log, a plan, or a scene, cell, task"
    ):
        export_file(camera, ExportOptions(form="csv"), console)
    replace_in(named, 'unit = "crs93"', 'unit = "crs99"')
    _, told = a465("export", named, "-o", tmp_path / "never", code=2)
    assert "plan.json: unit = 'crs99'" in told
    assert not (tmp_path / "never").exists()
