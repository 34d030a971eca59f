"""Keys declared once: the file is read by them, and an unknown key is named in every refusal."""

from pathlib import Path

import pytest

from arm.errors import FileInputError
from arm.io.keys import Keys, alike, key
from arm.io.node import REQUIRED, Node
from arm.io.rules import integer, number, tables, text


class Wheel(Keys):
    """A table of an array."""

    radius: float = key("radius_mm", number("mm", 1, 500))


class Base(Keys):
    """Keys that two kinds of file share."""

    name: str = key("name", text())


class Cart(Base):
    """All keys of a file."""

    length: float = key("frame.length_mm", number("mm", 1, 5000))
    seats: int = key("frame.seats", integer(0, 9), 2)
    load: float | None = key("load_kg", number("kg", 0, 100), None)
    wheels: tuple[Wheel, ...] = key("wheels", tables(Wheel.read, Wheel), [])


GOOD = {"name": "one", "frame": {"length_mm": 1500}, "wheels": [{"radius_mm": 200}, {"radius_mm": 100}]}


def read(values: dict) -> Cart:
    return Cart.read(Node(Path("cart.toml"), "", values))


def test_the_file_is_read_by_the_declarations() -> None:
    cart = read(GOOD)
    assert (cart.name, cart.length, cart.seats, cart.load) == ("one", 1.5, 2, None)
    assert [wheel.radius for wheel in cart.wheels] == [0.2, 0.1]
    assert read({**GOOD, "load_kg": 7}).load == 7.0
    assert read({"name": "", "frame": {"length_mm": 1, "seats": 0}}).wheels == ()
    with pytest.raises(AttributeError):
        cart.name = "another"  # type: ignore[misc]


class Tool(Keys, file="a file for tests"):
    """Keys of another file."""

    grease: float = key("bearing.grease_mm", number("mm", 1, 5000))
    drawn: int = key("drawn_by", integer(0, 9), 2)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"seats": 3}, r"seats = 3: is not a known key \(it belongs in \[frame\]\)"),
        (
            {"frame": {"length_mm": 1, "load_kg": 3}},
            r"frame.load_kg = 3: .*\(it belongs above the first table\)",
        ),
        (
            {"frame": {"length_mm": 1, "radius_mm": 3}},
            r"frame.radius_mm = 3: .*\(it belongs in \[\[wheels\]\]\)",
        ),
        (
            {"frame": {"length_mm": 1, "frame": 3}},
            r"frame.frame = 3: .*\(it belongs as the table \[frame\] \(its keys: length_mm, seats\)\)",
        ),
        ({"grease_mm": 3}, r"grease_mm = 3: .*\(it belongs in \[bearing\] of a file for tests\)"),
        ({"bearing": {}}, r"belongs as the table \[bearing\] \(its keys: grease_mm\) of a file for tests"),
        ({"drawn_by": 3}, r"\(it belongs above the first table of a file for tests\)"),
    ],
)
def test_a_key_in_the_wrong_table_or_file_is_told_where_it_belongs(change: dict, told: str) -> None:
    with pytest.raises(FileInputError, match=told):
        read({**GOOD, **change})


