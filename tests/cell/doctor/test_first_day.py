"""What camera, controller and a person show is ticked off; what was no real arm or camera is not kept."""

from __future__ import annotations

import json
import os
import pty
import select
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import cell.commands.run
import cell.doctor.first_day
from arm.errors import A465Error, InputError
from cell.config.cell import Cell
from cell.config.cell_file import read_cell
from cell.doctor.checklist import ITEMS, checklist_file, read_ticks, tick_of, write_ticks
from cell.doctor.finding import NOTE, OK, CheckResult
from cell.doctor.first_day import LONGEST, Seen, ask_person, keep, rows_of, see_camera, see_unit
from driver.emulator import EmulatorOptions
from driver.mars.start.startup import axis_lines
from emulated.on_pty import names_to, on_pty
from typed.command_line import a465, replace_in
from typed.heard import Heard

pytestmark = pytest.mark.xdist_group("doctor")
HOMED_DEG = (-60.0, -40.0, -80.0, 0.0, -60.0, 0.0)
READABLE = EmulatorOptions(registers_readable=True)
PERSON = ["bodies", "tool", "stop"]
GOOD = {
    "camera": "name:c",
    "stand_in": "",
    "complaint": "",
    "markers": (1, 2),
    "blur_px": 0.86,
    "mean_grey": 90.0,
}


@pytest.fixture
def cell_(scenes: Path) -> Cell:
    return read_cell(scenes / "cell.toml")


@pytest.fixture
def as_real(monkeypatch: pytest.MonkeyPatch) -> None:
    """A pseudo-terminal counts as a real unit's port."""
    monkeypatch.setattr(cell.doctor.first_day, "may_be_real", lambda port: True)


def typing(*lines: str | None) -> Callable[[], str | None]:
    rest = iter(lines)
    return lambda: next(rest)


def by_item(rows: tuple[CheckResult, ...]) -> dict[str, CheckResult]:
    return {str(row.data["item"]): row for row in rows}


@pytest.mark.usefixtures("as_real")
def test_a_homed_unit_is_ticked_with_its_angles_and_registers_and_gets_queries_only(
    cell_: Cell, tmp_path: Path
) -> None:
    with on_pty(cell_.nominal_unit, tmp_path / "log", options=READABLE, homed_deg=HOMED_DEG) as (_, port):
        rows = by_item(rows_of(cell_, see_unit(port, cell_)))
    assert {name: row.verdict for name, row in rows.items() if row.verdict == OK} == {
        "homed": OK,
        "limits": OK,
    }
    assert "J1 to J6 at [-60.0, -40.0, -80.0, 0.0, -60.0, 0.0] deg" in rows["homed"].found
    assert "12 limits of speed and acceleration and 0 other registers read as set" in rows["limits"].found
    assert read_ticks(cell_.file)["homed"].by == f"port {port}"
    sent = names_to(tmp_path / "log")
    assert {name for name in sent if not name.endswith("?")} == {"ECHO", "STAMP"}
    assert {"VER?", "APA?", "REGMSF?", "REGACCA?"} <= sent


@pytest.mark.usefixtures("as_real")
def test_registers_that_were_set_otherwise_are_named(cell_: Cell, tmp_path: Path) -> None:
    with on_pty(cell_.nominal_unit, tmp_path / "log", options=READABLE, homed_deg=HOMED_DEG) as (
        emulator,
        port,
    ):
        for line in axis_lines(cell_.nominal_unit):
            emulator.machine.registers[line.partition(":")[0]] = float(line.partition(":")[2])
        assert see_unit(port, cell_)["limits"].found.endswith("and 31 other registers read as set")
        emulator.machine.registers["REGMSB"] = 4096.0
        seen = see_unit(port, cell_)
    assert seen["limits"] == Seen(
        False, "REGMSB reads 4096, must be 2048; a465 home sets them", f"port {port}"
    )
    assert by_item(rows_of(cell_, seen))["limits"].found == f"open: {seen['limits'].found}"


@pytest.mark.usefixtures("as_real")
def test_a_tick_goes_if_the_unit_was_switched_on_since(cell_: Cell, tmp_path: Path) -> None:
    write_ticks(
        cell_.file,
        {"homed": tick_of(cell_, "homed", "port a", "b"), "stop": tick_of(cell_, "stop", "c", "d")},
    )
    with on_pty(cell_.nominal_unit, tmp_path / "log") as (_, port):
        rows = by_item(rows_of(cell_, see_unit(port, cell_)))
    assert rows["homed"].verdict == NOTE
    assert "as after power-up or an interrupted homing: the unit must be homed" in rows["homed"].found
    assert rows["homed"].help.startswith(f"a465 home {cell_.file} /dev/mars")
    assert list(read_ticks(cell_.file)) == ["stop"]


