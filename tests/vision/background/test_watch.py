"""The watch on the camera over a look's images."""

from __future__ import annotations

import numpy as np
import pytest

from arm.errors import ImpossibleError, InputError
from vision.background.features import Background
from vision.background.watch import CameraWatch, distance_to_plane
from vision.camera.model import Camera
from watched.scratched import ScratchedTable, turned


def test_images_that_sway_are_laid_over_each_other(
    background: Background, table: ScratchedTable, camera: Camera
) -> None:
    watch = CameraWatch(background, distance_to_plane(camera.T_base_camera, 0.0), 2e-3)
    sways = ((0.004, 0.0, 0.0), (-0.004, 0.003, 0.0), (0.0, 0.006, 0.0))
    images = [table.image(turned(camera, s), noise=1.0, seed=n) for n, s in enumerate(sways)]
    steadied, shift = watch.steady(images, camera)
    assert np.degrees(shift.rotation) == pytest.approx((0.0, 0.003, 0.0), abs=5e-4)
    inner = [i[50:-50, 50:-50].astype(float) for i in steadied]
    assert max(np.abs(i - inner[0]).max() for i in inner) < 12.0
    assert np.abs(images[0].astype(float) - images[1]).max() > 20.0


def test_one_image_that_is_too_far_off_is_refused(
    background: Background, table: ScratchedTable, camera: Camera
) -> None:
    watch = CameraWatch(background, distance_to_plane(camera.T_base_camera, 0.0), 1e-3)
    images = [table.image(camera), table.image(turned(camera, (0.1, 0.0, 0.0)))]
    with pytest.raises(ImpossibleError, match="the camera moved by"):
        watch.steady(images, camera)
    with pytest.raises(InputError, match="image 1 of 1"):
        watch.steady([images[0][:100]], camera)


def test_the_distance_is_along_the_axis(camera: Camera) -> None:
    down = camera.T_base_camera[2, 2]
    assert distance_to_plane(camera.T_base_camera, 0.1) == pytest.approx(
        (0.1 - camera.T_base_camera[2, 3]) / down
    )
    up = camera.T_base_camera @ np.diag([1.0, -1.0, -1.0, 1.0])
    assert distance_to_plane(up, 0.0) == np.inf
