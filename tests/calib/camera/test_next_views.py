"""Views to take next: what the words say is what the pose does."""

import numpy as np
import pytest

from calib.camera.next_views import next_views
from calib.camera.working_volume import working_volume
from calib.model.intrinsics import COUNT
from cell.sim.target_photos import corners_in_view
from pictures.targets import CHARUCO, camera

NEAR, FAR = 0.85, 1.2
EDGES = {"left": (-1, 0), "right": (1, 0), "upper": (0, -1), "lower": (0, 1)}


def test_every_view_is_what_its_words_say_and_can_be_seen():
    work = working_volume(camera(), NEAR, FAR)
    views = next_views(camera(), CHARUCO, 1e-3 * np.eye(COUNT), work.worth, NEAR, FAR, count=1000)
    assert len(views) > 80
    middle = np.array([*CHARUCO.size, 0.0]) / 2.0
    tilted = 0
    for view in views:
        T = view.T_camera_target
        assert corners_in_view(camera(), CHARUCO, T).mean() >= 0.5
        place, away, how = view.words.split(", ", 2)
        at = T[:3, :3] @ middle + T[:3, 3]
        assert away == f"{1e3 * at[2]:.0f} mm away"
        pixel = camera().project(at) / camera().size - 0.5
        for word, (x, y) in EDGES.items():
            assert (word in place) == (np.array([x, y]) @ pixel > 0.2)
        if how == "facing the camera":
            continue
        tilted += 1
        words = how.removeprefix("tilted 35 deg, its ").split(" ")
        towards = sum(np.array(EDGES[word]) for word in words if word in EDGES)
        # the edge that lies in that direction of the image
        edge = T[:3, :3] @ (T[:2, :2].T @ towards @ np.eye(2, 3))
        assert edge[2] < -0.5 * np.linalg.norm(edge[:2])
    assert tilted > 60


def test_the_first_view_helps_most_and_the_next_does_not_say_the_same_again():
    work = working_volume(camera(), NEAR, FAR)
    prior = np.diag([1e-6, 1e-6, 1e-6, 1e-6, 1.0, 1e-4, 1.0, 1.0, 1e-8])
    first, second = next_views(camera(), CHARUCO, prior, work.worth, NEAR, FAR, count=2)
    (after,) = next_views(camera(), CHARUCO, prior + first.information, work.worth, NEAR, FAR, count=1)
    assert 0.0 < first.gain < 1.0
    assert after.words == second.words
    assert after.gain == pytest.approx(second.gain, rel=1e-9)
