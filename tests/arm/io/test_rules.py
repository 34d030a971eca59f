"""Rules for the values of files: what they read, in which unit, and that a message holds file, key, value and rule."""

from pathlib import Path

import numpy as np
import pytest

from arm.errors import FileInputError
from arm.io.node import Node
from arm.io.rules import (
    carried,
    covariance_matrix,
    exceeds,
    flag,
    integer,
    integers,
    number,
    numbers,
    path,
    rigid,
    table,
    tables,
    text,
    triple,
    turn,
    turns,
    zero_or,
)

TEXT = """
length_mm = 134.1
count = 3
name = "crs93"
on = true
here = "."
triple = [1, 2, 3]
rows = [[1, 2], [3, 4]]
[sub]
x = 1
[[list]]
y = 2
"""


@pytest.fixture
def root(tmp_path: Path) -> Node:
    path = tmp_path / "t.toml"
    path.write_text(TEXT)
    return Node.of_toml(path)


def test_good_values(root: Node) -> None:
    assert root.get("length_mm", number("mm", 0, 500)) == 134.1 / 1e3
    assert root.get("count", integer(0, 5)) == 3
    assert root.get("count", number()) == 3.0
    assert root.get("name", text("crs93", "crs97")) == "crs93"
    assert root.get("on", flag()) is True
    assert root.get("triple", numbers(3, "counts")).tolist() == [1, 2, 3]
    assert root.get("triple", integers(3, 1, 3)) == (1, 2, 3)
    assert root.get("triple", triple("mm", 0, 3)) == (0.001, 0.002, 0.003)
    assert root.get("rows", numbers((2, 2))).tolist() == [[1, 2], [3, 4]]
    assert root.get("sub.x", integer(0, 1)) == 1
    assert root.get("sub", table()) == {"x": 1}
    assert root.get("list", tables(lambda node: node.get("y", integer(0, 9)))) == (2,)


@pytest.mark.parametrize(
    ("unit", "value"),
    [
        ("mm", 0.18),
        ("mm/s", 0.18),
        ("us", 1.8e-4),
        ("deg", np.pi),
        ("deg/s", np.pi),
        ("s", 180.0),
        ("", 180.0),
    ],
)
def test_values_are_in_si_units(tmp_path: Path, unit: str, value: float) -> None:
    node = Node(tmp_path, "x", 180)
    assert node.read(number(unit)) == value
    assert number(unit, 0, 200).words == f"a number{f' in {unit}' if unit else ''} from 0 to 200"


def test_a_default_is_read_as_if_the_file_had_it(root: Node) -> None:
    assert root.get("absent", number("mm"), 7) == 0.007
    assert root.get("absent", number("mm"), None) is None
    assert root.get("sub.absent", text(), "") == ""
    assert root.get("none.absent", numbers(2, "deg"), [180, 0]).tolist() == [np.pi, 0.0]
    with pytest.raises(FileInputError, match=r"absent = 7: must be a number from 8 to 9"):
        root.get("absent", number("", 8, 9), 7)