def test_declarations_are_the_keys_in_order() -> None:
    declared = Cart.declared()
    assert [one.name for one in declared.values()] == [
        "name", "frame.length_mm", "frame.seats", "load_kg", "wheels",
    ]  # fmt: skip
    assert (declared["name"].default, declared["seats"].default) == (REQUIRED, 2)
    assert declared["wheels"].rule.tables == (Wheel,)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"nam": "x"}, r"nam = 'x': is not a known key \(did you mean name\?\)"),
        ({"xyz": 1}, r"xyz = 1: is not a known key \(known: frame, load_kg, name, wheels\)"),
        (
            {"frame": {"length_mm": 1, "seat": 3}},
            r"frame.seat = 3: is not a known key \(did you mean frame.seats",
        ),
        ({"frame.seats": 3}, r"frame.seats = 3: is not a known key"),
        ({"wheels": [{"radius_mm": 1}, {"radius_mm": 1, "x": 2}]}, r"wheels\[1\].x = 2: is not a known key"),
        ({"frame": 3}, r"frame = 3: must be a table \[frame\]$"),
        ({"frame": [{"seats": 3}]}, r"frame = \[\{'seats': 3\}\]: must be a table \[frame\]$"),
        (
            {"frame": 3, "fram": 1},
            r"must be a table \[frame\] \(fram is not a known key: did you mean frame\?\)$",
        ),
        ({"frame": {}}, r"frame.length_mm: is missing; it must be a number in mm from 1 to 5000$"),
        (
            {"frame": {"lenght_mm": 3}},
            r"frame.length_mm: is missing; .*\(frame.lenght_mm is not a known key: did you mean frame.length_mm\?\)",
        ),
        (
            {"frame": {}, "nme": 1, "q": 2},
            r"length_mm: is missing.*\(nme is not a known key: did you mean name\?; q is not a known key\)",
        ),
        (
            {"load_kg": 101, "q": 2},
            r"load_kg = 101: must be a number in kg from 0 to 100 \(is it in g\?; q is not a known key\)",
        ),
        (
            {"q": 1, "wheels": [{"radius_mm": 0, "r": 1}]},
            r"radius_mm = 0: must .*\(q is .* key; wheels\[0\].r is",
        ),
    ],
)
def test_an_unknown_key_is_named_also_where_another_is_missing_or_wrong(change: dict, message: str) -> None:
    with pytest.raises(FileInputError, match=message):
        read({**GOOD, **change})


class Motion(Keys):
    """Two keys that are alike."""

    begin: float = key("from_deg", number("deg", -360, 360))
    end: float = key("to_deg", number("deg", -360, 360))


def test_an_unknown_key_is_likelier_one_that_is_missing_than_one_that_is_there() -> None:
    for there, meant in (("to_deg", "from_deg"), ("from_deg", "to_deg")):
        with pytest.raises(FileInputError, match=rf"{meant}: is missing; .* did you mean {meant}\?\)$"):
            Motion.read(Node(Path("a.toml"), "", {there: 1, "q_deg": 2}))
    with pytest.raises(FileInputError, match=r"to_dg = 2: is not a known key \(did you mean to_deg\?\)$"):
        Motion.read(Node(Path("a.toml"), "", {"from_deg": 1, "to_deg": 1, "to_dg": 2}))


@pytest.mark.parametrize(
    ("name", "known", "meant"),
    [
        ("SVG", ["svg", "axis"], ["svg"]),
        ("at", ["part", "at_mm"], ["at_mm"]),
        ("joints_rad", ["joints_deg", "part"], ["joints_deg"]),
        ("clearence_mm", ["clearance_mm"], ["clearance_mm"]),
        ("zz", ["part", "at_mm"], []),
    ],
)
def test_a_name_in_capitals_or_without_its_unit_is_recognised(
    name: str, known: list[str], meant: list[str]
) -> None:
    assert alike(name, known) == meant


class Wall(Keys):
    centre: float = key("centre_mm", number("mm", 0, 10))
    size: float = key("size_mm", number("mm", 0, 10))
    rpy: float = key("rpy_deg", number("deg", 0, 10), 0)


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("position_mm", "centre_mm"),
        ("xyz", "centre_mm"),
        ("Center", "centre_mm"),
        ("orientation_deg", "rpy_deg"),
        ("rotation", "rpy_deg"),
    ],
)
def test_names_of_other_formats_are_recognised(name: str, meant: str) -> None:
    there = {"size_mm": 3} if meant == "centre_mm" else {"size_mm": 3, "centre_mm": 1}
    with pytest.raises(FileInputError, match=rf"{name}.* is not a known key.*did you mean {meant}\?\)$"):
        Wall.read(Node(Path("a.toml"), "", {name: 1, **there}))


class Jaws(Keys):
    length: float = key("length_mm", number("mm", 0, 10))
    grip_height: float = key("grip_height_mm", number("mm", 0, 10), 0)


@pytest.mark.parametrize(("name", "meant"), [("lenght_mm", "length_mm"), ("grip_hight_mm", "grip_height_mm")])
def test_a_mistyped_key_is_the_one_that_is_there_if_that_is_much_more_alike(name: str, meant: str) -> None:
    with pytest.raises(FileInputError, match=rf"{name} = 2: is not a known key \(did you mean {meant}\?\)$"):
        Jaws.read(Node(Path("a.toml"), "", {"length_mm": 1, name: 2}))
