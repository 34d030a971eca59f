"""A run is followed by pages, from its first line to its end."""

from __future__ import annotations

import re
import socket
import threading
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest
import typer

from arm.errors import ExecutionStopped, InputError
from arm.io.storage import data_file
from cell.cli.main import main
from cell.console import Console
from cell.files.task import read_task
from cell.live.view import Live, live_view
from driver.execution.control import Control
from pages.live import SOON_S, Reader, ask

# -- the run


class Followed(Console):
    """A console that keeps what it says."""

    def __init__(self) -> None:
        super().__init__(as_json=True)
        self.said: list[str] = []

    def say(self, text: str = "") -> None:
        self.said.append(text)

    @property
    def port(self) -> int:
        return int(re.fullmatch(r"live view: http://127\.0\.0\.1:(\d+)/", self.said[0])[1])


class Watcher(Reader):
    """A page that is open to the end."""

    ended = ""

    def __init__(self, port: int) -> None:
        super().__init__(port)
        self.read()
        self._watching = threading.Thread(target=self._watch, args=(Reader(port),), daemon=True)
        self._watching.start()

    def _watch(self, reader: Reader) -> None:
        self.ended = reader.end()

    def joined(self) -> None:
        self._watching.join(SOON_S)


def follow(console: Followed, run: Callable[[Live, Reader], None], readers: list[Watcher]) -> None:
    """A run with a live view, and somebody who reads it from the beginning."""
    try:
        _follow(console, run, readers)
    finally:
        readers[0].joined()


def _follow(console: Followed, run: Callable[[Live, Reader], None], readers: list[Watcher]) -> None:
    with live_view(console) as live:
        readers.append(Watcher(console.port))
        live.begins(read_task(data_file("scenes/task2.toml")), Control())
        run(live, readers[0])


def test_a_run_is_told_from_its_first_line_to_its_end(preview_case) -> None:
    console, readers = Followed(), []

    def run(live: Live, reader: Reader) -> None:
        console.step("it begins")
        reader.until(lambda _: reader.lines)
        assert reader.lines[0].endswith(" s] it begins")
        live.plan(preview_case.plan, "plan")
        plan = reader.until(lambda state: state["plan"])["plan"]
        assert plan["sha256"] == preview_case.plan.sha256
        text = ask(console.port, "GET", "/").read().decode()
        assert f'"live":"{plan["mark"]}"' in text
        assert '"code":null' in text  # nobody confirms with a page of what runs already
        assert len(text) < 1.5e6
        raise ExecutionStopped("the reason")

    with pytest.raises(ExecutionStopped):
        follow(console, run, readers)
    assert readers[0].ended == "stopped: the reason"
    assert console.listener is None


def test_a_plan_that_cannot_be_shown_does_not_end_the_run(preview_case) -> None:
    readers: list[Watcher] = []

    def run(live: Live, reader: Reader) -> None:
        live.plan(replace(preview_case.plan, unit="crs97"), "plan")
        assert reader.until(lambda state: state["plan"])["plan"]["mark"] is None
        assert "no live page of plan: unit = 'crs93'" in reader.lines[0]

    follow(Followed(), run, readers)
    assert readers[0].ended == "done"


@pytest.mark.parametrize(
    ("error", "text"),
    [(KeyboardInterrupt(), "interrupted"), (typer.Exit(4), "not done"), (InputError("x"), "wrong input: x")],
)
def test_how_it_ended_is_told(error: BaseException, text: str) -> None:
    readers: list[Watcher] = []

    def run(live: Live, reader: Reader) -> None:
        raise error

    with pytest.raises(type(error)):
        follow(Followed(), run, readers)
    assert readers[0].ended == text


def test_a_port_that_is_taken_is_refused_before_anything_is_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    with closing(socket.socket()) as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        words = ["run", str(data_file("scenes/task2.toml")), "--live-port", str(port)]
        monkeypatch.setattr("sys.argv", ["a465", *words])
        with pytest.raises(SystemExit) as ended:
            main()
    assert ended.value.code == InputError.exit_code == 2
    told = capsys.readouterr()
    assert f"--live-port = {port}: cannot listen on 127.0.0.1:{port}: Address already in use" in told.err
    assert told.out == ""
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("port", [-1, 80, 1023, 65536])
def test_a_port_that_is_none_is_refused(port: int) -> None:
    words = f"--live-port = {port}: must be from 1024 to 65535"
    with pytest.raises(InputError, match=words), live_view(Followed(), port):
        pass
