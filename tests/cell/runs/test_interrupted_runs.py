"""Interrupted from outside at different moments: STOP goes out, the run ends with 4 and one line, nothing hangs."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tasks.small import small_scenes

pytestmark = pytest.mark.xdist_group("interrupts")
DEADLINE_S = 600.0  # of a program on a busy host, until it is so far and until it has ended


def _sent(log: Path) -> list[str]:
    if not log.is_file():
        return []
    records = [json.loads(line) for line in log.read_text().splitlines() if line.endswith("}")]
    return "".join(r["data"] for r in records if r["kind"] == "sent").split("\n")


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda s: s.name)
@pytest.mark.parametrize(("when", "count"), [("HHA:", 1), ("COORDSPLINET:", 40), ("GG:", 2)])
def test_a_signal_stops_the_arm(tmp_path: Path, when: str, count: int, number: signal.Signals) -> None:
    command = [
        sys.executable,
        "-c",
        "import cell.cli.main; cell.cli.main.main()",
        "run",
        str(small_scenes(tmp_path) / "task2.toml"),
    ]
    run = subprocess.Popen(
        [*command, "-o", str(tmp_path / "run"), "--time-scale", "5"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    log, over = tmp_path / "run/wire.jsonl", time.monotonic() + DEADLINE_S
    while sum(line.startswith(when) for line in _sent(log)) < count and time.monotonic() < over:
        time.sleep(0.05)
    assert run.poll() is None
    run.send_signal(number)
    _, told = run.communicate(timeout=DEADLINE_S)
    assert run.returncode == 4, told
    lines = [line for line in told.splitlines() if line]
    assert len(lines) == 1
    assert lines[0].startswith("a465: stopped:")
    assert "interrupted" in lines[0]
    sent = _sent(log)
    last = max(i for i, line in enumerate(sent) if line.startswith(("COORDSPLINET:", "HH", "GG:")))
    assert "STOP:" in sent[last:]


@pytest.mark.slow
@pytest.mark.parametrize("gap_s", [0.003, 0.02])
def test_signals_in_a_burst_end_as_one_does(tmp_path: Path, gap_s: float) -> None:
    """They come until the program has ended: a service manager, a shell and a person each send theirs."""
    command = [sys.executable, "-c", "import cell.cli.start; cell.cli.start.main()", "run"]
    run = subprocess.Popen(
        [
            *command,
            str(small_scenes(tmp_path) / "task2.toml"),
            "-o",
            str(tmp_path / "run"),
            "--time-scale",
            "5",
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    log, over = tmp_path / "run/wire.jsonl", time.monotonic() + DEADLINE_S
    while sum(line.startswith("COORDSPLINET:") for line in _sent(log)) < 40 and time.monotonic() < over:
        time.sleep(0.05)
    sent, over = 0, time.monotonic() + DEADLINE_S
    while run.poll() is None and time.monotonic() < over:
        run.send_signal((signal.SIGINT, signal.SIGTERM, signal.SIGHUP)[sent % 3])
        sent += 1
        time.sleep(gap_s)
    _, told = run.communicate(timeout=DEADLINE_S)
    assert run.returncode == 4, (sent, told)
    assert sent > 2
    lines = [line for line in told.splitlines() if line]
    assert len(lines) == 1
    assert "interrupted" in lines[0]
    assert json.loads((tmp_path / "run/report.json").read_text())["error"]["exit_code"] == 4
