"""A camera that has turned since its calibration: how far, how surely, and images as it saw them before."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.se3 import inverse, rotation_vector
from vision.background.camera_shift import CameraShift, as_calibrated, measure_shift, require_one_scene
from vision.background.features import Background, background_features
from vision.background.watch import distance_to_plane
from vision.camera.model import Camera
from watched.scratched import ScratchedTable, scratched_table, turned


def _measured(
    background: Background, camera: Camera, table: ScratchedTable, now: Camera, seed: int
) -> CameraShift:
    distance = distance_to_plane(camera.T_base_camera, 0.0)
    return measure_shift(background, table.image(now, seed=seed), camera, distance)


def test_the_rotation_is_measured_and_its_covariance_is_honest(
    background: Background, table: ScratchedTable, camera: Camera
) -> None:
    rng = np.random.default_rng(0)
    nees = []
    for seed in range(6):
        now = turned(camera, rng.normal(0.0, 0.01, 3).tolist())
        shift = _measured(background, camera, table, now, seed)
        true = rotation_vector((inverse(camera.T_base_camera) @ now.T_base_camera)[:3, :3])
        error = shift.rotation - true
        assert (np.degrees(np.abs(error)) < (3e-4, 3e-4, 1.5e-3)).all()
        assert abs(shift.scale) < 5.0 * shift.scale_sigma + 1e-5
        nees.append(error @ np.linalg.solve(shift.covariance, error) / 3.0)
    assert 0.1 < np.mean(nees) < 2.5


@pytest.mark.slow
def test_a_camera_that_stands_still_is_never_said_to_have_moved(
    background: Background, table: ScratchedTable, camera: Camera
) -> None:
    assert not any(_measured(background, camera, table, camera, seed).is_certain for seed in range(8))


def test_a_board_over_the_background_is_no_moved_camera(
    background: Background, table: ScratchedTable, camera: Camera
) -> None:
    now = turned(camera, (0.0, 0.008, 0.0))
    image = table.image(now, seed=1)
    image[100:900, 300:1300] = table.image(turned(camera, (0.1, 0.0, 0.0)), seed=2)[
        100:900, 300:1300
    ]  # another place
    shift = measure_shift(background, image, camera, distance_to_plane(camera.T_base_camera, 0.0))
    assert np.degrees(shift.rotation) == pytest.approx((0.0, 0.008, 0.0), abs=1e-3)
    assert shift.seen < 0.8 * len(background.points)


@pytest.mark.parametrize("degrees", [(0.5, 0.0, 0.0), (0.0, 0.2, 0.5)])
def test_a_large_turn_is_refused_with_its_millimetres(
    background: Background, table: ScratchedTable, camera: Camera, degrees: tuple[float, float, float]
) -> None:
    now = turned(camera, degrees)
    shift = _measured(background, camera, table, now, 0)
    moved = np.degrees(np.linalg.norm(shift.rotation))
    assert moved == pytest.approx(np.linalg.norm(degrees), rel=0.01)
    with pytest.raises(
        ImpossibleError, match=r"moved by \d+\.\d\d \+- .*camera_moved_mm.*fasten it"
    ) as refused:
        shift.require_small(2e-3)
    assert refused.value.data["moved_mm"] == pytest.approx(1e3 * shift.move)
    assert refused.value.exit_code == 3


def test_a_camera_that_was_lowered_is_refused_for_the_scale(
    background: Background, table: ScratchedTable, camera: Camera
) -> None:
    shift = _measured(background, camera, table, turned(camera, (0, 0, 0), (0.0, 0.0, 0.0015)), 0)
    assert shift.scale == pytest.approx(0.0015 / 1.19, rel=0.1)
    with pytest.raises(ImpossibleError, match=r"distance or focal length changed.*1\.5 mm of height"):
        shift.require_small(2e-3)


def test_another_table_is_not_recognised(background: Background, camera: Camera) -> None:
    with pytest.raises(ImpossibleError, match="the background is not recognised"):
        _measured(background, camera, scratched_table(5), camera, 0)


def test_images_are_as_from_the_calibrated_pose(
    background: Background, table: ScratchedTable, camera: Camera
) -> None:
    now = turned(camera, (0.012, -0.02, 0.02))
    shift = _measured(background, camera, table, now, 3)
    before = table.image(camera, noise=0.0).astype(float)
    again = as_calibrated(table.image(now, noise=0.0), camera, shift).astype(float)[50:-50, 50:-50]
    assert np.abs(again - before[50:-50, 50:-50]).max() < 6.0  # of specks up to 70 deep; 60 without
    assert np.abs(table.image(now, noise=0.0).astype(float) - before).max() > 40.0


def test_a_translation_is_covered_by_the_covariance(background: Background, camera: Camera) -> None:
    """What looks the same at the table is not the same above it: at 0.1 m, a tenth of the shift at most."""
    shift = replace(
        measure_shift(background, scratched_table().image(turned(camera, (0.02, 0, 0))), camera, 1.19),
        covariance=np.zeros((3, 3)),
    )
    J = np.concatenate(
        [np.eye(3), -np.cross(np.eye(3), (0.0, 0.0, 1.09))], axis=1
    )  # of a point at 1.09 m by the twist
    off = np.sqrt(np.diag(J @ shift.twist_covariance @ J.T))
    assert off.max() == pytest.approx(0.1 * np.radians(0.02) / np.sqrt(3.0), rel=0.05)


def test_images_of_different_scenes_are_told_apart(camera: Camera, table: ScratchedTable) -> None:
    images = [table.image(camera, seed=n) for n in (90, 91, 92)]
    swayed = table.image(turned(camera, (0.0, 0.02, 0.0)), seed=93)
    other = scratched_table(seed=5).image(camera, seed=94)
    for good in ([images[0]], images[:2], [*images, swayed]):
        require_one_scene(background_features(good, camera), good, camera)
    bad = [images[0], other, *images[1:]]
    with pytest.raises(
        ImpossibleError, match=r"do not show one scene at rest: image 2 of 4 shows \d+ of the \d+ f"
    ):
        require_one_scene(background_features(bad, camera), bad, camera)
