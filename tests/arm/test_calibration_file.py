"""A calibration as a file, and what it makes of a unit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm.calibration_file import ArmCalibration, read_arm_calibration, write_arm_calibration
from arm.controller.unit import UNITS, load_unit
from arm.errors import FileInputError
from arm.robot.link_errors import LinkErrors
from arm.se3 import frozen, rotation, transform
from typed.command_line import replace_in

LINKS = 1e-4 * np.random.default_rng(0).normal(size=(3, 6))

OFFSETS = frozen(np.radians([0.0, 0.31, -0.27, 0.003, -0.4, 0.0]))

LINK_KEYS = ("dh_d_error_m", "dh_a_error_m", "dh_alpha_error_rad")

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


def test_the_id_depends_on_every_value() -> None:
    T, turned = FOUND.T_base_camera, FOUND.joint_offsets.copy()
    turned[4] += 1e-12
    others = [
        replace(FOUND, T_base_camera=T @ transform(t=(1e-12, 0.0, 0.0))),
        replace(FOUND, joint_offsets=frozen(turned)),
        replace(FOUND, links=LinkErrors.none()),
        replace(FOUND, unit="crs97"),
        replace(FOUND, lens="abd"),
        replace(FOUND, dh="deg"),
        replace(FOUND, made={"poses": 25, "ok": True}),
    ]
    assert len({FOUND.id, *(c.id for c in others)}) == 8
    assert replace(FOUND, made={"ok": True, "poses": 24}).id == FOUND.id


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("0.00541052", "0.00541053", "id"),
        ('unit = "crs93"', 'unit = "crs97"', "id"),
        ("joint_offsets_rad = [0.0,", "joint_offsets_rad = [0.1,", "joint_offsets_rad"),
        ("  [0.0, 0.0, 0.0, 1.0],\n", "  [0.0, 0.0, 0.1, 1.0],\n", "T_base_camera"),
        ("[made]", "[maid]", "maid"),
        ("poses = 24", "poses = 99", "id"),
        ("joint_offsets_rad = ", "joint_offset_rad = 1.0\njoint_offsets_rad = ", "joint_offset_rad"),
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


@pytest.mark.parametrize(
    ("changed", "key", "rule"),
    [
        ({"covariance": -np.eye(39)}, "covariance", "must be a covariance: 39 rows of 39 finite numbers"),
        ({"covariance": np.eye(39) + 0.1 * np.eye(39, k=1)}, "covariance", "symmetric, without negative"),
        (
            {"intrinsics": np.zeros(9)},
            "intrinsics",
            "must be [fx, fy, cx, cy, k1, k2, p1, p2, k3] with fx, fy above 0",
        ),
        ({"intrinsics": np.array([4e3, -4e3, *[0.0] * 7])}, "intrinsics", "with fx, fy above 0"),
    ],
)
def test_values_that_no_calibration_has_are_refused(
    tmp_path: Path, changed: dict[str, np.ndarray], key: str, rule: str
) -> None:
    path = tmp_path / "c.toml"
    write_arm_calibration(path, replace(FOUND, **changed))
    with pytest.raises(FileInputError) as refused:
        read_arm_calibration(path)
    assert refused.value.data["key"] == key
    assert rule in str(refused.value.data["rule"])
    assert f"{path}: {key}" in str(refused.value)


@pytest.mark.parametrize("which", range(3))
@pytest.mark.parametrize("joint", range(6))
def test_link_errors_of_a_single_kind_are_written(tmp_path: Path, which: int, joint: int) -> None:
    values = np.zeros((3, 6))
    values[which, joint] = -1e-4
    links = LinkErrors(*map(frozen, values))
    path = tmp_path / "c.toml"
    write_arm_calibration(path, replace(FOUND, links=links))
    assert read_arm_calibration(path).links.to_json() == values.tolist()


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("key", "largest"),
    [
        ("joint_offsets_rad", np.radians(5.0)),
        ("dh_d_error_m", 0.02),
        ("dh_a_error_m", 0.02),
        ("dh_alpha_error_rad", np.radians(2.0)),
    ],
)
def test_errors_beyond_the_largest_are_refused(tmp_path: Path, key: str, largest: float, sign: float) -> None:
    path = tmp_path / "c.toml"
    for part, allowed in ((0.999, True), (1.001, False)):
        off = np.zeros(6)
        off[3] = sign * part * largest
        rows = {"joint_offsets_rad": OFFSETS, **dict(zip(LINK_KEYS, LINKS, strict=True)), key: frozen(off)}
        links = LinkErrors(*(frozen(rows[name]) for name in LINK_KEYS))
        written = replace(FOUND, joint_offsets=rows["joint_offsets_rad"], links=links)
        write_arm_calibration(path, written)
        if allowed:
            assert read_arm_calibration(path).id == written.id
            continue
        with pytest.raises(FileInputError) as refused:
            read_arm_calibration(path)
        assert refused.value.data["key"].rstrip(".") == key


@pytest.mark.parametrize(
    "value",
    [
        "2026-11-22",
        "2026-11-22T10:00:00Z",
        "10:00:00",
        "nan",
        "-inf",
        "[1, [nan]]",
        "{a = 1}",
        "[{a = 1}]",
        "1e999",
    ],
)
def test_unwritable_information_is_refused_by_key(tmp_path: Path, value: str) -> None:
    path = tmp_path / "c.toml"
    write_arm_calibration(path, FOUND)
    replace_in(path, "poses = 24", f"poses = 24\nwhen = {value}")
    with pytest.raises(FileInputError, match=r"made\.when.*: must be a string, a finite number") as refused:
        read_arm_calibration(path)
    assert refused.value.data["key"] == "made.when"
    assert len(str(refused.value).splitlines()) == 1


@pytest.mark.parametrize("name", UNITS)
def test_a_calibrated_unit_gives_true_joint_positions(name: str) -> None:
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
