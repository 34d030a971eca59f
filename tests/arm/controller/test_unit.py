"""Unit files against the figures of docs/sources.md, "The arm" and "Registers"."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm.controller.unit import UNITS, Limits, Unit, load_unit, noted_unit, unit_called, unit_note
from arm.errors import FileInputError, InputError
from arm.io.storage import data_file


def test_counts_per_degree() -> None:
    k = np.radians(1) * load_unit("crs93").counts_per_rad
    assert k == pytest.approx([1111.111, 1111.111, -1111.111, -561.111, -555.556, -561.111], abs=1e-3)


@pytest.mark.parametrize(
    ("name", "speed", "acceleration"),
    [
        ("crs93", [27.00, 7.20, 18.00, 53.47, 54.00, 133.66], [179.3, 35.16, 70.31, 264.5, 900, 5347]),
        ("crs97", [27.00, 7.20, 18.00, 53.47, 54.00, 98.02], [66.8, 17.58, 45.7, 132.3, 900, 1072]),
    ],
)
def test_default_registers_in_degrees(name: str, speed: list[float], acceleration: list[float]) -> None:
    limits = load_unit(name).limits()
    assert np.degrees(limits.velocity) == pytest.approx(speed, abs=0.006)
    assert np.degrees(limits.acceleration) == pytest.approx(acceleration, rel=2e-3)


@pytest.mark.parametrize("name", UNITS)
def test_limits_keep_a_degree_from_encoder_bounds_and_data_sheet(name: str) -> None:
    unit = load_unit(name)
    sheet = np.array([175, 90, 110, 180, 105, 180])
    lower, upper = np.degrees(unit.lower), np.degrees(unit.upper)
    assert np.all(lower >= -sheet + 1 - 1e-9)
    assert np.all(upper <= sheet - 1 + 1e-9)
    bounds = {
        "crs93": (
            [-169.515, -89.686, -112.680, -185.881, -105.660, -180.178],
            [172.485, 90.314, 115.020, 185.703, 104.940, 183.564],
        ),
        "crs97": (
            [-168.750, -90.227, -115.762, -183.208, -103.860, -182.050],
            [173.250, 89.773, 113.738, 185.703, 104.940, 180.624],
        ),
    }[name]
    assert lower == pytest.approx(np.maximum(bounds[0], -sheet) + 1, abs=1e-3)
    assert upper == pytest.approx(np.minimum(bounds[1], sheet) - 1, abs=1e-3)


def test_soft_home_in_counts() -> None:
    for name, counts in (
        ("crs93", [-181650, -349, -12200, 99200, 33300, -96500]),
        ("crs97", [-182500, 252, -13625, 99200, 39300, -98150]),
    ):
        unit = load_unit(name)
        assert unit.counts(unit.soft_home).tolist() == counts


def test_counts_and_positions_are_inverse_to_half_a_count() -> None:
    unit = load_unit("crs97")
    q = np.random.default_rng(5).uniform(unit.lower, unit.upper, (500, 6))
    assert np.abs(unit.positions(unit.counts(q)) - q).max() <= 0.5 / np.abs(unit.counts_per_rad).min() + 1e-12
    assert np.array_equal(unit.counts(unit.positions(unit.counts(q))), unit.counts(q))


def test_registers_are_capped_at_twice_the_default_and_the_data_sheet() -> None:
    unit = load_unit("crs93")
    assert unit.speed_register_cap() == (15360, 4096, 10240, 15360, 15360, 24563)
    assert np.degrees(unit.limits(unit.speed_register_cap()).velocity[5]) <= 171.0
    with pytest.raises(InputError, match="axis F = 24564: must be from 1 to 24563"):
        unit.limits((7680, 2048, 5120, 7680, 7680, 24564))


def test_an_override_only_lowers() -> None:
    limits = load_unit("crs93").limits()
    half = limits.scaled(0.5)
    assert half.velocity == pytest.approx(limits.velocity / 2)
    assert half.acceleration == pytest.approx(limits.acceleration / 4)
    for speed in (0.0, -1.0, 1.001, float("nan")):
        with pytest.raises(InputError, match="it only lowers what the registers allow"):
            limits.scaled(speed)


def test_gripper_fractions() -> None:
    gripper = load_unit("crs97").gripper
    assert (gripper.axis, gripper.adc(0.0), gripper.adc(1.0)) == ("H", 1001, 48)
    assert gripper.fraction_closed(gripper.adc(0.25)) == pytest.approx(0.25, abs=1e-3)


def test_limits_in_degrees_are_told(tmp_path: Path) -> None:
    text = data_file("urdf/a465/crs93.toml").read_text()
    for key, values in (
        ("lower", [-175, -90, -109, -180, -105, -180]),
        ("upper", [175, 90, 109, 180, 105, 180]),
    ):
        text = re.sub(rf"(?m)^{key}_counts = .*$", f"{key}_counts = {values}", text)
    (tmp_path / "own.toml").write_text(text)
    with pytest.raises(InputError, match=r"lower_counts = .*\(are these degrees\? counts belong here\)$"):
        load_unit(tmp_path / "own.toml")


def test_an_unknown_name_and_a_broken_file_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="crs93, crs97"):
        load_unit("crs95")
    with pytest.raises(FileInputError, match=r"there is no such unit file \(crs93 is shipped: give crs93\)"):
        load_unit(tmp_path / "crs93.toml")
    text = data_file("urdf/a465/crs93.toml").read_text()
    for old, new, message in (
        ("direction = [1, 1, -1, -1, -1, -1]", "direction = [1, 1, 1, -1, -1, -1]", "check direction"),
        ("margin_deg = 1.0", "margin = 1.0", "limits.margin_deg: is missing"),
        ("speed = 500", "speed = 'fast'", "gripper.speed = 'fast': must be a whole number"),
        ('[["B"]', '[["B", "B"]', "homing.sequence"),
        ('axes = ["A",', 'axes = ["B",', "axes = .*: must be six different letters, without G"),
        ('axes = ["A",', 'axes = ["G",', "axes = .*: must be six different letters, without G"),
        ("7680, 19200]", "7680, 24564]", "registers.speed = .*: axis F must be at most 24563"),
        (
            'name = "crs93"',
            'name = "none"',
            "name = 'none': must be up to 40 letters, digits, - and _, and not none",
        ),
        ('name = "crs93"', 'name = "a b"', "name = 'a b': must be"),
        (
            "margin_deg = 1.0",
            "margin_deg = 1.5",
            "name = 'crs93': is that of a shipped unit with other values",
        ),
    ):
        path = tmp_path / "unit.toml"
        assert old in text
        path.write_text(text.replace(old, new))
        with pytest.raises(FileInputError, match=message):
            load_unit(path)


def test_jaws_need_two_positions(tmp_path: Path) -> None:
    text = data_file("urdf/a465/crs93.toml").read_text()
    closed = re.search(r"closed_adc = (\d+)", text)
    assert closed is not None
    (tmp_path / "u.toml").write_text(re.sub(r"open_adc = \d+", f"open_adc = {closed[1]}", text))
    with pytest.raises(FileInputError, match=f"gripper.closed_adc = {closed[1]}: must differ from open_adc"):
        load_unit(tmp_path / "u.toml")


def test_a_copy_of_a_shipped_file_is_that_unit_and_another_name_another_one(tmp_path: Path) -> None:
    file, text = tmp_path / "mine.toml", data_file("urdf/a465/crs97.toml").read_text()
    file.write_text(text)
    assert load_unit(file).digest == load_unit("crs97").digest
    assert load_unit(file).source == load_unit("crs97").source == ""
    file.write_text(text.replace('"crs97"', '"mine"'))
    mine = unit_called(str(file))
    assert (mine.name, mine.source) == ("mine", file.read_text())
    assert unit_called("crs93").name == "crs93"
    again = noted_unit(unit_note(mine))
    assert again is not None
    assert again.digest == mine.digest
    assert unit_note(load_unit(file.with_name("mine.toml"))) == {"unit": "mine", "unit_file": mine.source}
    with pytest.raises(InputError, match="unit = 'mine': must be one of crs93, crs97, or a unit file"):
        unit_called("mine")
    (tmp_path / "cell.toml").write_text('unit = "crs93"\ncamera = "camera.toml"\n')
    with pytest.raises(
        FileInputError, match=r"is a cell file, and a unit file belongs here \(give the unit that it names"
    ):
        unit_called(str(tmp_path / "cell.toml"))


@pytest.mark.parametrize(
    ("key", "wrong"),
    [
        ("axes", "1"),
        ("axes", "{ a = 1 }"),
        ("axes", "[1, 2, 3, 4, 5, 6]"),
        ("axes", '["A", "B", 3, "D", "E", "F"]'),
        ("axes", '["A", "B", "C", "D", "E", "J"]'),
        ("sequence", "5"),
        ("sequence", "{ A = 1 }"),
        ("sequence", "[1, 2]"),
        ("sequence", "[[1], [2]]"),
        ("counts_per_turn", "{ a = 1 }"),
        ("idle_release_s", "{}"),
    ],
)
def test_a_value_of_another_type_is_refused_in_one_line(tmp_path: Path, key: str, wrong: str) -> None:
    text = data_file("urdf/a465/crs93.toml").read_text()
    changed = re.sub(rf"^{key} = .*$", f"{key} = {wrong}", text, count=1, flags=re.MULTILINE)
    assert changed != text
    (tmp_path / "mine.toml").write_text(changed)
    with pytest.raises(FileInputError, match=rf"mine\.toml: (\w+\.)?{key} = .*: must (be|name) "):
        load_unit(tmp_path / "mine.toml")


def test_limits_are_checked_and_cannot_be_changed() -> None:
    given = {"lower": [-1.0, 0.0], "upper": [1.0, 0.0], "velocity": [1, 2], "acceleration": [3.0, 4.0]}
    limits = Limits(**given)
    for key, value in given.items():
        found = getattr(limits, key)
        assert found.tolist() == value
        assert isinstance(found, np.ndarray)
        assert not found.flags.writeable
    for wrong in ([], [[1.0, 2.0]], [1.0], "12", None):
        with pytest.raises(InputError, match=r"limits: velocity = .*must be one number per joint"):
            Limits(**{**given, "velocity": wrong})
    with pytest.raises(InputError, match=r"limits: lower = .*must be one number per joint"):
        Limits(**{key: [] for key in given})
    with pytest.raises(InputError, match=r"lower\[1\] = 0\.1 is above upper\[1\] = 0"):
        Limits(**{**given, "lower": [-1.0, 0.1]})


@pytest.mark.parametrize("key", ["open_adc", "closed_adc"])
def test_positions_of_the_jaws_are_those_of_the_converter(tmp_path: Path, key: str) -> None:
    text = data_file("urdf/a465/crs93.toml").read_text().replace('"crs93"', '"mine"')

    def read(value: int) -> Unit:
        (tmp_path / "mine.toml").write_text(
            re.sub(rf"^{key} = \d+", f"{key} = {value}", text, flags=re.MULTILINE)
        )
        return load_unit(tmp_path / "mine.toml")

    for value in (0, 4095):
        assert getattr(read(value).gripper, key) == value
    for value in (-1, 4096):
        with pytest.raises(
            FileInputError, match=rf"gripper\.{key} = {value}: must be a whole number from 0 to 4095"
        ):
            read(value)


def test_a_joint_without_room_is_refused(tmp_path: Path) -> None:
    text = data_file("urdf/a465/crs93.toml").read_text().replace('"crs93"', '"mine"')
    upper = re.search(r"^upper_counts = .*$", text, re.MULTILINE)
    assert upper is not None
    for lower in (
        upper[0].replace("upper", "lower"),
        re.search(r"^lower_counts = .*$", text, re.MULTILINE)[0],
    ):
        changed = re.sub(r"^lower_counts = .*$", lower, text, flags=re.MULTILINE)
        (tmp_path / "mine.toml").write_text(
            re.sub(r"^margin_deg = \S+", "margin_deg = 0", changed, flags=re.MULTILINE)
        )
        if lower == upper[0].replace("upper", "lower"):
            with pytest.raises(FileInputError, match="must not leave a joint without range"):
                load_unit(tmp_path / "mine.toml")
        else:
            load_unit(tmp_path / "mine.toml")


def test_a_joint_range_of_zero_is_refused(tmp_path: Path) -> None:
    """The data sheet's range is just twice the margin."""
    text, file = data_file("urdf/a465/crs93.toml").read_text(), tmp_path / "own.toml"
    for first, refused in (("1.0", True), ("1.001", False)):
        changed = text.replace("data_sheet_deg = [175.0", f"data_sheet_deg = [{first}").replace(
            "crs93", "mine"
        )
        assert changed != text
        file.write_text(re.sub(r"^(soft_home_deg = \[)[^,]*", r"\g<1>0.0", changed, flags=re.MULTILINE))
        if refused:
            with pytest.raises(FileInputError, match="must not leave a joint without range"):
                load_unit(file)
        else:
            load_unit(file)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("[limits]\n", "[limits]\nmargin_rad = 0.1\n", "limits.margin_rad"),
        (r"counts_per_turn = \[[^,]*", "counts_per_turn = [1000001", r"counts_per_turn.*1e\+06|1000000"),
        (r"counts_per_turn = \[[^,]*", "counts_per_turn = [0.9", "counts_per_turn"),
    ],
)
def test_unknown_keys_and_impossible_counts_are_refused(
    tmp_path: Path, old: str, new: str, told: str
) -> None:
    text = data_file("urdf/a465/crs93.toml").read_text()
    changed = re.sub(old.replace("[limits]", r"\[limits\]"), new, text, count=1)
    assert changed != text
    (tmp_path / "own.toml").write_text(changed)
    with pytest.raises(FileInputError, match=told):
        load_unit(tmp_path / "own.toml")


