"""Where the log of a run cannot be written nothing is sent; where it can no longer be written the arm is stopped."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import cell.commands.run
from arm.controller.segments import CountPath
from arm.controller.unit import Unit, load_unit
from arm.errors import A465Error, ExecutionStopped, InputError
from arms.count_paths import quintic
from cell.console import Console
from cell.session.connection import WhichCell
from driver.emulator import Emulator
from driver.line.stepped_clock import SteppedClock
from driver.line.wire_log import WireLog
from driver.log.read import read_log
from driver.mars.mars import Mars
from driver.mars.streaming.stream import stream
from tasks.full_disks import TASK, execute

pytestmark = pytest.mark.xdist_group("logs")


@pytest.fixture
def unit() -> Unit:
    return load_unit("crs93")


def _run(port: str, images: Path) -> None:
    cell.commands.run.run_task(TASK, Console(), WhichCell(port, images=images))


def _a_file_in_the_way(place: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    (place / "runs").write_text("")
    return "Not a directory|File exists"


def _read_only(place: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """As a file system that is mounted read-only answers; rights alone do not hold back a superuser."""
    real = Path.mkdir

    def mkdir(path: Path, *rest: Any, **options: Any) -> None:
        if "runs" in path.parts:
            raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(path))
        real(path, *rest, **options)

    monkeypatch.setattr(Path, "mkdir", mkdir)
    return "Read-only file system"


def _full(place: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    _fill_disk(monkeypatch, lambda: True)
    return "No space left on device"


def _fill_disk(monkeypatch: pytest.MonkeyPatch, full: Callable[[], bool]) -> None:
    """Writing to the log, and to nothing else, fails while `full` says so."""
    real = os.write

    def write(descriptor: int, data: bytes) -> int:
        if os.readlink(f"/proc/self/fd/{descriptor}").endswith("wire.jsonl") and full():
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return real(descriptor, data)

    monkeypatch.setattr(os, "write", write)


@pytest.mark.parametrize("spoil", [_a_file_in_the_way, _read_only, _full], ids=lambda f: f.__name__)
@pytest.mark.parametrize("verb", [_run, execute], ids=lambda f: f.__name__)
def test_without_a_log_not_one_byte_is_sent(
    verb: Callable[[str, Path], None],
    spoil: Callable[[Path, pytest.MonkeyPatch], str],
    place: Path,
    emulator: Emulator,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stood, port = emulator.counts(), emulator.open_pty()
    reason = spoil(place, monkeypatch)
    with pytest.raises(
        InputError,
        match=rf"^(runs: cannot be made|log runs/task2-1/wire\.jsonl: cannot be written): ({reason})$",
    ) as refused:
        verb(port, place / "images")
    assert refused.value.exit_code == 2
    assert emulator.lines == ()
    assert emulator.counts() == stood


@pytest.fixture
def stepped(unit: Unit) -> Iterator[Emulator]:
    with Emulator(unit, SteppedClock()) as emulator:
        yield emulator


def _used(use: Callable[[Mars], None], place: Path, unit: Unit, emulator: Emulator) -> None:
    clock = emulator.clock
    with WireLog(place / "wire.jsonl", clock) as log, Mars(emulator.open_line(), unit, clock, log) as mars:
        use(mars)


def test_a_disk_that_fills_before_homing_moves_nothing(
    place: Path, unit: Unit, stepped: Emulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    stood = stepped.counts()
    full: list[bool] = []
    _fill_disk(monkeypatch, lambda: bool(full))

    def use(mars: Mars) -> None:
        mars.identify()
        full.append(True)
        mars.initialise()

    with pytest.raises(ExecutionStopped, match="cannot be written any more: No space left on device"):
        _used(use, place, unit, stepped)
    assert stepped.counts() == stood
    assert not [line for _, line in stepped.lines if line.startswith(("HH", "COORD", "SPDT", "G"))]


@pytest.mark.slow
def test_a_disk_that_fills_while_the_arm_moves_stops_it_and_leaves_a_log_that_reads(
    place: Path, unit: Unit, stepped: Emulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    full: list[bool] = []
    _fill_disk(monkeypatch, lambda: bool(full))
    paths: list[CountPath] = []

    def use(mars: Mars) -> None:
        mars.identify()
        mars.initialise()
        paths.append(quintic(mars.counts(), 40))
        stream(mars, paths[0], lambda progress: full.append(True) if progress.done >= 10 else None)

    with pytest.raises(ExecutionStopped, match="cannot be written any more") as stopped:
        _used(use, place, unit, stepped)
    (path,) = paths
    error: A465Error = stopped.value
    assert error.data["reason"] == "log"
    assert error.data["state"]["at_rest"] is True
    assert tuple(error.data["state"]["counts"]) == stepped.counts() != path.end
    sent = [line for _, line in stepped.lines]
    moving = next(k for k, line in enumerate(sent) if line.startswith("COORDSPLINET"))
    after = sent[sent.index("STOP:", moving) :]
    assert not [line for line in after if line.startswith("COORD") and line != "COORDAP?"]
    session = read_log(place / "wire.jsonl")
    assert session.damaged == 0
    assert session.motions[-1].start == path.start
