"""Talking to a person who may have gone: a standard output that is closed, full, or read no more."""

from __future__ import annotations

import errno
import io
import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest

import cell.console
from arm.io.storage import data_file
from cell.console import Console, OutputLost, say_on_stderr
from driver.log.read import read_log
from tasks.small import small_scenes

BEGIN = "import sys; from cell.cli.start import main; sys.argv = ['a465', *sys.argv[1:]]; main()"


class Gone(io.StringIO):
    """A stream that takes a few characters."""

    def __init__(self, room: int, number: int) -> None:
        super().__init__()
        self.room, self.number = room, number

    def write(self, text: str) -> int:
        if self.tell() + len(text) > self.room:
            raise OSError(self.number, os.strerror(self.number))
        return super().write(text)


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EPIPE, errno.EIO])
def test_a_lost_output_is_told_once(monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    stream = Gone(10, number)
    monkeypatch.setattr(sys, "stdout", stream)
    console = Console()
    with console.heard():
        console.say("a word")
        with pytest.raises(OutputLost, match=os.strerror(number)) as lost:
            console.say("another word")
        assert lost.value.exit_code == 4
        console.say("nobody hears this")
        console.step("nor this")
    assert stream.getvalue() == "a word\n"


def test_a_reader_that_has_gone_has_read_enough_of_what_moves_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "stdout", Gone(10, errno.EPIPE))
    console = Console()
    for word in ("a word", "another word", "nobody hears this"):
        console.say(word)
    with pytest.raises(OutputLost, match="Broken pipe"), console.heard():
        raise AssertionError("an arm moves, and nobody follows it")


def test_an_output_that_was_never_there_is_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdout", None)
    for as_json in (False, True):
        console = Console(as_json)
        console.say("a word")
        console.progress("a move", 0.5)
        console.result({"a": 1})


TASK = data_file("scenes/task2.toml")

UNREAD = "| true; exit ${PIPESTATUS[0]}"  # gone before the first word: a reader of lines may outlast them all


