"""A calibration as a file, and what it makes of a unit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm.armcalibration import ArmCalibration, read_arm_calibration, write_arm_calibration
from arm.errors import FileInputError
from arm.links import LinkErrors
from arm.se3 import frozen, rotation, transform
from arm.unit import UNITS, load_unit
from command_line import replace_in

LINKS = 1e-4 * np.random.default_rng(0).normal(size=(3, 6))
OFFSETS = frozen(np.radians([0.0, 0.31, -0.27, 0.003, -0.4, 0.0]))
ERRORS = LinkErrors(frozen(LINKS[0]), frozen(LINKS[1]), frozen(LINKS[2]))
FOUND = ArmCalibration(
    transform(rotation([0.1, -3.0, 0.2]), (0.49, -0.0147, 1.19)),
    OFFSETS,
    ERRORS,
    "crs93",
    "abc",
    "def",
    {"poses": 24, "ok": True},
)


def test_a_file_is_read_back_to_the_last_bit(tmp_path: Path) -> None:
    path = tmp_path / "c.toml"
    write_arm_calibration(path, FOUND)
    back = read_arm_calibration(path)
    assert np.array_equal(back.T_base_camera, FOUND.T_base_camera)
    assert np.array_equal(back.joint_offsets, FOUND.joint_offsets)
    assert back.links.to_json() == ERRORS.to_json()
    assert (back.unit, back.lens, dict(back.made), back.id) == (
        "crs93",
        "abc",
        {"poses": 24, "ok": True},
        FOUND.id,
    )


def test_the_id_is_of_all_that_a_cell_takes_from_it() -> None:
    T, turned = FOUND.T_base_camera, FOUND.joint_offsets.copy()
    turned[4] += 1e-12
    others = [
        ArmCalibration(T @ transform(t=(1e-12, 0.0, 0.0)), OFFSETS, ERRORS, "crs93", "abc", "def"),
        ArmCalibration(T, frozen(turned), ERRORS, "crs93", "abc", "def"),
        ArmCalibration(T, OFFSETS, ERRORS, "crs97", "abc", "def"),
        ArmCalibration(T, OFFSETS, ERRORS, "crs93", "abd", "def"),
        ArmCalibration(T, OFFSETS, ERRORS, "crs93", "abc", "deg"),
        ArmCalibration(T, OFFSETS, LinkErrors.none(), "crs93", "abc", "def"),
    ]
    assert len({FOUND.id, *(c.id for c in others)}) == 7
    assert ArmCalibration(T, OFFSETS, ERRORS, "crs93", "abc", "def", {"poses": 3}).id == FOUND.id


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("0.00541052", "0.00541053", "id"),
        ('unit = "crs93"', 'unit = "crs97"', "id"),
        ("joint_offsets_rad = [0.0,", "joint_offsets_rad = [0.1,", "joint_offsets_rad"),
        ("  [0.0, 0.0, 0.0, 1.0],\n", "  [0.0, 0.0, 0.1, 1.0],\n", "T_base_camera"),
        ("[made]", "[maid]", "maid"),
        ("dh_a_error_m = [", "dh_a_error_m = [0.0, ", "dh_a_error_m"),
        ("dh_alpha_error_rad = [", "dh_alpha_error_rad = [0.0] #", "dh_alpha_error_rad"),
    ],
)
def test_a_file_that_was_changed_by_hand_is_refused(tmp_path: Path, old: str, new: str, key: str) -> None:
    path = tmp_path / "c.toml"
    write_arm_calibration(path, FOUND)
    replace_in(path, old, new)
    with pytest.raises(FileInputError) as refused:
        read_arm_calibration(path)
    assert refused.value.data["key"].rstrip(".") == key
    assert str(path) in str(refused.value)


@pytest.mark.parametrize("name", UNITS)
def test_a_calibrated_unit_has_its_joints_where_they_truly_are(name: str) -> None:
    unit = load_unit(name)
    calibrated = unit.calibrated(OFFSETS)
    rng = np.random.default_rng(0)
    counts = unit.counts(rng.uniform(unit.lower, unit.upper, (50, 6)))
    moved = calibrated.positions(counts) - unit.positions(counts)
    assert np.abs(moved - OFFSETS).max() <= 0.5 / np.abs(unit.counts_per_rad).min() + 1e-12
    assert np.array_equal(calibrated.counts(calibrated.positions(counts)), counts)


@pytest.mark.parametrize("name", UNITS)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_calibrated_limits_are_inside_what_encoders_and_data_sheet_allow(name: str, sign: float) -> None:
    unit = load_unit(name)
    calibrated = unit.calibrated(sign * OFFSETS)
    for q, of in ((calibrated.lower, unit.lower), (calibrated.upper, unit.upper)):
        inside = unit.positions(calibrated.counts(q))
        assert (inside >= unit.lower - 1e-4).all()
        assert (inside <= unit.upper + 1e-4).all()
        assert np.abs(q - of).max() <= np.abs(OFFSETS).max() + 1e-12
    assert (calibrated.lower >= unit.lower).all()
    assert (calibrated.upper <= unit.upper).all()
    assert calibrated.digest != unit.digest


def test_no_offsets_leave_the_unit_as_it_is() -> None:
    unit = load_unit("crs93")
    assert unit.calibrated(np.zeros(6)) is unit