@pytest.mark.usefixtures("as_real")
def test_a_person_is_asked_for_the_limits_of_a_unit_that_does_not_tell_them(
    cell_: Cell, tmp_path: Path
) -> None:
    with on_pty(cell_.nominal_unit, tmp_path / "log", homed_deg=HOMED_DEG) as (_, port):
        seen = see_unit(port, cell_)
    assert seen["limits"].untold
    assert "does not answer for REGMS, REGACC" in by_item(rows_of(cell_, seen))["limits"].found
    ask_person(cell_, Heard(), typing("", "", "A. Smith, by video", ""), seen)
    assert list(read_ticks(cell_.file)) == ["homed", "limits"]
    assert (
        by_item(rows_of(cell_, seen))["limits"].verdict == OK
    )  # the next question to the unit takes nothing back


def test_an_emulated_unit_ticks_nothing_and_takes_nothing_back(cell_: Cell, tmp_path: Path) -> None:
    write_ticks(cell_.file, {"limits": tick_of(cell_, "limits", "port /dev/mars", "as set")})
    before = checklist_file(cell_.file).read_text()
    with on_pty(cell_.nominal_unit, tmp_path / "log", options=READABLE, homed_deg=HOMED_DEG) as (
        emulator,
        port,
    ):
        emulator.machine.registers["REGMSB"] = 4096.0
        seen = see_unit(port, cell_)
        rows = by_item(rows_of(cell_, seen))
    assert rows["homed"].verdict == NOTE
    assert rows["limits"].verdict == OK
    assert f"port {port} is an emulated unit, so this is not kept: J1 to J6" in rows["homed"].found
    assert checklist_file(cell_.file).read_text() == before
    ask_person(cell_, Heard(), typing("", "", ""), {"limits": Seen(False, "", "", "an emulated unit", True)})


def test_another_arm_is_refused(cell_: Cell, tmp_path: Path, scenes: Path) -> None:
    with on_pty(cell_.nominal_unit, tmp_path / "log", homed_deg=HOMED_DEG) as (_, port):
        replace_in(scenes / "cell.toml", 'unit = "crs93"', 'unit = "crs97"')
        with pytest.raises(InputError, match="this is another arm"):
            see_unit(port, read_cell(scenes / "cell.toml"))


def test_a_motion_cannot_pass_the_port(cell_: Cell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cell.doctor.first_day, "gripper_answers", lambda link: link.send("HHA:"))
    with (
        on_pty(cell_.nominal_unit, tmp_path / "log") as (_, port),
        pytest.raises(A465Error, match=r"'HHA:.n' not sent"),
    ):
        see_unit(port, cell_)
    assert names_to(tmp_path / "log") == {"ECHO", "STAMP", "VER?"}


@pytest.mark.parametrize(
    ("other", "ticked"),
    [({}, True), ({"complaint": "blurred by 2 px"}, False), ({"stand_in": "a recording"}, False)],
)
def test_the_camera_is_ticked_by_a_sharp_photograph_of_a_real_one(
    cell_: Cell, other: dict[str, str], ticked: bool
) -> None:
    row = by_item(rows_of(cell_, {"camera": see_camera({**GOOD, **other})}))["camera"]
    assert row.data["ticked"] is ticked is checklist_file(cell_.file).exists()
    assert (other.get("complaint") or "blur 0.86 px at the borders of 2 markers") in row.found
    if ticked:
        rows = rows_of(cell_, {"camera": see_camera({**GOOD, "complaint": "too dark"})})
        assert by_item(rows)["camera"].found == "open: too dark"
        assert read_ticks(cell_.file) == {}


def test_answers_are_kept_at_once_and_enter_and_no_do_what_is_said(cell_: Cell) -> None:
    heard = Heard()
    ask_person(cell_, heard, typing("A. Smith: 6 mm at the elbow", "", "yes", "B. Jones"), {})
    assert {name: tick.found for name, tick in read_ticks(cell_.file).items()} == {
        "bodies": "A. Smith: 6 mm at the elbow",
        "stop": "B. Jones",
    }
    assert "cell file: body_radius_mm 32, finger_mm 20 x 10 x 25.4, " in heard.all
    assert "'yes': must be a name and what was found" in heard.all
    ask_person(cell_, heard, typing("", "", "NO"), {})
    assert list(read_ticks(cell_.file)) == ["bodies"]
    for wrong in ("y", "12", "x" * (LONGEST + 1), "a\x1bb"):
        with pytest.raises(InputError, match="must be a name and what was found"):
            ask_person(cell_, heard, typing("C. Doe", *[wrong] * 3), {})
    with pytest.raises(InputError, match="nobody answered: tool measured"):
        ask_person(cell_, heard, typing("C. Doe: 5 mm", None), {})
    assert read_ticks(cell_.file)["bodies"].found == "C. Doe: 5 mm"


def test_a_tool_without_jaws_is_asked_for_as_its_file_has_it(scenes: Path) -> None:
    heard, pen = Heard(), read_cell(scenes / "pen/cell.toml")
    ask_person(pen, heard, typing("", "A. Smith", ""), {})
    assert "the bodies of its tool file" in heard.all
    replace_in(next((scenes / "pen/tools").iterdir()), "length_mm = ", "length_mm = 1")
    keep(pen, {})
    row = by_item(rows_of(read_cell(scenes / "pen/cell.toml"), {}))["tool"]
    assert row.found.startswith("void: changed since it was ticked")


