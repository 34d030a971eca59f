"""Talking to a person who may have gone: a standard output that is closed, full, or read no more."""

from __future__ import annotations

import errno
import io
import os
import subprocess
import sys

import pytest

from arm.files import data_file
from cell.console import Console, OutputLost

BEGIN = "import sys; from cell.cli import main; sys.argv = ['a465', *sys.argv[1:]]; main()"


class Gone(io.StringIO):
    """A stream that takes a few characters."""

    def __init__(self, room: int, number: int) -> None:
        super().__init__()
        self.room, self.number = room, number

    def write(self, text: str) -> int:
        if self.tell() + len(text) > self.room:
            raise OSError(self.number, os.strerror(self.number))
        return super().write(text)


@pytest.mark.parametrize(
    ("number", "broken"), [(errno.ENOSPC, False), (errno.EPIPE, True), (errno.EIO, False)]
)
def test_a_lost_output_is_told_once(monkeypatch: pytest.MonkeyPatch, number: int, broken: bool) -> None:
    stream = Gone(10, number)
    monkeypatch.setattr(sys, "stdout", stream)
    console = Console()
    console.say("a word")
    with pytest.raises(OutputLost, match=os.strerror(number)) as lost:
        console.say("another word")
    assert lost.value.broken_pipe is broken
    assert lost.value.exit_code == 4
    console.say("nobody hears this")
    console.step("nor this")
    assert stream.getvalue() == "a word\n"


def test_an_output_that_was_never_there_is_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdout", None)
    for as_json in (False, True):
        console = Console(as_json)
        console.say("a word")
        console.progress("a move", 0.5)
        console.result({"a": 1})


def _look(output: str) -> subprocess.CompletedProcess[str]:
    """a465 look with its standard output in a shell's hands, buffered as it is for a user."""
    shell = f'"{sys.executable}" -c "{BEGIN}" look "{data_file("scenes/task2.toml")}" {output}'
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    return subprocess.run(
        ["bash", "-c", shell], capture_output=True, text=True, timeout=60, check=False, env=environment
    )


def test_a_command_whose_output_is_not_wanted_any_more_ends_in_peace() -> None:
    ended = _look(
        "| true; exit ${PIPESTATUS[0]}"
    )  # gone before the first word: a reader of lines may outlast all
    assert ended.returncode == 0, ended.stderr
    assert ended.stderr == ""


@pytest.mark.parametrize(("output", "code", "words"), [(">&-", 0, ""), (">/dev/full", 4, "No space left")])
def test_a_closed_or_full_output_makes_no_traceback(output: str, code: int, words: str) -> None:
    ended = _look(output)
    assert ended.returncode == code, ended.stderr
    assert "Traceback" not in ended.stderr
    assert words in ended.stderr