def _a465(command: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """A command with its standard output in a shell's hands, buffered as it is for a user."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    shell = f'"{sys.executable}" -c "{BEGIN}" {command}'
    return subprocess.run(
        ["bash", "-c", shell],
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
        env=environment,
        cwd=folder,
    )


@pytest.mark.slow
def test_a_command_whose_output_is_not_wanted_any_more_does_what_it_was_to_do(tmp_path: Path) -> None:
    task = small_scenes(tmp_path) / "task2.toml"
    ended = _a465(f'look "{task}" -o look.json {UNREAD}', tmp_path)
    assert ended.returncode == 0, ended.stderr
    assert ended.stderr == ""
    assert json.loads((tmp_path / "look.json").read_text())["scenes"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "code"),
    [
        (f'run "{TASK}" -o run', 4),
        (f'run "{TASK}" -o run 2>&1', 4),
        (f'run "{TASK}" -o run --json 2>&1', 4),
        ("look nowhere.toml", 2),
        ("look nowhere.toml --json", 2),
        ("look nowhere.toml 2>&1", 2),
    ],
)
def test_how_a_command_ended_is_told_by_its_code_though_nobody_reads(
    tmp_path: Path, command: str, code: int
) -> None:
    ended = _a465(f"{command} {UNREAD}", tmp_path)
    assert ended.returncode == code, ended.stderr
    assert "Traceback" not in ended.stderr
    assert "Exception ignored" not in ended.stderr
    if command.startswith("run"):
        assert json.loads((tmp_path / "run/report.json").read_text())["error"]["exit_code"] == code
        assert read_log(tmp_path / "run/wire.jsonl").damaged == 0


@pytest.mark.parametrize(("output", "code", "words"), [(">&-", 0, ""), (">/dev/full", 4, "No space left")])
def test_a_closed_or_full_output_makes_no_traceback(
    tmp_path: Path, output: str, code: int, words: str
) -> None:
    ended = _a465(f"new-cell mine --unit crs93 {output}", tmp_path)
    assert ended.returncode == code, ended.stderr
    assert "Traceback" not in ended.stderr
    assert words in ended.stderr


class Terminal(io.StringIO):
    """What a person sees, of a few lines: line feed, return, one up, and erase."""

    def isatty(self) -> bool:
        return True

    def lines(self) -> list[str]:
        """As a terminal would show them, up to the last that is not empty."""
        shown, row, column = [""], 0, 0
        for part in re.findall(r"\x1b\[\??\d*[A-Za-z]|.|\n", self.getvalue(), flags=re.DOTALL):
            if part == "\n":
                row, column = row + 1, 0
                shown += [""] * (row == len(shown))
            elif part == "\r":
                column = 0
            elif part == "\x1b[1A":
                row -= 1
            elif part == "\x1b[2K":
                shown[row] = ""
            elif len(part) == 1:
                shown[row] = shown[row][:column].ljust(column) + part + shown[row][column + 1 :]
                column += 1
        return "\n".join(line.rstrip() for line in shown).rstrip().splitlines()


def terminal_of(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    """Standard output and error are one terminal."""
    terminal = Terminal()
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stdout", terminal)
    monkeypatch.setattr(sys, "stderr", terminal)
    return terminal


def wait_for(terminal: Terminal, text: str) -> None:
    over = time.monotonic() + 60.0
    while text not in terminal.getvalue():
        assert time.monotonic() < over, f"no {text!r} in {terminal.getvalue()!r}"
        time.sleep(0.005)


def test_a_sign_of_life_is_shown_while_nothing_else_is_and_leaves_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(cell.console, "TICK_S", 0.02)
    terminal = terminal_of(monkeypatch)
    console = Console()
    with console.doing("planning"):
        wait_for(terminal, "planning ... 0 s")
        console.say("one line")
        console.say("another")
        between = terminal.getvalue().split("one line")[1].split("another")[0]
        assert "planning" not in between, "nothing flickers between two lines"
        with console.doing("looking"):
            wait_for(terminal, "looking ... 0 s")
        assert console.result({}) is None
    assert terminal.lines() == ["one line", "another"]
    assert terminal.getvalue().count("\x1b[?25l") == terminal.getvalue().count("\x1b[?25h"), (
        "the cursor is back"
    )
    quick = terminal_of(monkeypatch)
    with Console().doing("what takes no time"):
        pass
    assert "what takes no time" not in quick.getvalue()
    assert quick.lines() == []


def test_a_bar_is_a_sign_of_life_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cell.console, "TICK_S", 0.2)
    terminal = terminal_of(monkeypatch)
    console = Console()
    with console.doing("running"):
        for k in range(30):
            console.progress("cube 1", k / 30, "space: pause")
            time.sleep(0.01)
    assert "running ..." not in terminal.getvalue()
    assert re.search(r"cube 1 .*━━.* \d\d %  space: pause", terminal.getvalue())
    assert terminal.lines() == []


def test_an_error_is_told_below_what_was_said_and_not_beside_a_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = terminal_of(monkeypatch)
    console = Console()
    console.say("one line")
    console.progress("a move", 0.5)
    wait_for(terminal, "a move")
    say_on_stderr("a465: stopped")
    assert terminal.lines() == ["one line", "a465: stopped"]


def test_a_terminal_that_goes_away_while_a_sign_of_life_is_shown_is_told_by_the_next_word(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(cell.console, "TICK_S", 0.01)
    stream = Gone(0, errno.EIO)
    monkeypatch.setattr(stream, "isatty", lambda: True, raising=False)
    monkeypatch.setattr(sys, "stdout", stream)
    monkeypatch.setattr(sys, "stderr", stream)
    console = Console()
    with console.heard(), console.doing("homing"):
        time.sleep(0.3)
        with pytest.raises(OutputLost):
            console.say("a word")


@pytest.mark.parametrize("piped", ["stdout", "stderr"])
def test_nothing_of_it_is_piped(monkeypatch: pytest.MonkeyPatch, piped: str) -> None:
    monkeypatch.setattr(cell.console, "TICK_S", 0.01)
    terminal_of(monkeypatch)
    monkeypatch.setattr(sys, piped, io.StringIO())
    console = Console()
    with console.doing("planning"):
        console.progress("a move", 0.5)
        time.sleep(0.1)
    assert sys.stdout.getvalue() == sys.stderr.getvalue() == ""


ROWS = [("a", 1.234, None, "yes [bold]and[/bold] no :smile:"), ("b" * 30, 0.01234, 7, "word " * 60)]


def test_tables_are_plain_and_whole_where_they_are_piped(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "40")
    Console().table(("name", "mm", "count", "what"), ROWS)
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["name", "mm", "count", "what"]
    assert set(lines[1]) == {"-", " "}
    assert lines[2].split("  ", 1)[0] == "a"
    assert lines[2].endswith(" 1.23      -  yes [bold]and[/bold] no :smile:")
    assert lines[3] == f"{'b' * 30}  0.012      7  {'word ' * 60}".rstrip()
    assert len(lines) == 4


def test_tables_are_wrapped_at_the_terminals_width(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = terminal_of(monkeypatch)
    monkeypatch.setenv("COLUMNS", "20")
    Console().table(("name", "mm", "count", "what"), ROWS)
    lines = terminal.getvalue().splitlines()
    assert max(map(len, lines)) <= 20
    assert "".join(line[18:].strip() for line in lines).count("word") == 60
    assert "\x1b" not in terminal.getvalue()
    assert " 0.012 " in " ".join(lines), "numbers are not broken"


class Full(io.StringIO):
    """An output that takes nothing."""

    def write(self, text: str) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    flush = write  # type: ignore[assignment]


def test_a_table_that_cannot_be_written_is_lost_as_a_line_is(monkeypatch: pytest.MonkeyPatch) -> None:
    for stream in ("stdout", "stderr"):
        monkeypatch.setattr(sys, stream, Full())
    with pytest.raises(OutputLost, match="No space left"):
        Console().table(("name",), [("a",)])


def test_names_of_a_file_do_nothing_to_the_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    Console().say("cube \x1b[2J\x1b[H\r\ud800 ä · \u2028 end")
    assert capsys.readouterr().out == "cube \\x1b[2J\\x1b[H\\r\\ud800 ä · \\u2028 end\n"
    say_on_stderr("a465: \x07wrong\ninput")
    assert capsys.readouterr().err == "a465: \\x07wrong\ninput\n"


def test_a_line_has_no_password(capsys: pytest.CaptureFixture[str]) -> None:
    say_on_stderr("to go on: a465 run --camera video:rtsp://me:secret@host/1 --resume")
    Console(as_json=False).say("video:http://host/?key=secret")
    said = capsys.readouterr()
    assert "secret" not in said.out + said.err
    assert "--camera video:rtsp://***@host/1 --resume" in said.err


def test_a_warning_about_the_same_subject_is_said_once(capsys: pytest.CaptureFixture[str]) -> None:
    console = Console()
    for text, about in (("90 % saturated", "exposure"), ("88 % saturated", "exposure"), ("dirty", "lens")):
        console.warn(text, about)
    assert capsys.readouterr().out.splitlines() == ["WARNING: 90 % saturated", "WARNING: dirty"]
