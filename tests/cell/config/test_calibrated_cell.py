"""A cell that names a calibration: what it changes, what it refuses, and how the name comes into its file."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from arm.calibration_file import ArmCalibration, write_arm_calibration
from arm.errors import InputError
from arm.io.storage import data_file
from arm.robot.dh import A465
from arm.robot.link_errors import LinkErrors
from arm.se3 import frozen, transform
from cell.config.cell import Cell
from cell.config.cell_file import read_cell
from cell.files.apply_calibration import apply_calibration
from cell.files.task import read_task
from cell.files.world import read_world
from cell.scene.fingerprint import plan_fingerprint
from cell.sim.cell import SimulatedCell

OFFSETS = frozen(np.radians([0.0, 0.3, -0.3, 0.3, -0.3, 0.0]))


@pytest.fixture
def scenes(tmp_path: Path) -> Path:
    shutil.copytree(data_file("scenes"), tmp_path / "scenes")
    return tmp_path / "scenes" / "uncalibrated"


def calibration_of(
    cell: Cell,
    unit: str = "crs93",
    lens: str | None = None,
    links: LinkErrors | None = None,
    dh: str = A465.digest,
) -> ArmCalibration:
    T = cell.nominal_camera.T_base_camera @ transform(t=(0.003, -0.004, 0.0))
    lens = cell.camera.lens_digest if lens is None else lens
    return ArmCalibration(frozen(T), OFFSETS, links or LinkErrors.none(), unit, lens, dh)


def test_it_moves_the_camera_and_the_zeros_and_nothing_else(scenes: Path) -> None:
    before = read_cell(scenes / "cell.toml")
    then, found = plan_fingerprint(read_task(scenes / "task2.toml")), calibration_of(before)
    write_arm_calibration(scenes / "c.toml", found)
    line = apply_calibration(scenes / "cell.toml", scenes / "c.toml")
    assert line == 'calibration = "c.toml"'
    after = read_cell(scenes / "cell.toml")
    assert after.calibration is not None
    assert after.calibration.id == found.id
    assert np.array_equal(after.camera.T_base_camera, found.T_base_camera)
    assert np.array_equal(after.camera.K, before.camera.K)
    assert np.array_equal(after.nominal_camera.T_base_camera, before.camera.T_base_camera)
    assert after.nominal_unit.digest == before.unit.digest
    counts = before.unit.counts(before.q_start)
    assert np.abs(after.unit.positions(counts) - before.q_start - OFFSETS).max() < 1e-4
    assert after.digest == before.digest
    said = plan_fingerprint(read_task(scenes / "task2.toml"))
    assert said["limits"] != then["limits"]
    assert said["calibration_id"] == found.id
    assert said["calibration"] == after.camera.digest != before.camera.digest


@pytest.mark.parametrize("crooked", [False, True])
def test_with_it_the_arm_is_where_the_plan_has_it(scenes: Path, crooked: bool) -> None:
    """The simulated cell's truth, which is not calibrated by the file."""
    rng = np.random.default_rng(1)
    d, a, alpha = (3e-4 * rng.normal(size=(3, 6))) if crooked else np.zeros((3, 6))
    d[5] = a[5] = alpha[5] = 0.0
    if crooked:
        world_file = scenes / "task2.world.toml"
        lines = {"dh_d_error_mm": 1e3 * d, "dh_a_error_mm": 1e3 * a, "dh_alpha_error_deg": np.degrees(alpha)}
        said = "".join(f"{key} = {value.tolist()}\n" for key, value in lines.items())
        world_file.write_text(said + world_file.read_text())
    task = read_task(scenes / "task2.toml")
    world = read_world(scenes / "task2.world.toml", task.cell.boards[0].marker_size)
    links = LinkErrors(frozen(d), frozen(a), frozen(alpha))
    write_arm_calibration(scenes / "c.toml", calibration_of(task.cell, links=links))
    apply_calibration(scenes / "cell.toml", scenes / "c.toml")
    calibrated = read_cell(scenes / "cell.toml")
    assert (calibrated.robot().digest != task.cell.robot().digest) == crooked
    off = []
    for cell in (task.cell, calibrated):
        truth, robot = SimulatedCell(cell, world), cell.robot()
        q = rng.uniform(-0.8, 0.8, (20, 6))
        shifts = [truth.T_base_tool(cell.unit.counts(x))[:3, 3] - robot.T_base_tool(x)[:3, 3] for x in q]
        off.append(float(np.linalg.norm(shifts, axis=1).max()))
    assert off[0] > 1e-3
    assert off[1] < 5e-5


def test_a_calibration_of_another_arm_or_lens_is_refused(scenes: Path) -> None:
    cell = read_cell(scenes / "cell.toml")
    before = (scenes / "cell.toml").read_bytes()
    for found, rule in (
        (calibration_of(cell, unit="crs97"), "is of crs97, but unit is crs93"),
        (calibration_of(cell, unit=""), "names no unit, but unit is"),
        (calibration_of(cell, lens="0" * 64), "another lens"),
        (calibration_of(cell, dh="0" * 64), "an arm with other dimensions"),
    ):
        write_arm_calibration(scenes / "c.toml", found)
        with pytest.raises(InputError, match=rule):
            apply_calibration(scenes / "cell.toml", scenes / "c.toml")
        assert (scenes / "cell.toml").read_bytes() == before
        (scenes / "named.toml").write_text('calibration = "c.toml"\n' + before.decode())
        with pytest.raises(InputError, match=rule) as refused:
            read_cell(scenes / "named.toml")
        assert refused.value.data["key"] == "calibration"


def test_applying_changes_one_line(scenes: Path) -> None:
    cell = read_cell(scenes / "cell.toml")
    before = (scenes / "cell.toml").read_text().splitlines()
    folder = scenes / "made today"
    folder.mkdir()
    for name in ("c.toml", "made today/d.toml"):
        write_arm_calibration(scenes / name, calibration_of(cell))
        assert apply_calibration(scenes / "cell.toml", scenes / name) == f'calibration = "{name}"'
        after = (scenes / "cell.toml").read_text().splitlines()
        assert [line for line in after if not line.startswith("calibration")] == before
        assert [line for line in after if line.startswith("calibration")] == [f'calibration = "{name}"']
        assert read_cell(scenes / "cell.toml").calibration is not None


def test_a_file_that_is_not_there_is_named(scenes: Path) -> None:
    text = (scenes / "cell.toml").read_text()
    (scenes / "cell.toml").write_text('calibration = "gone.toml"\n' + text)
    with pytest.raises(InputError, match=r"gone\.toml"):
        read_cell(scenes / "cell.toml")
