"""What a calibration changes of the cell is told, against the calibration that the cell has."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm.calibration_file import ArmCalibration
from arm.robot.link_errors import LinkErrors
from arm.robot.shapes import Sphere
from arm.se3 import frozen, rot_z, transform
from calib.hand_eye.calibrate import HandEye
from calib.hand_eye.verdict import HandEyeLimits, WorkPlace
from cell.commands.calibration import chain
from cell.commands.calibration.cell_change import change_of, work_place
from cell.commands.calibration.chain import ChainOptions, hand_eye_step
from cell.config.cell import Cell
from cell.config.cell_file import read_cell
from cell.report.chain import chain_page
from recorded.found_chains import MORE, refused
from typed.command_line import replace_in
from typed.heard import Heard


@pytest.fixture
def same(found: HandEye, scenes: Path) -> Cell:
    """A cell that uses the very calibration."""
    cell = read_cell(scenes / "cell.toml")
    made = ArmCalibration(found.T_base_camera, found.joint_offsets, LinkErrors(*found.link_errors), "crs97")
    return replace(cell, calibration=made, camera=cell.camera.at(found.T_base_camera))


def test_what_moved_is_told_in_mm_and_deg(found: HandEye, same: Cell) -> None:
    assert same.calibration is not None
    offsets = np.array(found.joint_offsets)
    offsets[1] -= np.radians(0.3)
    before = replace(same.calibration, joint_offsets=frozen(offsets))
    aside = found.T_base_camera @ transform(rot_z(np.radians(0.3)), (0.003, 0.004, 0.0))
    change = change_of(found, replace(same, calibration=before, camera=same.camera.at(aside)))
    assert str(change) == f"camera moved 5.0 mm, 0.30 deg; J2 +0.30 deg (against cell.toml with {before.id})"
    assert change.json()["camera_mm"] == pytest.approx(5.0)
    assert change.json()["joints_deg"] == pytest.approx([0.0, 0.3, 0.0, 0.0, 0.0, 0.0], abs=1e-9)


def test_what_changed_is_drawn_before_and_after(found: HandEye, same: Cell) -> None:
    assert same.calibration is not None
    offsets = np.array(found.joint_offsets)
    offsets[1] -= np.radians(0.3)
    before = replace(same.calibration, joint_offsets=frozen(offsets))
    aside = np.array(found.T_base_camera)
    aside[:3, 3] += (0.003, -0.004, 0.0)
    rows = change_of(found, replace(same, calibration=before, camera=same.camera.at(frozen(aside)))).rows
    assert [row.name for row in rows] == [
        *(f"camera {axis}, mm" for axis in "xyz"),
        *(f"J{j}, deg" for j in range(1, 7)),
    ]
    assert [row.was for row in rows[:3]] == [0.0] * 3
    assert [row.now for row in rows[:3]] == pytest.approx([-3.0, 4.0, 0.0], abs=1e-9)
    assert [row.sigma for row in rows[:3]] == pytest.approx(1e3 * found.camera_sigma[0])
    j2 = np.degrees(found.joint_offsets[1])
    assert (rows[4].was, rows[4].now) == pytest.approx((j2 - 0.3, j2))
    assert rows[3].was == pytest.approx(rows[3].now)
    page = chain_page("Camera and arm", "r.json", found.chain, [], changed=rows, against="cell.toml with it")
    section = page[page.index("<h2>Before and after</h2>") :]
    section = section[: section.index("</section>")]
    assert "Circle: cell.toml with it." in section
    assert f"{j2 - 0.3:+.3f} to {j2:+.3f}".replace("-", "\N{MINUS SIGN}") in section
    was = [float(v) for v in re.findall(r'<circle cx="([-\d.]+)" r="4"', section)]
    now = [float(v) for v in re.findall(r'<circle cx="([-\d.]+)" r="3"', section)]
    assert was[:3] == [0.0] * 3
    assert now[0] / now[1] == pytest.approx(-0.75, abs=0.01)
    assert (now[4] - was[4]) / now[4] == pytest.approx(0.3 / j2, rel=0.05)
    assert max(map(abs, was + now)) < 109.5  # half of what is left between names and figures
    assert "<h2>Before and after</h2>" not in chain_page("Camera and arm", "r.json", found.chain, [])


def test_what_is_within_its_standard_deviation_has_not_moved(found: HandEye, same: Cell) -> None:
    within = 0.5 * float(np.linalg.norm(found.camera_sigma[0]))
    aside = found.T_base_camera @ transform(t=(within, 0.0, 0.0))
    change = change_of(found, replace(same, camera=same.camera.at(aside)))
    assert str(change).startswith(f"camera as before, within {1e3 * within:.2f} mm, 0.000 deg (against")


def test_a_cell_without_calibration_is_compared_as_it_is_nominally(found: HandEye, same: Cell) -> None:
    change = change_of(found, replace(same, calibration=None))
    assert change.offsets == pytest.approx(found.joint_offsets)
    applied = np.array(found.link_errors)[:, :-1]
    assert change.links == pytest.approx((np.abs(applied[:2]).max(), np.abs(applied[2]).max()))
    assert "links by up to" in str(change)
    assert str(change).endswith("(against cell.toml)")


def test_places_are_all_over_the_zone(same: Cell) -> None:
    place = work_place(same)
    assert place.holes is not None
    apart = np.ptp(place.holes, axis=0)
    assert apart == pytest.approx(0.8 * np.array([0.44, 0.54, 0.216]))
    assert place.holes.mean(axis=0) == pytest.approx(same.zone.T_base_body[:3, 3])
    assert place.T_flange_tool[2, 3] == pytest.approx(same.gripper.length)
    post = replace(same.zone, shape=Sphere(0.3))
    assert work_place(replace(same, zone=post)).holes is None, "those of the image"


def test_limits_of_a_cell_are_the_usual_ones_unless_it_says_otherwise(same: Cell) -> None:
    usual = HandEyeLimits()
    assert (same.tool_sideways, same.tool_height) == pytest.approx((usual.sideways, usual.height))


def test_a_cell_to_compare_with_gives_the_first_line_the_limits_and_the_places(
    found: HandEye, data: Path, scenes: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[HandEyeLimits, WorkPlace]] = []

    def calibrate(_: object, limits: HandEyeLimits, __: object, place: WorkPlace) -> HandEye:
        asked.append((limits, place))
        return refused(found)

    monkeypatch.setattr(chain, "calibrate_hand_eye", calibrate)
    monkeypatch.setattr(chain, "next_poses", lambda *_, **__: MORE)
    own = "[tool]\nleast_certain_mm = 0.4\nleast_certain_height_mm = 0.8"
    replace_in(scenes / "cell.toml", "[tool]", own)
    replace_in(scenes / "cell.toml", 'unit = "crs93"', f'unit = "{found.recording.unit}"')
    heard = Heard()
    result = hand_eye_step(data, ChainOptions(cell=scenes / "task2.toml"), heard)
    hand_eye_step(data, ChainOptions(cell=scenes / "cell.toml", limit_mm=0.5), Heard())
    (limits, place), (by_option, _), *_ = asked
    assert (limits.sideways, limits.height) == pytest.approx((0.4e-3, 0.8e-3))
    assert (by_option.held_out, by_option.sideways, by_option.height) == pytest.approx((0.5e-3,) * 3)
    assert np.array_equal(place.holes, work_place(read_cell(scenes / "cell.toml")).holes)  # type: ignore[arg-type]
    assert not any("NOTE" in line for line in heard.told)
    replace_in(scenes / "cameras/lab.toml", "4746.48725", "4746.5")
    other = Heard()
    hand_eye_step(data, ChainOptions(cell=scenes / "cell.toml"), other)
    (note,) = (line for line in other.told if "NOTE" in line)
    assert f"the lens of {data} is not that of lab.toml: {scenes / 'cell.toml'} takes no calibration" in note
    first = next(line for line in heard.told if "camera" in line)
    assert first.startswith("camera moved ")
    assert first.endswith("(against cell.toml)")
    assert result["changed"]["against"] == "cell.toml"
