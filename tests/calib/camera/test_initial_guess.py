"""The start of a calibration, from views alone."""

import numpy as np
import pytest

from calib.camera.initial_guess import initial_guess
from calib.model.intrinsics import camera_of
from pictures.targets import SIZE, camera, poses, seen, taken, views_of


@pytest.mark.parametrize("share", [0.8, 3.0])
def test_the_start_finds_wide_and_long_lenses(share):
    lens = camera_of(np.array([share * 1920, share * 1920, 960.0, 600.0, 0, 0, 0, 0, 0]), (1920, 1200))
    rng = np.random.default_rng(5)
    views = []
    for T in poses(6):
        nearer = T.copy()
        nearer[:3, 3] *= share * 1920 / camera().K[0, 0]
        view = seen(nearer, rng, lens=lens)
        if len(view.ids) >= 12:
            views.append(view)
    begun = initial_guess(views_of(views), lens.size)
    assert begun.camera.K[0, 0] == pytest.approx(share * 1920, rel=0.01)


@pytest.mark.parametrize("seed", [5, 6])
def test_the_prior_is_about_the_focal_length_whose_poses_fit_best(seed):
    begun = initial_guess(views_of(taken(seed)), SIZE)
    assert (
        begun.prior.mean[0] == 2.0 * SIZE[0]
    )  # the lab's lens has 2.5 widths; 6 fit as well after adjusting


def test_views_that_are_all_alike_have_a_start():
    begun = initial_guess(views_of([taken(3)[0]] * 3), SIZE)
    assert begun.corner_sigma < 2.0