@pytest.mark.parametrize(
    "given", [(1, 2, 3), "abcdef", 5, (), (1.5,) * 6, (None,) * 6, ((1, 2),) * 6, (float("nan"),) * 6]
)
@pytest.mark.parametrize("name", ["speed", "acceleration"])
def test_registers_must_be_one_integer_per_axis(given: Any, name: str) -> None:
    with pytest.raises(InputError, match=f"{name} registers = .*: must be 6 integers, one per axis of crs93"):
        load_unit("crs93").limits(**{f"{name}_registers": given})


def test_registers_may_be_any_list_of_integers() -> None:
    unit = load_unit("crs93")
    for given in (list(unit.speed_registers), np.array(unit.speed_registers)):
        assert np.array_equal(unit.limits(given).velocity, unit.limits().velocity)  # type: ignore[arg-type]


@pytest.mark.parametrize("value", [[0.0] * 5, [[0.0] * 7] * 3, 1.0, "here", None, [[0.0], [0.0, 1.0]]])
def test_counts_and_positions_of_another_shape_are_refused(value: object) -> None:
    unit = load_unit("crs93")
    for name, function in (("q", unit.counts), ("counts", unit.positions)):
        with pytest.raises(InputError, match=f"{name} = .*: must have 6 numbers, one for each joint"):
            function(value)  # type: ignore[arg-type]


