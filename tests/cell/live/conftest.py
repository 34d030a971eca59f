"""What tests of the live page share: a server, and connections that end with their test."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from cell.live.server import LiveServer
from pages.live import OPENED


@pytest.fixture
def server() -> Iterator[LiveServer]:
    made = LiveServer(0)
    made.start()
    yield made
    made.end("done")


@pytest.fixture(autouse=True)
def all_closed() -> Iterator[None]:
    """Connections end with their test: one that an error still holds is found later, and blamed on another test."""
    with OPENED:
        yield
