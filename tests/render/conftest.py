"""Fixtures of several tests of this folder."""

from __future__ import annotations

import numpy as np
import pytest

from arm.io.storage import data_file
from vision.camera.model import Camera, read_camera


@pytest.fixture(scope="module")
def camera() -> Camera:
    return read_camera(data_file("scenes/cameras/lab.toml"))


@pytest.fixture(scope="module")
def small(camera: Camera) -> Camera:
    """The lab's view at an eighth of its resolution."""
    K = camera.K * np.array([[0.125], [0.125], [1.0]])
    return Camera(K, camera.distortion, (240, 150), camera.T_base_camera)