@pytest.mark.parametrize(
    ("key", "rule", "message"),
    [
        ("length_mm", number("mm", 200, 500), r"length_mm = 134.1: must be a number in mm from 200 to 500"),
        ("name", number("mm"), "must be a finite number in mm"),
        ("on", number("mm"), "must be a finite number in mm"),
        ("lenght_mm", number("mm"), r"lenght_mm: is missing; it must be a finite .*the file has length_mm"),
        ("length_mm", integer(0, 500), "must be a whole number from 0 to 500"),
        ("on", integer(0, 500), "must be a whole number"),
        ("count", integer(0, 2), "count = 3: must be a whole number from 0 to 2"),
        ("triple", integers(3, 1, 2), "must be 3 whole numbers from 1 to 2"),
        ("count", flag(), "must be true or false"),
        ("name", text("crs97", "crs94"), r"must be one of crs97, crs94 \(did you mean"),
        ("count", text(), "count = 3: must be a string"),
        ("triple", numbers(6, "deg"), "must be 6 finite numbers in deg"),
        ("triple", numbers(3, "mm", 2, 5), r"triple = \[1, 2, 3\]: must be 3 numbers in mm from 2 to 5"),
        ("name", numbers(5, "deg"), "must be 5 finite numbers"),
        ("rows", numbers((4, 4)), "must be 4 rows of 4 finite numbers"),
        ("rows", triple("mm", 0, 9), "must be 3 numbers in mm from 0 to 9"),
        ("count", table(), "must be a table"),
        ("count.x", text(), "count = 3: must be a table"),
        ("count", tables(lambda node: node), "count = 3: must be an array of tables$"),
        ("sub", tables(lambda node: node), r"must be an array of tables \(write \[\[sub\]\], not \[sub\]\)$"),
        ("sub.x", text(), r"sub\.x = 1: must be a string"),
        ("list", tables(lambda node: node.get("y", text())), r"list\[0\]\.y = 2: must be a string"),
        ("name", path(), r"name = 'crs93': names a file that does not exist: .*crs93"),
        ("here", path(), r"here = '\.': names a folder, must name a file: "),
    ],
)
def test_bad_values_are_refused(root: Node, key: str, rule, message: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(FileInputError, match=message) as error:
        root.get(key, rule)
    assert "t.toml" in str(error.value)
    assert {"file", "key", "value", "rule"} <= set(error.value.data)


STD = np.array([1e-5, 1e-5, 1e2])  # m and px: the largest variance is 1e14 times the smallest
CORRELATIONS = np.array([[1.0, 0.9, 0.3], [0.9, 1.0, 0.2], [0.3, 0.2, 1.0]])


def covariance_with(row: int, column: int, correlation: float, both: bool = True) -> np.ndarray:
    C = CORRELATIONS.copy()
    C[row, column] = correlation
    if both:
        C[column, row] = correlation
    return np.asarray(C * np.outer(STD, STD))


@pytest.mark.parametrize(
    "rows",
    [
        -covariance_with(0, 0, 1.0),
        np.diag([-1e-12, 1e-12, 4.0]),
        np.array([[0.0, 1e-12, 0.0], [1e-12, 1e-12, 0.0], [0.0, 0.0, 4.0]]),  # no variance, but a correlation
        covariance_with(0, 1, 0.9 + 2e-6, both=False),
        covariance_with(0, 1, 1.0 + 2e-6),
        covariance_with(0, 2, -0.3),  # each pair is possible, not the three: the least eigenvalue is -0.03
        covariance_with(1, 2, 0.7),
    ],
)
def test_what_is_no_covariance_is_refused(tmp_path: Path, rows: np.ndarray) -> None:
    words = "t.toml: C = .*: must be a covariance: 3 rows of 3 finite numbers, symmetric, without negative variances"
    with pytest.raises(FileInputError, match=words) as refused:
        Node(tmp_path / "t.toml", "C", rows.tolist()).read(covariance_matrix(3))
    assert refused.value.data["key"] == "C"


@pytest.mark.parametrize(
    "rows",
    [
        covariance_with(0, 0, 1.0),
        covariance_with(0, 1, 0.9 + 1e-8, both=False),
        np.zeros((3, 3)),
        np.diag([1e-12, 0.0, 4.0]),
        np.outer(STD, STD) * (1.0 + 1e-14 * np.eye(3)),
        np.outer(STD, STD) * (1.0 - 1e-14 * np.eye(3)),
    ],
)
def test_a_covariance_may_be_rounded_or_singular(tmp_path: Path, rows: np.ndarray) -> None:
    assert Node(tmp_path, "C", rows.tolist()).read(covariance_matrix(3)).tolist() == rows.tolist()


def test_a_covariance_exceeds_another_in_a_single_direction() -> None:
    whole = covariance_with(0, 0, 1.0)
    assert not exceeds(whole, whole)
    assert exceeds(1.00001 * whole, whole)
    least = np.array([1.0, -1.0, 0.0]) * STD  # variance 0.2, from 1 + 1 - 2 * 0.9
    assert not exceeds(0.04 * np.outer(least, least), whole)
    assert exceeds(0.06 * np.outer(least, least), whole)
    assert not exceeds(np.diag([1e-12, 0.0, 4.0]), np.diag([1e-12, 0.0, 4.0]))


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf"), "1", None, True])
def test_only_numbers_are_accepted_in_any_range(tmp_path: Path, value: object) -> None:
    for rule in (number(), number("", 0, 1), number("", 0)):
        with pytest.raises(FileInputError, match="must be a"):
            Node(tmp_path, "x", value).read(rule)
        with pytest.raises(FileInputError, match="must be a"):
            Node(tmp_path, "x", {"y": value})["y"].read(rule)


def test_only_null_is_a_gap(tmp_path: Path) -> None:
    assert np.isnan(Node(tmp_path, "x", [1, None]).read(numbers(2, gaps=True))).tolist() == [False, True]
    for rule in (numbers(2, gaps=True), numbers(2, "", 0, 5, gaps=True)):
        for value in (float("nan"), float("inf")):
            with pytest.raises(FileInputError, match="or null"):
                Node(tmp_path, "x", [1, value]).read(rule)


def test_a_pose_is_rigid_with_numbers_of_this_world(tmp_path: Path) -> None:
    def read(rows: object) -> np.ndarray:
        return Node(tmp_path, "T", rows).read(rigid())

    exact = np.eye(4)[[1, 2, 0, 3]].tolist()
    assert read(exact).tolist() == exact
    printed = np.array([[0.8, -0.6, 0, 1], [0.60001, 0.8, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])
    R = read(printed.tolist())[:3, :3]
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-12)
    with pytest.raises(FileInputError, match=r"T\[0\]\[0\] = 1e\+200: must be from -1e\+09 to 1e\+09"):
        read(np.diag([1e200, 1.0, 1.0, 1.0]).tolist())
    with pytest.raises(FileInputError, match=r"T = .*: "):
        read(np.diag([2.0, 1.0, 1.0, 1.0]).tolist())


@pytest.mark.parametrize(
    "value", [[3.14159, 0, 3.14159], [0, 0, -1.5708], [0.7854, 10, 0], [0, -0.1745, 0], [0.0873, 1.0472, 0]]
)
def test_multiples_of_5_deg_in_rad_are_told_where_deg_belong(value: list[float]) -> None:
    with pytest.raises(FileInputError, match=r"has a multiple of 5 deg in rad \(in deg: \[.*\]\)$"):
        Node(Path("a.toml"), "rpy_deg", value).read(turns(3))


@pytest.mark.parametrize(
    "value",
    [
        [-170.082299, 0, 0],  # 1949 times 5 deg in rad, to four decimals, and more than a turn
        [1.570828, 0, 0],  # 90 deg in rad to four decimals, but not to its six
        [1.57, 0.79, 3.14],
        [1.571, 0.524, -0.35],
        [5, 10, -360],
    ],
)
def test_angles_that_have_not_all_digits_of_a_multiple_of_5_deg_in_rad_are_read(value: list[float]) -> None:
    np.testing.assert_allclose(Node(Path("a.toml"), "rpy_deg", value).read(turns(3)), np.radians(value))


def test_no_drawn_angles_are_refused() -> None:
    rng = np.random.default_rng(0)
    for value in rng.uniform(-180.0, 180.0, (20000, 3)).round(6).tolist():
        Node(Path("a.toml"), "rpy_deg", value).read(turns(3))


def test_one_angle_is_read_as_several_are() -> None:
    assert Node(Path("a.toml"), "yaw_deg", 175).read(turn()) == pytest.approx(np.radians(175))
    with pytest.raises(FileInputError, match=r"yaw_deg = 3.0543: must be in deg, .* \(in deg: 174.998\)$"):
        Node(Path("a.toml"), "yaw_deg", 3.0543).read(turn())
    with pytest.raises(FileInputError, match="must be a number in deg from -360 to 360"):
        Node(Path("a.toml"), "yaw_deg", [175]).read(turn())


@pytest.mark.parametrize(
    "value", [[180, 0, -90], [0.5, 1.57, 3.1], [0, 0, 0], [3, 2, 1], [45.0, 0.786, -6.28], [0.96, 0.35, 0.17]]
)
def test_other_angles_are_read_in_deg(value: list[float]) -> None:
    read = Node(Path("a.toml"), "rpy_deg", value).read(turns(3))
    np.testing.assert_allclose(np.degrees(read), value, atol=1e-12)


@pytest.mark.parametrize(
    ("value", "told"),
    [([0.44, 0.54, 0.216], True), ([0.44, 54, 21.6], False), ([0, 0, 0], False), ([1e9] * 3, False)],
)
def test_sizes_in_metres_are_told(value: list[float], told: bool) -> None:
    with pytest.raises(FileInputError, match="must be 3 numbers in mm from 1 to 10000") as refused:
        Node(Path("a.toml"), "size_mm", value).read(triple("mm", 1, 10000))
    assert str(refused.value).endswith("(is it in metres?)") == told


def test_a_length_that_may_be_0_is_not_too_small_to_be_meant() -> None:
    rule = zero_or(0.5, 1000.0)
    for value, read in ((0, 0.0), (0.5, 5e-4), (60, 0.06)):
        assert Node(Path("a.toml"), "approach_mm", value).read(rule) == pytest.approx(read)
    with pytest.raises(
        FileInputError, match=r"= 0.06: must be 0, or from 0.5 to 1000 mm \(is it in metres\?\)$"
    ):
        Node(Path("a.toml"), "approach_mm", 0.06).read(rule)


def test_a_tool_is_on_the_flange_or_not_too_near_to_it_to_be_meant() -> None:
    rule = carried(5000)
    for value in ([0, 0, 0], [0, 0, 0.5], [-135, 0, 13]):
        read = Node(Path("a.toml"), "tool_mm", value).read(rule)
        assert read == pytest.approx(np.array(value) / 1e3)
    for value in ([0, 0, 0.08], [-0.135, 0, 0.013]):
        with pytest.raises(FileInputError, match=r"must be \[0, 0, 0\], or 0.5 mm .* \(is it in metres\?\)$"):
            Node(Path("a.toml"), "tool_mm", value).read(rule)


def test_a_file_named_from_the_working_folder_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cells/lenses").mkdir(parents=True)
    (tmp_path / "cells/lenses/lab.toml").write_text("")
    for named, told in (
        ("cells/lenses/lab.toml", r'of cell.toml: "lenses/lab.toml"\)$'),
        ("lenses/lap.toml", r'\(is it "lenses/lab.toml"\?\)$'),
    ):
        with pytest.raises(FileInputError, match=told):
            Node(Path("cells/cell.toml"), "camera", named).read(path())
