"""Fixtures of several tests of this folder."""

from __future__ import annotations

import pytest

from pictures.boards import lab_camera
from vision.background.features import Background, background_features
from vision.camera.model import Camera
from watched.scratched import ScratchedTable, scratched_table


@pytest.fixture(scope="session")
def camera() -> Camera:
    return lab_camera()


@pytest.fixture(scope="session")
def table() -> ScratchedTable:
    return scratched_table()


@pytest.fixture(scope="session")
def background(table: ScratchedTable, camera: Camera) -> Background:
    return background_features([table.image(camera, seed=n) for n in (90, 91, 92)], camera)