def test_the_table_the_json_and_the_page_have_the_items(scenes: Path, tmp_path: Path) -> None:
    file = scenes / "cell.toml"
    with on_pty(read_cell(file).nominal_unit, tmp_path / "log", homed_deg=HOMED_DEG) as (_, port):
        said, told = a465(
            "doctor", "--cell", scenes / "task2.toml", "--port", port, "-o", tmp_path / "p.html", "--json"
        )
    report = json.loads(said)
    items = [check for check in report["checks"] if "item" in check["data"]]
    assert [check["check"] for check in items] == [item.row for item in ITEMS]
    assert report["open"] == [item.name for item in ITEMS]
    assert all(check["verdict"] == NOTE and check["help"] == check["data"]["command"] for check in items)
    assert "limits read back  note" in told
    assert "First-day checklist" in (tmp_path / "p.html").read_text()
    assert not checklist_file(file).exists()


def test_nothing_is_asked_without_a_terminal_or_of_the_built_in_cell(tmp_path: Path, scenes: Path) -> None:
    for words, told in (
        (
            ("--ask", "--cell", scenes / "cell.toml"),
            "--ask: there is no terminal at which a person can answer",
        ),
        (("--ask",), "--ask needs --cell: the built-in cell has no checklist"),
        (("-o", tmp_path / "page.html"), "--output needs --cell"),
    ):
        assert told in a465("doctor", *words, code=2, cwd=tmp_path)[1]
    assert list(tmp_path.glob("*.html")) == []


def test_a_damaged_checklist_is_a_row(scenes: Path) -> None:
    checklist_file(scenes / "cell.toml").write_text("format = 1\n")
    said, _ = a465("doctor", "--cell", scenes / "cell.toml", "--json", code=3)
    report = json.loads(said)
    assert report["wrong"] == ["checklist"]
    assert "cell.checklist.toml: format = 1: must be" in report["checks"][-1]["found"]


@pytest.fixture
def typed_at(tmp_path: Path) -> Iterator[Callable[[dict[bytes, bytes], list[str]], tuple[int, str]]]:
    """Types answers at a real terminal, each once its question stands there."""
    masters = []

    def run(answers: dict[bytes, bytes], words: list[str]) -> tuple[int, str]:
        child, master = pty.fork()
        if child == 0:
            os.chdir(tmp_path)
            os.execv(sys.executable, [sys.executable, "-m", "a465", *words])
        masters.append(master)
        said, over, left = b"", time.monotonic() + 120.0, dict(answers)
        seen = 0
        while True:
            ready, _, _ = select.select([master], [], [], max(over - time.monotonic(), 0.0))
            assert ready, said
            try:
                said += os.read(master, 4096)
            except OSError:
                break
            asked = next(iter(left), None)
            if asked is not None and asked in said[seen:]:
                seen = len(said)
                time.sleep(0.1)  # what is typed before the program waits for it is forgotten
                os.write(master, left.pop(asked) + b"\n")
        _, status = os.waitpid(child, 0)
        assert not left, said
        return os.waitstatus_to_exitcode(status), said.decode()

    yield run
    for master in masters:
        os.close(master)


@pytest.mark.slow
def test_at_a_terminal(
    scenes: Path, typed_at: Callable[[dict[bytes, bytes], list[str]], tuple[int, str]], tmp_path: Path
) -> None:
    """The command as a person types it, on a real pseudo-terminal."""
    answers = {
        b"largest protrusion in mm?": b"A. Smith: 6 mm",
        b"all agree: who measured?": b"A. Smith: nothing",
        b"Who?": b"B. Jones",
    }
    words = ["doctor", "--cell", str(scenes / "cell.toml"), "--ask", "-o", "page.html"]
    code, said = typed_at(answers, words)
    assert code == 0, said
    assert {name: tick.found for name, tick in read_ticks(scenes / "cell.toml").items()} == {
        "bodies": "A. Smith: 6 mm",
        "tool": "A. Smith: nothing",
        "stop": "B. Jones",
    }
    assert "A. Smith: nothing" in (tmp_path / "page.html").read_text()


@pytest.mark.slow
def test_a_run_on_a_real_port_notes_what_is_open_and_goes_on(
    scenes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = [
        "run",
        scenes / "task2.toml",
        "--port",
        tmp_path / "nowhere",
        "--images",
        tmp_path,
        "--unseen",
        "--homed",
    ]
    for real, notes in ((True, 1), (False, 0)):
        monkeypatch.setattr(cell.commands.run, "may_be_real", lambda port, real=real: real)
        said, told = a465(*words, code=2, cwd=tmp_path)
        assert "nowhere: is not there" in told
        assert said.count("note: 6 of 6 items of the first-day checklist are open") == notes
