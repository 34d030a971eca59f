"""What every test rests on."""

import shutil
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from arm.files import data_file


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
