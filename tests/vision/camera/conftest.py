"""Fixtures of several tests of this folder."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from pictures.cameras import SERIAL, photographs, settings
from vision.camera.basler import BaslerCamera


@pytest.fixture
def told() -> list[str]:
    return []


@pytest.fixture
def camera(tmp_path: Path, told: list[str]) -> Iterator[BaslerCamera]:
    photographs(tmp_path / "shots")
    with BaslerCamera(SERIAL, settings(tmp_path), (320, 200), told.append) as opened:
        yield opened
