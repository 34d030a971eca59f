"""``a465 emulate`` as a program: faults from a file, a log, and mistakes told in one line."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from wire_client import Client

COMMAND = [sys.executable, "-c", "from cell.cli import main; main()", "emulate"]


class Program:
    """A running ``a465 emulate``; `urls` are those that it says."""

    def __init__(self, *arguments: str, count: int = 1) -> None:
        self.process = subprocess.Popen(
            [*COMMAND, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        assert self.process.stdout is not None
        self.urls = [self.process.stdout.readline().split()[2].rstrip(",") for _ in range(count)]

    def interrupt(self) -> tuple[int, str]:
        """Exit code and what was said of errors."""
        self.process.send_signal(signal.SIGINT)
        _, errors = self.process.communicate(timeout=20)
        return self.process.returncode, errors

    def __enter__(self) -> Program:
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.communicate(timeout=20)


def records(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_faults_happen_as_the_file_says_and_everything_is_in_the_log(tmp_path: Path) -> None:
    faults, log, link = tmp_path / "faults.toml", tmp_path / "unit.jsonl", tmp_path / "mars"
    faults.write_text('[[fault]]\nkind = "power_off"\nwhen = { command = "GA", after_ms = 100 }\n')
    arguments = ["--fault", str(faults), "--log", str(log), "--link", str(link), "--tcp", "0"]
    with Program("--unit", "crs97", "--time-scale", "20", *arguments, count=2) as program:
        assert program.urls[1].startswith("socket://127.0.0.1:")
        with Client(str(link)) as client:
            client.send("ECHO:0", "COORDISCONT:5", "GA:90000", "R:")
            assert client.read_until(b"!\r\n") == b"ECHO:0\nFAIL!\r\n"
        with Client(program.urls[1]) as client:
            assert client.ask("ST?") == "ST=65536"
            client.send("GA:1", "STAMP:1")
            client.read_until(b"=1\r\n")
        assert program.interrupt() == (0, "")
    assert not link.is_symlink()
    found = records(log)
    told = [(r["kind"], r.get("text", r.get("fault"))) for r in found if r["kind"] != "open"]
    assert told[:8] == [
        ("line", "ECHO:0"), ("line", "COORDISCONT:5"), ("line", "GA:90000"), ("line", "R:"),
        ("fault", "power_off"), ("answer", "FAIL!"), ("line", "ST?"), ("answer", "ST=65536"),
    ]  # fmt: skip
    assert sorted(told[8:]) == [
        ("answer", "STAMP=1"), ("line", "GA:1"), ("line", "STAMP:1"),
        ("violation", "axis A told to move while a fault stands"),
    ]  # fmt: skip
    ms = [r["ms"] for r in found if r["kind"] != "open"]
    assert all(isinstance(m, int) for m in ms)
    obeyed = next(r["ms"] for r in found if r.get("text") == "GA:90000")
    assert next(r["ms"] for r in found if r["kind"] == "fault") == obeyed + 100


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ('[[fault]]\nkind = "flood"\n', "fault[0].kind = 'flood': must be one of power_off"),
        (None, "No such file"),
        ('[[fault]]\nkind = "drift"\naxis = "A"\n', "fault[0].counts_per_s: is missing"),
    ],
)
def test_a_bad_fault_file_is_one_line_and_exit_code_2(tmp_path: Path, content: str | None, told: str) -> None:
    path = tmp_path / "faults.toml"
    if content is not None:
        path.write_text(content)
    ended = subprocess.run([*COMMAND, "--fault", str(path)], capture_output=True, text=True, timeout=20)
    assert ended.returncode == 2
    assert ended.stdout == ""
    assert str(path) in ended.stderr
    assert told in ended.stderr
    assert len(ended.stderr.strip().splitlines()) == 1


def test_a_log_that_cannot_be_written_is_told_before_anything_is_served(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    log = tmp_path / "file" / "unit.jsonl"
    ended = subprocess.run([*COMMAND, "--log", str(log)], capture_output=True, text=True, timeout=20)
    assert ended.returncode == 2
    assert ended.stdout == ""
    assert f"log {log}: cannot be written" in ended.stderr
