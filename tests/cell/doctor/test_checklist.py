"""A tick is kept beside the cell, holds for what it was made for, and says when and why it is void."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from arm.errors import FileInputError, InputError
from arm.io.storage import data_file
from arm.io.toml_reader import read_toml
from cell.config.cell import Cell
from cell.config.cell_file import read_cell
from cell.doctor.checklist import (
    ITEM,
    ITEMS,
    Status,
    checklist_file,
    note_of_open,
    read_ticks,
    statuses,
    tick_of,
    write_ticks,
)
from cell.files.task import cell_of
from typed.command_line import replace_in

from .test_cell import calibrated

pytestmark = pytest.mark.xdist_group("doctor")
NAMES = [item.name for item in ITEMS]


def tick_all(cell: Cell) -> None:
    write_ticks(
        cell.file, {name: tick_of(cell, name, "A. Smith", f"{name} is as it must be") for name in NAMES}
    )


def void(file: Path) -> dict[str, str]:
    """Items whose ticks are void, with the reason."""
    return {s.item.name: "; ".join(s.void) for s in statuses(cell_of(file)) if s.tick and s.void}


def test_what_is_written_is_read_and_every_item_has_a_command(scenes: Path) -> None:
    cell = read_cell(scenes / "cell.toml")
    assert [str(s) for s in statuses(cell)] == ["open"] * len(ITEMS)
    tick_all(cell)
    assert checklist_file(cell.file) == scenes / "cell.checklist.toml"
    kept = read_ticks(cell.file)
    assert list(kept) == NAMES
    assert all(status.ticked for status in statuses(cell_of(scenes / "task2.toml")))  # of the same cell file
    assert str(statuses(cell)[0]) == f"{kept['bodies'].when[:10]}, A. Smith: bodies is as it must be"
    write_ticks(cell.file, kept)
    assert read_ticks(cell.file) == kept
    assert all(str(cell.file) in item.command(cell) for item in ITEMS)
    assert all(
        re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d[+-]\d\d:\d\d", tick.when) for tick in kept.values()
    )


@pytest.mark.parametrize(
    ("old", "new", "items", "reason"),
    [
        ('unit = "crs93"', 'unit = "crs97"', set(NAMES) - {"camera"}, "unit crs93, now crs97"),
        ("length_mm = 134.112", "length_mm = 140", {"tool"}, "tool.length_mm 134.112, now 140"),
        ("jaw_opening_mm = 60", "jaw_opening_mm = 61", {"tool"}, "tool.jaw_opening_mm 60, now 61"),
        ("[motion]", "[look.basler]\nexposure_us = 900\n\n[motion]", {"camera"}, "exposure_us is new"),
        ("[tool]", "arm_padding_mm = 12\n\n[tool]", {"bodies"}, "arm_padding_mm 10, now 12"),
        ("offset_mm = 100", "offset_mm = 90", set(), ""),
        (
            "[motion]",
            "[motion]\nspeed_registers = [7000, 2000, 5000, 7000, 7000, 14000]",
            {"limits"},
            "speed_registers [",
        ),
    ],
)
def test_a_tick_is_void_if_what_it_holds_for_changes_and_no_other_is(
    scenes: Path, old: str, new: str, items: set[str], reason: str
) -> None:
    file = scenes / "cell.toml"
    tick_all(read_cell(file))
    assert void(file) == {}
    replace_in(file, old, new)
    found = void(file)
    assert set(found) == items
    assert all(reason in why for why in found.values())
    for status in statuses(read_cell(file)):
        assert status.ticked is (status.item.name not in items)
        assert str(status).startswith("void: changed since it was ticked (") is not status.ticked
    replace_in(file, new, old)
    assert void(file) == {}


def test_another_calibration_makes_what_depends_on_it_void(scenes: Path) -> None:
    tick_all(read_cell(scenes / "cell.toml"))
    file = calibrated(scenes)
    calibration = read_cell(file).calibration
    assert calibration is not None
    assert void(file) == dict.fromkeys(("camera", "homed"), f"calibration none, now {calibration.id}")


def test_another_urdf_makes_both_shapes_void_or_the_one_that_changed(scenes: Path) -> None:
    text = data_file("urdf/a465/a465.urdf").read_text()
    (scenes / "a465.srdf").write_text(data_file("urdf/a465/a465.srdf").read_text())
    (scenes / "a465.urdf").write_text(text)
    file = scenes / "cell.toml"
    lines = file.read_text().splitlines()
    sizes = [line for line in lines if line.startswith(("finger_mm", "palm_mm", "body_radius_mm"))]
    file.write_text("\n".join(line for line in lines if line not in sizes))
    replace_in(file, "length_mm = 134.112", 'length_mm = 134.112\nurdf = "a465.urdf"')
    tick_all(read_cell(file))
    elbow = re.search(r'<link name="elbow">.*?radius="([\d.]+)"', text, re.DOTALL)
    assert elbow is not None
    wider = elbow[0].replace(f'radius="{elbow[1]}"', 'radius="0.0701"')
    (scenes / "a465.urdf").write_text(text.replace(elbow[0], wider))
    assert set(void(file)) == {"bodies"}


def test_passwords_and_odd_characters_are_not_kept(scenes: Path) -> None:
    file = scenes / "cell.toml"
    replace_in(file, "[motion]", '[look.video]\ndevice = "video:rtsp://me:secret@10.0.0.5/live"\n\n[motion]')
    cell = read_cell(file)
    write_ticks(
        file, {"camera": tick_of(cell, "camera", "camera video:rtsp://me:secret@10.0.0.5/live", "a\x1bb")}
    )
    text = checklist_file(file).read_text()
    assert "secret" not in text
    assert read_ticks(file)["camera"].found == "a?b"
    assert statuses(cell)[NAMES.index("camera")].ticked


def test_a_cell_file_that_says_who_compared_the_bodies_ticks_them(scenes: Path) -> None:
    file = scenes / "cell.toml"
    replace_in(file, "[tool]", 'arm_compared = "2026-11-02, A. Smith"\n\n[tool]')
    bodies: Status = statuses(read_cell(file))[0]
    assert bodies.ticked
    assert str(bodies) == "the cell file: arm_compared = 2026-11-02, A. Smith"
    assert not checklist_file(file).exists()


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('format = "a465 checklist"', 'format = "other"', "format"),
        ("version = 1", "version = 2", "version"),
        ("[tool]", "[tools]", "tools is not a known key: did you mean tool?"),
        ("[tool]", "[tool", "is not valid TOML"),
    ],
)
def test_a_damaged_file_is_refused_in_one_line_and_a_run_only_notes_it(
    scenes: Path, old: str, new: str, told: str
) -> None:
    cell = read_cell(scenes / "cell.toml")
    tick_all(cell)
    replace_in(checklist_file(cell.file), old, new)
    with pytest.raises(FileInputError, match=re.escape(told)):
        read_ticks(cell.file)
    note = note_of_open(cell)
    assert note is not None
    assert note.startswith("note: the first-day checklist cannot be read: ")
    assert "\n" not in note


def test_open_items_are_one_line_and_none_are_none(scenes: Path) -> None:
    cell = read_cell(scenes / "cell.toml")
    assert "6 of 6 items of the first-day checklist are open" in str(note_of_open(cell))
    tick_all(cell)
    assert note_of_open(cell) is None
    replace_in(cell.file, "length_mm = 134.112", "length_mm = 140")
    assert "1 of 6" in str(note_of_open(read_cell(cell.file)))
    replace_in(cell.file, "length_mm = 140", "length_mm = 134.112")
    ticks = read_ticks(cell.file)
    write_ticks(cell.file, {name: ticks[name] for name in NAMES if name != "stop"})
    note = str(note_of_open(cell))
    assert note.startswith(
        "note: 1 of 6 items of the first-day checklist are open (emergency stop); a465 doctor --cell"
    )
    with pytest.raises(InputError, match="cannot be written"):
        write_ticks(scenes / "cell.toml/below.toml", ticks)


def test_the_file_says_what_each_tick_holds_for(scenes: Path) -> None:
    cell = read_cell(scenes / "cell.toml")
    tick_all(cell)
    kept = read_toml(checklist_file(cell.file))
    assert kept["tool"]["against"]["tool.length_mm"] == 134.112
    assert all(kept[name]["against"] for name in ITEM)
