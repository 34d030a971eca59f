"""Features found again in a later image."""

from __future__ import annotations

import numpy as np
import pytest

from arm.se3 import Array
from vision.background.features import Background, band_passed
from vision.background.tracking import NEAR, far_shift, track
from vision.camera.model import Camera
from watched.scratched import ScratchedTable, turned


def _true_shifts(background: Background, camera: Camera, now: Camera) -> Array:
    """Of points of the table at the features, (n, 2) px."""
    rays = np.insert(camera.normalised(background.points), 2, 1.0, axis=1) @ camera.T_base_camera[:3, :3].T
    t = camera.T_base_camera[:3, 3]
    return now.project_base(t - rays * (t[2] / rays[:, 2])[:, None]) - background.points


@pytest.mark.parametrize(("gain", "shade"), [(1.0, False), (0.8, True)])
def test_shifts_are_true_and_their_covariance_is_honest(
    background: Background, table: ScratchedTable, camera: Camera, gain: float, shade: bool
) -> None:
    now = turned(camera, (0.004, -0.011, 0.01))
    tracks = track(background, band_passed(table.image(now, seed=3, gain=gain, shade=shade)))
    error = tracks.shifts - _true_shifts(background, camera, now)[tracks.index]
    assert len(tracks.index) > 0.8 * len(background.points)
    assert np.median(np.linalg.norm(error, axis=1)) < 0.1
    nees = (
        np.einsum("ni,nij,nj->n", error, np.linalg.inv(tracks.covariances + 0.02**2 * np.eye(2)), error) / 2.0
    )
    assert 0.4 < np.median(nees) / 0.69 < 3.0  # the fit scales what is left


def test_what_is_covered_is_not_found(background: Background, table: ScratchedTable, camera: Camera) -> None:
    image = table.image(camera, seed=4)
    image[:, :900] = 120
    tracks = track(background, band_passed(image))
    assert (background.points[tracks.index][:, 0] > 880).all()


def test_a_camera_that_was_knocked_is_found_far_away(
    background: Background, table: ScratchedTable, camera: Camera
) -> None:
    now = turned(camera, (0.6, 0.3, 0.0))
    passed = band_passed(table.image(now, seed=5))
    shift = far_shift(background, passed)
    assert shift is not None
    assert np.linalg.norm(shift) > 3 * NEAR
    assert np.abs(shift - np.median(_true_shifts(background, camera, now), axis=0)).max() < 3.0


def test_another_table_is_found_nowhere(background: Background, camera: Camera) -> None:
    from watched.scratched import scratched_table

    assert far_shift(background, band_passed(scratched_table(77).image(camera))) is None
