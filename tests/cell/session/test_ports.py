"""Which port is opened: that of the command line before that of the environment before that of the cell file."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from arm.controller.unit import load_unit
from arm.errors import FileInputError, InputError
from cell.config.cell_file import read_cell
from cell.session.ports import VARIABLE, PortAndPlace, choose_port, port_and_place
from emulated.on_pty import lines_to, names_to, on_pty
from typed.command_line import a465, replace_in
from typed.heard import Heard


def _with_port(scenes: Path, value: str) -> Path:
    cell = scenes / "cell.toml"
    replace_in(cell, 'unit = "crs93"', f'port = {value}\nunit = "crs93"')
    return cell


def test_the_first_that_names_a_port_decides_and_is_told(
    scenes: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell = _with_port(scenes, '"/dev/of-file"')
    for given, variable, file, port, told in (
        ("/dev/given", "/dev/of-variable", cell, "/dev/given", ""),
        (None, "/dev/of-variable", cell, "/dev/of-variable", "port: /dev/of-variable, of A465_PORT"),
        ("cell", "socket://127.0.0.1:4650", None, "socket://127.0.0.1:4650", "of A465_PORT"),
        (None, "", cell, "/dev/of-file", f"port: /dev/of-file, of {cell}"),
        ("cell", "", scenes / "task2.toml", "/dev/of-file", f"port: /dev/of-file, of {cell}"),
        (None, "", scenes / "hoop/a.toml", None, f'write port = "/dev/mars" in {scenes / "hoop/cell.toml"}'),
        (None, "", None, None, "no port is named: give PORT, such as /dev/mars, or set A465_PORT"),
    ):
        monkeypatch.setenv(VARIABLE, variable)
        console = Heard()
        if port is None:
            with pytest.raises(InputError) as refused:
                choose_port(given, file, console)
            assert told in str(refused.value)
            continue
        assert choose_port(given, file, console) == port
        assert told in console.all
        assert (console.all == "") == (told == "")


def test_a_relative_device_of_a_file_is_beside_it_and_another_one_in_the_current_folder(
    scenes: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell = _with_port(scenes, '"mars"')
    assert choose_port(None, cell, Heard()) == str(scenes / "mars") == read_cell(cell).port
    monkeypatch.setenv(VARIABLE, "mars")
    assert choose_port(None, cell, Heard()) == "mars"


@pytest.mark.parametrize(
    ("value", "rule"),
    [
        ("7", "port = 7: must be a string"),
        ('""', "port = '': must be a device, such as /dev/mars, or socket://HOST:PORT"),
        ('"tcp://here:1"', "port = 'tcp://here:1': must be socket://here:1"),
        (
            '"socket://here"',
            "port = 'socket://here': must be socket://HOST:PORT, such as socket://127.0.0.1:4650",
        ),
        ('"127.0.0.1:4650"', "port = '127.0.0.1:4650': must be socket://127.0.0.1:4650, or a device"),
        ('"a\\nb"', "must be a string of one line"),
    ],
)
def test_a_wrong_value_is_refused_with_file_and_key(scenes: Path, value: str, rule: str) -> None:
    cell = _with_port(scenes, value)
    for read in (read_cell, lambda file: choose_port(None, file, Heard())):
        with pytest.raises(FileInputError) as refused:
            read(cell)
        assert rule in str(refused.value)
        assert (refused.value.data["file"], refused.value.data["key"]) == (str(cell), "port")


@pytest.mark.parametrize("header", ["[motion]", "[look.basler]", "[[walls]]"])
def test_a_port_in_a_table_is_told_with_the_table(
    scenes: Path, monkeypatch: pytest.MonkeyPatch, header: str
) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    (scenes / "cell.toml").write_text(f'unit = "crs93"\ncamera = "lab.toml"\n{header}\nport = "/dev/mars"\n')
    with pytest.raises(FileInputError) as refused:
        choose_port(None, scenes / "cell.toml", Heard())
    assert str(refused.value) == (
        f"{scenes / 'cell.toml'}: port: is in {header}, where it is no port; it belongs above the first table"
    )


def test_a_wrong_value_of_the_variable_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "tcp://here:1")
    with pytest.raises(InputError, match=r"A465_PORT = 'tcp://here:1': must be socket://here:1$"):
        choose_port(None, None, Heard())
    monkeypatch.setenv(VARIABLE, '"/dev/mars"')
    with pytest.raises(InputError) as refused:
        choose_port(None, None, Heard())
    assert str(refused.value) == (
        "A465_PORT = '\"/dev/mars\"': has quotes in its value, which are no part of a name; must be /dev/mars"
    )


def test_a_port_of_windows_is_told_with_the_file_that_names_it(
    scenes: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    cell = _with_port(scenes, '"COM3"')
    assert read_cell(cell).port == str(
        scenes / "COM3"
    )  # a device may have that name: refused where it is not there
    with pytest.raises(FileInputError) as refused:
        choose_port(None, cell, Heard())
    why = "is not there: COM3 is a port's name on Windows; here a device is such as /dev/ttyUSB0"
    assert str(refused.value) == f"{cell}: port = 'COM3': {why}"
    (scenes / "COM3").symlink_to("/dev/null")
    assert choose_port(None, cell, Heard()) == str(scenes / "COM3")


def test_one_cell_file_is_enough(tmp_path: Path) -> None:
    assert port_and_place(["/dev/mars"], tmp_path) == PortAndPlace("/dev/mars", tmp_path)
    assert port_and_place(["cell.toml"]) == PortAndPlace(None, Path("cell.toml"))
    assert port_and_place([]) == PortAndPlace(None, None)
    with pytest.raises(InputError, match="give one cell file"):
        port_and_place(["cell.toml"], tmp_path)


def test_the_cell_file_may_stand_before_the_port_or_after_it() -> None:
    both = PortAndPlace("/dev/mars", Path("cell.toml"))
    assert port_and_place(["cell.toml", "/dev/mars"]) == port_and_place(["/dev/mars", "cell.toml"]) == both
    with pytest.raises(InputError, match=r"^/dev/a and /dev/b: give one port$"):
        port_and_place(["/dev/a", "cell.toml", "/dev/b"])


def test_the_port_does_not_change_what_a_plan_is_made_for(scenes: Path) -> None:
    before = read_cell(scenes / "cell.toml").digest
    assert read_cell(_with_port(scenes, '"/dev/mars"')).digest == before


def test_commands_find_the_arm_by_the_cell_file(scenes: Path, tmp_path: Path) -> None:
    log, unit = tmp_path / "unit.jsonl", load_unit("crs93")
    with on_pty(unit, log, homed_deg=np.degrees(unit.soft_home)) as (_, name):
        (scenes / "mars").symlink_to(name)
        cell = _with_port(scenes, '"mars"')
        said, _ = a465("status", cell, "--json", cwd=tmp_path)
        assert json.loads(said)["unit_by"] == "cell file"
        a465("stop", scenes / "task2.toml", cwd=tmp_path)
        a465("teach", "poses.json", cell, cwd=tmp_path)
        assert "STOP" in names_to(log)
        asked = len(lines_to(log))
        _, told = a465("run", scenes / "task2.toml", "--homed", code=2, cwd=tmp_path)
        assert "--homed needs --port: the simulated cell asks for no confirmation" in told
        assert len(lines_to(log)) == asked  # a file alone lets nothing move
        _, told = a465("run", scenes / "task2.toml", "--port", "cell", code=2, cwd=tmp_path)
        assert "no terminal to confirm" in told or "--port needs a camera" in told
        replace_in(cell, "size_mm = 40", "size_mm = 4000")
        a465("stop", cell, cwd=tmp_path)  # nothing else of the file counts


@pytest.mark.slow
def test_doctor_asks_the_unit_of_the_cell_file(scenes: Path, tmp_path: Path) -> None:
    with on_pty(load_unit("crs93"), tmp_path / "unit.jsonl") as (_, name):
        cell = _with_port(scenes, f'"{name}"')
        said, _ = a465("doctor", "--cell", cell, "--port", "cell", "--json", cwd=tmp_path)
    assert {"controller": "ok"}.items() <= {
        c["check"]: c["verdict"] for c in json.loads(said)["checks"]
    }.items()


def test_a_port_that_is_not_there_is_told_with_the_file_that_names_it(scenes: Path, tmp_path: Path) -> None:
    cell = _with_port(scenes, '"none-such"')
    said, told = a465("status", cell, code=2, cwd=tmp_path)
    assert f"port: {scenes / 'none-such'}, of {cell}" in said
    assert f"port {scenes / 'none-such'}: is not there" in told


def test_a_relative_port_that_is_in_the_working_folder_alone_is_told(
    scenes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    Path("mars").touch()
    with pytest.raises(FileInputError) as refused:
        choose_port(None, _with_port(scenes, '"mars"'), Heard())
    there = os.path.relpath("mars", scenes)
    assert str(refused.value) == (
        f"{scenes / 'cell.toml'}: port = 'mars': is beside this file, where there is none; the one of the working "
        f"folder is {there}"
    )