def test_limits_of_the_data_sheet_in_rad_are_told_by_their_key(tmp_path: Path) -> None:
    file, text = tmp_path / "own.toml", data_file("urdf/a465/crs93.toml").read_text().replace("crs93", "mine")
    sheet = re.search(r"^data_sheet_deg = \[(.*)\]", text, re.MULTILINE)
    assert sheet is not None
    in_rad = [float(np.radians(float(value))) for value in sheet[1].split(",")]
    file.write_text(text.replace(sheet[0], f"data_sheet_deg = {in_rad}"))
    with pytest.raises(FileInputError, match=r"own.toml: limits.data_sheet_deg = .*6.28 deg.*is it in rad\?"):
        load_unit(file)


@pytest.mark.parametrize(
    ("key", "value", "told"),
    [
        ("counts_per_turn", "[4000, 4000, 4000, 2000, 2000, 2000]", r"\(are these 4 times too many\?"),
        ("counts_per_turn", "[100, 100, 100, 50, 50, 50]", r"\(are limits, turns and gear of one unit\?"),
        ("soft_home_deg", "[0, 0, -0.7854, 0, -0.7854, 0]", r"\(in deg: \[0, 0, -45.*, 0, -45"),
        ("soft_home_deg", "[0, 0, -145, 0, -45, 0]", r"J3 must be from -109\.0 to 109\.0 deg, its limits"),
        ("firmware", '""', r"firmware = '': must be a string \(an empty one fits every controller\)"),
        ("data_sheet_deg_s", "[3.14, 3.14, 3.14, 2.98, 3.02, 2.98]", r"is limits.data_sheet_deg_s in rad/s\?"),
    ],
)  # fmt: skip
def test_values_of_another_unit_are_told(tmp_path: Path, key: str, value: str, told: str) -> None:
    text = data_file("urdf/a465/crs93.toml").read_text().replace('"crs93"', '"mine"')
    (tmp_path / "mine.toml").write_text(
        re.sub(rf"^{key} = .*$", f"{key} = {value}", text, flags=re.MULTILINE)
    )
    with pytest.raises(FileInputError, match=told):
        load_unit(tmp_path / "mine.toml")
