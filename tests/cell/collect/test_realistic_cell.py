"""The cell of `make run`: its own commands find the calibration that it ships (docs/simulated-cell.md)."""

from __future__ import annotations

import re
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm.io.storage import data_file
from arm.se3 import Array, inverse, rot_x, transform
from cell.config.cell import Cell
from cell.config.cell_file import read_cell
from cell.files.task import read_task
from cell.files.world import World, read_world
from plan.kinematics.ik import inverse_kinematics
from tasks.whole_run import run_whole
from typed.command_line import a465, replace_in
from typed.doc_pages import ROOT

REALISTIC = data_file("scenes/realistic")
SIGMAS = 2.0  # standard deviations of the tool by which two sessions may differ
MADE = ("camera.toml", "calibration.toml", "calibration.background.npz")


def _world(name: str) -> World:
    return read_world(REALISTIC / name, 0.036)


def test_both_sessions_are_of_one_cell() -> None:
    """What is built is the same, and errors are as large; noise and sway differ, and the day is brighter."""
    run, calibration = _world("task2.world.toml"), _world("calibration-world.toml")
    assert run.build_seed == calibration.build_seed
    assert run.seed != calibration.seed
    as_dark = replace(run.image, exposure=calibration.image.exposure)
    assert str(as_dark) == str(calibration.image)
    assert run.image.exposure > calibration.image.exposure
    for part in ("table", "prints", "made", "arm"):
        assert str(getattr(run, part)) == str(getattr(calibration, part))
    assert np.array_equal(run.joint_offsets, calibration.joint_offsets)
    assert run.camera is not None
    assert run.camera.digest == calibration.camera.digest  # type: ignore[union-attr]
    assert not calibration.boards


def test_the_demonstration_is_calibrated_and_has_errors() -> None:
    cell, world = read_task(REALISTIC / "task2.toml").cell, _world("task2.world.toml")
    assert cell.calibration is not None
    offsets = np.degrees(cell.calibration.joint_offsets[1:5])  # with the mean of eccentricity and sag
    assert offsets == pytest.approx([0.3, -0.3, 0.3, -0.3], abs=0.03)
    assert cell.camera.lens_digest != world.camera.lens_digest  # type: ignore[union-attr]
    image, arm = world.image, world.arm
    assert min(image.sway, image.drift, image.corner_scatter, world.table.specks, world.prints.border) > 0.0
    assert (
        min(world.made.hole, arm.scatter.min(), arm.eccentricity.min(), arm.sag.min(), arm.backlash.min())
        > 0.0
    )


def _seen_tools(cell: Cell, tools: list[Array], of: Cell) -> Array:
    """Where the camera of a cell sees the tool (n, 3) mm, at the encoder counts with which `of` reaches `tools`."""
    found = []
    for T in tools:
        q = inverse_kinematics(of.robot(), T, of.unit.lower, of.unit.upper).q[0]
        T_base_tool = cell.robot().T_base_tool(cell.unit.positions(of.unit.counts(q)))
        found.append(1e3 * (inverse(cell.camera.T_base_camera) @ T_base_tool)[:3, 3])
    return np.array(found)


def _told_mm(cell: Cell) -> float:
    """Standard deviation of the tool in the holes, mm, all directions."""
    assert cell.calibration is not None
    made = cell.calibration.made
    return float(np.hypot(made["tool_sideways_mm"], made["tool_height_mm"]))


@pytest.mark.slow
@pytest.mark.long
def test_the_commands_of_the_page_find_the_shipped_calibration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(data_file("scenes"), tmp_path / "scenes")
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "scenes/realistic"
    for name in MADE:
        (folder / name).unlink()
    own = (folder / "cell.toml").read_text()
    (folder / "cell.toml").write_text(re.sub(r"(?m)^(calibration|background) = .*\n", "", own))
    replace_in(folder / "cell.toml", "photographs = 5", "photographs = 2")
    page = (ROOT / "docs/simulated-cell.md").read_text()
    typed = [
        line.split()[1:] for line in page.splitlines() if line.startswith("a465 ") and " run " not in line
    ]
    assert [words[0] for words in typed] == ["render", "calibrate", "calibrate"]
    a465(*typed[0])
    a465(*typed[1])
    tape = (tmp_path / "scenes/uncalibrated/camera.toml").read_text()
    pose = tape[tape.index("[pose]") : tape.index("[calibration]")]
    (folder / "camera.toml").write_text(f"{(tmp_path / 'lens.toml').read_text()}\n{pose}")
    a465(*typed[2])
    shipped, made = read_cell(REALISTIC / "cell.toml"), read_cell(folder / "cell.toml")
    lens = tomllib.loads((REALISTIC / "camera.toml").read_text())["intrinsics"]["covariance"]
    std_px = np.sqrt(np.diag(lens))[:4]  # of fx, fy, cx, cy: what the lens is worth without the arm's poses
    apart_px = (made.camera.K - shipped.camera.K)[[0, 1, 0, 1], [0, 1, 2, 2]]
    assert (np.abs(apart_px) < SIGMAS * std_px).all()
    down = transform(rot_x(np.pi))
    tools = [transform(t=(x, y, z)) @ down for x in (0.42, 0.54) for y in (-0.15, 0.15) for z in (0.06, 0.15)]
    apart = _seen_tools(made, tools, shipped) - _seen_tools(shipped, tools, shipped)
    told_mm = np.sqrt(2.0) * min(_told_mm(shipped), _told_mm(made))  # fewer photographs excuse nothing
    assert np.linalg.norm(apart, axis=1).max() < SIGMAS * told_mm


@pytest.mark.slow
def test_the_demonstration_places_all_cubes(tmp_path: Path) -> None:
    run = run_whole(REALISTIC / "task2.toml", tmp_path / "run")
    assert run.error is None, run.said
    cubes = run.report["cubes"]
    assert [c["placed"] for c in cubes] == [True] * 4
    assert max(c["error_mm"] for c in cubes) < 0.6
