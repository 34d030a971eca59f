"""What every test rests on."""

import shutil
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from arm.files import data_file
from driver.logfile import Session, read_log
from logged_session import LoggedRun, logged_run


@pytest.fixture
def scenes(tmp_path: Path) -> Path:
    """A copy of the shipped scenes that a test may change."""
    return Path(shutil.copytree(data_file("scenes"), tmp_path / "scenes"))


@pytest.fixture(scope="session", autouse=True)
def interrupts_are_heard() -> Iterator[None]:
    """A shell that starts tests in the background makes them deaf to SIGINT; tests of interrupts need to hear it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> LoggedRun:
    """A session at the wire and its log."""
    return logged_run(tmp_path_factory.mktemp("log") / "wire.jsonl")


@pytest.fixture(scope="module")
def session(run: LoggedRun) -> Session:
    """What the log says."""
    return read_log(run.log)
