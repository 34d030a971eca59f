"""What a command may replace: no input, and of the project's files only those of the kind that it writes."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from arm.errors import InputError
from arm.io.outputs import keep_apart, keep_page
from arm.io.storage import data_file
from typed.command_line import a465


def test_an_input_is_not_overwritten_under_any_name(tmp_path: Path) -> None:
    read, other = tmp_path / "plan.json", tmp_path / "page.html"
    read.write_text("{}")
    (tmp_path / "link").symlink_to(read)
    os.link(read, tmp_path / "hard")
    for name in ("plan.json", "link", "hard"):
        with pytest.raises(InputError, match=f"{name}: is read by this command"):
            keep_apart(tmp_path / name, other, None, read)
    keep_apart(other, read)
    keep_apart(None, read)
    other.touch()
    keep_apart(other, read, tmp_path / "not there")


def test_a_file_of_another_kind_is_not_replaced(tmp_path: Path) -> None:
    file, words = tmp_path / "a.json", "and something else would replace it; give another name"
    for text, of in (('{"scenes": []}', "look"), ('{"entries": []}', "list"), ('task = "a"', "task")):
        file.write_text(text)
        for kind in ("", "plan"):
            with pytest.raises(InputError, match=rf"a\.json: is a .*, {words}"):
                keep_apart(file, kind=kind)
        keep_apart(file, kind=of)
        keep_apart(file, kind=None)
    for text in ("<html>", "{}", "[1]", ""):
        file.write_text(text)
        keep_apart(file)
    upper = tmp_path / "B.JSON"
    upper.write_text('{"scenes": []}')
    with pytest.raises(InputError, match=rf"B\.JSON: is a look, {words}"):
        keep_apart(upper)
    with pytest.raises(InputError, match="is a folder; give the name of a file"):
        keep_apart(tmp_path, kind="plan")
    keep_apart(tmp_path, kind=None)


def test_no_command_replaces_a_cell_file(tmp_path: Path) -> None:
    scenes = Path(shutil.copytree(data_file("scenes"), tmp_path / "scenes"))
    other = scenes / "uncalibrated/cell.toml"
    before = other.read_bytes()
    (tmp_path / "plan.json").write_text('{"format": "a465-plan/3"}')
    for typed in (
        ("view", scenes / "cell.toml"),
        ("preview", tmp_path / "plan.json"),
        ("plan", scenes / "hoop/b.toml"),
        ("look", scenes / "task2.toml"),
        ("report", tmp_path),
    ):
        _, told = a465(*typed, "-o", other, code=2, cwd=tmp_path)
        assert f"{other}: is a cell file, and something else would replace it" in told
        assert told.count("\n") == 1
    assert other.read_bytes() == before


POSE = ",".join(["0"] * 12)


@pytest.mark.parametrize(
    ("text", "kind", "words"),
    [
        ("1,2\r\n0,80\r\n80,60\r\n100,140\r\n140,0", "board", "a board file"),
        ("-50,-40,-80,0,-60,0\n", "list", "a list of poses"),
        (f"# taught by hand\nx,y\n{POSE}\n{POSE}\n", "list", "a list of poses"),
        ("time_s,J1_rad,step\n0.0,1.0,a\n", "samples", "a table of samples"),
    ],
)
def test_a_csv_file_of_another_kind_is_not_replaced(tmp_path: Path, text: str, kind: str, words: str) -> None:
    file = tmp_path / "a.csv"
    file.write_text(text)
    for other in {"", "samples", "board", "list"} - {kind}:
        with pytest.raises(InputError, match=rf"a\.csv: is {words}, and something else would replace it"):
            keep_apart(file, kind=other)
    keep_apart(file, kind=kind)


@pytest.mark.parametrize("text", ["", "a,b\n1,2\n", "1,2\n0,80\n", "1\n2\n3\n4\n5\n", "\x00\xff"])
def test_a_csv_file_that_shows_no_kind_is_replaced(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.csv").write_text(text)
    keep_apart(tmp_path / "a.csv")


def test_every_shipped_board_file_is_recognised() -> None:
    files = sorted(data_file("scenes").glob("boards/*.csv"))
    assert files
    for file in files:
        with pytest.raises(InputError, match="is a board file"):
            keep_apart(file, kind="samples")


def test_a_page_has_the_suffix_of_one(tmp_path: Path) -> None:
    for name in ("day.html", "day.htm", "DAY.HTML"):
        keep_page(tmp_path / name)
    for name in ("day.pdf", "day", "day.html.txt"):
        with pytest.raises(InputError, match=rf"{name}: must end in \.html or \.htm, as it is an HTML page$"):
            keep_page(tmp_path / name)
    keep_page(None)
    read = tmp_path / "plan.json"
    read.write_text("{}")
    with pytest.raises(InputError, match="is read by this command"):
        keep_page(read, read)


@pytest.mark.parametrize(
    "typed",
    [
        ("report", "runs", "-o", "day.pdf"),
        ("preview", "plan.json", "-o", "day.pdf"),
        ("view", "cell.toml", "-o", "day.pdf"),
        ("reach", "task.toml", "--page", "day.pdf"),
        ("plan", "task.toml", "--look", "look.json", "--page", "day.pdf"),
        ("certify", "t.json", "cell.toml", "--page", "day.pdf"),
        ("doctor", "--cell", "cell.toml", "-o", "day.pdf"),
        ("calibrate", "camera", "photographs", "--report", "day.pdf"),
    ],
)
def test_no_command_writes_a_page_as_another_format(typed: tuple[str, ...], tmp_path: Path) -> None:
    for name in ("plan.json", "look.json", "t.json", "cell.toml", "task.toml"):
        (tmp_path / name).touch()
    (tmp_path / "photographs").mkdir()
    _, told = a465(*typed, cwd=tmp_path, code=2)
    assert "day.pdf: must end in .html or .htm, as it is an HTML page" in told
    assert not (tmp_path / "day.pdf").exists()
