"""Keys, rules and defaults in docs/formats.md are those that the readers ask for, and every page is in the contents."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm.calibration_file import ArmCalibration, read_arm_calibration, write_arm_calibration
from arm.io.storage import data_file
from arm.robot.link_errors import LinkErrors
from cell.config.cell_file import read_cell
from cell.files.hand_target import read_hand_target
from cell.files.task import read_task
from cell.files.world import read_world
from typed.asked_keys import LEFT_OUT, REQUIRED, Asked, asked_keys
from typed.command_line import replace_in
from typed.doc_commands import ROOT, pages
from vision.camera.model import read_camera, write_camera

PAGE = (ROOT / "docs/formats.md").read_text()
SHOWN = {"refused": REQUIRED, "none": LEFT_OUT}
WALLS = """
[[walls]]
name = "pipe"
shape = "capsule"
radius_mm = 20
length_mm = 300
centre_mm = [0, 900, 300]

[[walls]]
name = "bracket"
mesh = "fixtures/meshes/bracket.stl"
mesh_unit = "mm"
origin_mm = [0, 900, 100]
"""
BASLER = """[look.basler]
device = "name:one"
exposure_us = 8000
gain_db = 0

"""


def table_of(title: str) -> dict[str, Asked]:
    """What the page says of the keys of a file: each rule, and what counts where the key is not there."""
    section = re.search(rf"^## {title}\n(.*?)(?=^## |\Z)", PAGE, re.M | re.S)
    assert section is not None, title
    rows = re.findall(r"^\| `([^|`]+)` \| ([^|]+?) \| ([^|]+?) \|", section[1], re.M)
    return {key: Asked(rule, SHOWN.get(default, default.strip("`"))) for key, rule, default in rows}


def whole_cell(scenes: Path) -> tuple[Path, Callable[[], object]]:
    """With everything that a cell file may have."""
    cell = scenes / "cell.toml"
    seen = read_cell(cell)
    registers = (seen.unit.speed_registers, seen.unit.acceleration_registers)
    speed, acceleration = (list(r) for r in registers)
    given = f"\nspeed_registers = {speed}\nacceleration_registers = {acceleration}"
    replace_in(cell, "# force_v = 7.5", "force_v = 7.5")
    replace_in(cell, "\n[motion]", f"\n{BASLER}[motion]{given}")
    replace_in(cell, 'camera = "', 'calibration = "calibration.toml"\ncamera = "')
    cell.write_text(cell.read_text() + WALLS)
    links = LinkErrors(np.full(6, 1e-4), np.full(6, 1e-4), np.full(6, 1e-4))
    calibration = ArmCalibration(
        seen.camera.T_base_camera, np.full(6, 1e-3), links, "crs93", seen.camera.lens_digest
    )
    write_arm_calibration(scenes / "calibration.toml", calibration)
    shutil.copy(data_file("urdf/a465/a465.urdf"), scenes / "arm.urdf")

    def read() -> None:
        """With the gripper by its measures, then by a URDF."""
        read_cell(cell)
        text = re.sub(r"(?m)^(finger|palm|body_radius)_mm.*\n", "", cell.read_text())
        cell.write_text(text.replace("[tool]", '[tool]\nurdf = "arm.urdf"'))
        read_cell(cell)

    return cell, read


def whole_calibration(scenes: Path) -> tuple[Path, Callable[[], object]]:
    whole_cell(scenes)
    file = scenes / "calibration.toml"
    return file, lambda: read_arm_calibration(file)


def whole_world(scenes: Path) -> tuple[Path, Callable[[], object]]:
    world = scenes / "task2.world.toml"
    world.write_text('camera = "cameras/lab.toml"\nreleases = ["high"]\n' + world.read_text())
    return world, lambda: read_world(world, 0.036)


def whole_camera(scenes: Path) -> tuple[Path, Callable[[], object]]:
    file = scenes / "cameras/lab.toml"
    write_camera(file, replace(read_camera(file), lens_covariance=np.eye(9)))
    return file, lambda: read_camera(file)


def both_tasks(scenes: Path) -> tuple[Path, Callable[[], object]]:
    """Two kinds under one name, one after the other."""
    file = scenes / "task1.toml"
    other = (scenes / "task2.toml").read_text()

    def read() -> None:
        read_task(file)
        file.write_text(other)
        read_task(file)

    return file, read


def a_target(scenes: Path) -> tuple[Path, Callable[[], object]]:
    file = scenes / "targets/hand.toml"
    return file, lambda: read_hand_target(file)


@pytest.mark.parametrize(
    ("title", "whole"),
    [
        ("Cell file", whole_cell),
        ("Task file", both_tasks),
        ("World file", whole_world),
        ("Camera file", whole_camera),
        ("Target file", a_target),
        ("Calibration file", whole_calibration),
    ],
)
def test_the_page_says_what_the_reader_asks_for(
    title: str, whole: Callable[[Path], tuple[Path, Callable[[], object]]], scenes: Path
) -> None:
    file, read = whole(scenes)
    with asked_keys(file) as asked:
        read()
    told = table_of(title)
    assert set(told) == set(asked)
    for key, said in told.items():
        assert said == asked[key], key


def test_every_page_is_in_the_contents_once() -> None:
    index = (ROOT / "docs/index.md").read_text()
    trees = re.findall(r"```\{toctree\}\n(.*?)```", index, re.S)
    listed = [line for tree in trees for line in tree.splitlines() if line and not line.startswith(":")]
    written = [page.relative_to(ROOT / "docs").with_suffix("").as_posix() for page in pages()[1:]]
    rooms = [f"api/{room}" for room in ("a465", "arm", "plan", "vision", "driver", "render", "calib", "cell")]
    assert sorted([*listed, "index"]) == sorted([*written, *rooms])


def test_every_link_between_pages_leads_somewhere() -> None:
    for page in pages():
        text = re.sub(r"^ *```.*?^ *```", "", page.read_text(), flags=re.M | re.S)
        for target, anchor in re.findall(r"\]\(([^)#:\s]*)(?:#([^)\s]+))?\)", text):
            file = (page.parent / target) if target else page
            assert file.is_file(), f"{page.name}: {target}"
            assert not anchor or anchor in anchors(file), f"{page.name}: {target}#{anchor}"


def anchors(page: Path) -> set[str]:
    """Of the headings of a page, as GitHub and MyST make them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(), re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}
