"""The shadow of the lamp."""

from __future__ import annotations

import numpy as np
import pytest

from arm.io.storage import data_file
from arm.robot.shapes import Body, Box
from arm.se3 import transform
from pictures.rendered import TABLE, grey_at
from render.light import Light
from render.renderer import render
from vision.camera.model import Camera, read_camera


@pytest.fixture(scope="module")
def camera() -> Camera:
    return read_camera(data_file("scenes/cameras/lab.toml"))


@pytest.fixture(scope="module")
def small(camera: Camera) -> Camera:
    """The lab's view at a quarter of its resolution."""
    K = camera.K * np.array([[0.25], [0.25], [1.0]])
    return Camera(K, camera.distortion, (480, 300), camera.T_base_camera)


def test_the_shadow_falls_away_from_the_lamp(small: Camera) -> None:
    block = Body("block", Box((0.06, 0.06, 0.12)), transform(t=(0.46, 0.0, 0.06)), "cube")
    for sign in (1.0, -1.0):
        with_shadow, without = (
            render(small, [TABLE, block], [], light=Light(lamp=(0.46, sign * 1.5, 1.5), shadow=share))
            for share in (0.4, 0.0)
        )
        kept = with_shadow / without
        behind, before = (0.46, -sign * 0.075, 0.0), (0.46, sign * 0.075, 0.0)
        assert grey_at(kept, small, behind) == pytest.approx(0.6, abs=0.04)
        assert grey_at(kept, small, before) == pytest.approx(1.0, abs=0.01)
        assert grey_at(kept, small, (0.46, 0.0, 0.12)) == pytest.approx(1.0, abs=0.01)
