"""Camera calibration from corners: what is found, what is left out, and what is refused, each with its reason."""

from dataclasses import replace

import numpy as np
import pytest

from arm.se3 import frozen
from calib.camera.calibrate import calibrate_camera
from calib.camera.result import CalibrationLimits
from calib.model.intrinsics import NAMES, vector_of
from cell.sim.target_photos import random_poses
from pictures.targets import CHARUCO, SIZE, bent, camera, photos, poses, quality, seen, taken


def test_sound_views_are_accepted_and_the_lens_is_as_good_as_it_says():
    c = calibrate_camera(photos(taken(1)), CHARUCO, SIZE)
    assert c.accepted
    assert len(c.used) == 14
    off = vector_of(c.camera) - vector_of(camera())
    assert (np.abs(off) < 3.5 * c.sigmas).all()
    actual, predicted, told = (
        float(np.sqrt(np.mean(x**2))) for x in (c.work.shifts(off), c.work_sigmas, c.cross.work_sigmas)
    )
    assert actual < 2.5 * predicted
    assert 0.3 * predicted < told < 3.0 * predicted
    assert c.cross.sigma_px == pytest.approx(0.03, rel=0.1)
    assert c.corner_sigma == pytest.approx(0.03, rel=0.1)


@pytest.mark.slow
def test_a_view_that_alone_reaches_an_edge_is_no_reason_to_refuse():
    c = calibrate_camera(
        photos(taken(5)), CHARUCO, SIZE
    )  # without its ninth view the rest misses that by 0.3 px
    assert c.accepted
    assert c.cross.sigma_px == pytest.approx(0.03, rel=0.15)


@pytest.mark.parametrize("sagitta", [pytest.param(0.5e-3, marks=pytest.mark.slow), -0.25e-3])
def test_a_bent_target_is_named_with_its_bend(sagitta):
    c = calibrate_camera(photos(taken(2, shape=bent(sagitta))), CHARUCO, SIZE)
    assert not c.accepted
    assert c.hypotheses[0].name == "bent target"
    assert c.hypotheses[0].amount == pytest.approx(abs(sagitta), rel=0.1)
    assert any("the target is bent by" in reason for reason in c.reasons)


@pytest.mark.slow
def test_a_target_that_was_printed_with_unequal_scales_is_named():
    c = calibrate_camera(photos(taken(3, shape=lambda p: p * (1.0, 1.004, 1.0))), CHARUCO, SIZE)
    assert not c.accepted
    assert c.hypotheses[0].name == "stretched target"
    assert c.hypotheses[0].amount == pytest.approx(0.004, rel=0.15)
    assert any("rows are +0.39" in reason or "rows are +0.4" in reason for reason in c.reasons)


@pytest.mark.slow
def test_a_focus_that_changes_is_named():
    rng = np.random.default_rng(4)
    views = []
    for number, T in enumerate(poses(4, 14)):
        K = camera().K.copy()
        K[[0, 1], [0, 1]] *= 1.0 + 0.02 * (number / 13 - 0.5)
        views.append(seen(T, rng, lens=replace(camera(), K=K)))
    c = calibrate_camera(photos(views), CHARUCO, SIZE)
    assert not c.accepted
    assert c.hypotheses[0].name == "changed focus"
    assert c.hypotheses[0].amount == pytest.approx(0.02, rel=0.2)


@pytest.mark.slow
def test_wrong_markers_are_named_with_their_size():
    views = taken(5)
    for share, wrong in ((22.1 / 30, False), (22.3 / 30, True)):
        c = calibrate_camera(photos(views, quality(share=share)), CHARUCO, SIZE)
        assert any("its markers measure" in reason for reason in c.reasons) == wrong
    c = calibrate_camera(photos(views, quality(share=0.7)), CHARUCO, SIZE)
    assert not c.accepted
    assert any("its markers measure 21.00 mm" in r and "has 22 mm" in r for r in c.reasons)


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("worse", "word"),
    [
        (quality(blur_px=2.5), "blurred"),
        (quality(contrast=12.0), "too dark"),
        (quality(saturated=0.8), "overexposed"),
    ],
)
def test_bad_photographs_are_left_out_by_name(worse, word):
    given = photos(taken(9))
    for bad in (2, 7, 11):
        given[bad] = replace(given[bad], quality=worse)
    c = calibrate_camera(given, CHARUCO, SIZE)
    assert [i for i, v in enumerate(c.views) if not v.used] == [2, 7, 11]
    assert all(word in c.views[i].why_not for i in (2, 7, 11))


@pytest.mark.slow
def test_a_view_that_shows_the_same_again_is_left_out():
    views = taken(10)
    again = seen(poses(10, 14)[3], np.random.default_rng(99))
    c = calibrate_camera(photos([*views, again]), CHARUCO, SIZE)
    assert not c.views[14].used
    assert "shows the target in the same place as 03.png" in c.views[14].why_not


@pytest.mark.slow
def test_views_of_a_target_that_moved_are_left_out():
    views = taken(11)
    rng = np.random.default_rng(12)
    for moved in (2, 6, 9):
        views[moved] = seen(poses(11, 14)[moved], rng, noise_px=0.3)
    c = calibrate_camera(photos(views), CHARUCO, SIZE)
    assert [i for i, v in enumerate(c.views) if not v.used] == [2, 6, 9]
    assert "does not fit the other views: 0." in c.views[6].why_not
    assert c.corner_sigma == pytest.approx(0.03, rel=0.1)


@pytest.mark.slow
def test_a_corner_that_was_mistaken_is_left_out_alone():
    views = taken(13)
    pixels = views[4].corners_px.copy()
    pixels[5] += (1.0, -0.5)
    views[4] = replace(views[4], corners_px=frozen(pixels))
    c = calibrate_camera(photos(views), CHARUCO, SIZE)
    assert c.accepted
    assert np.flatnonzero(c.views[4].dropped).tolist() == [5]
    assert not any(v.dropped.any() for i, v in enumerate(c.views) if i != 4)


@pytest.mark.slow
def test_of_many_views_the_best_are_used_and_the_rest_is_held_out():
    views = taken(14, 24)
    limits = CalibrationLimits(most_views=12)
    c = calibrate_camera(photos(views), CHARUCO, SIZE, limits=limits)
    assert len(c.used) == 12
    assert sum("adds little" in v.why_not for v in c.views) == 12
    rest = [p for p, v in zip(photos(views), c.views, strict=True) if not v.used]
    other = calibrate_camera(rest, CHARUCO, SIZE, work=(c.work.near, c.work.far))
    assert np.mean(c.work_sigmas**2) < np.mean(other.work_sigmas**2)


def test_held_numbers_are_zero_and_not_called_undetermined():
    c = calibrate_camera(photos(taken(15)), CHARUCO, SIZE, held=["k3", "p1"])
    assert c.camera.distortion[[2, 4]].tolist() == [0.0, 0.0]
    assert "k3" not in c.undetermined


@pytest.mark.slow
def test_numbers_that_the_views_say_little_of_are_named_with_the_view_that_tells():
    rng = np.random.default_rng(16)
    middle = [T for T in poses(16, 60) if abs(T[0, 3]) < 0.08 and abs(T[1, 3]) < 0.06][:10]
    c = calibrate_camera(photos([seen(T, rng) for T in middle]), CHARUCO, SIZE)
    assert c.undetermined
    name, view = next(iter(c.undetermined.items()))
    assert view is not None
    assert any(r.startswith(f"{name} = ") and "the most informative view is" in r for r in c.remarks)
    told = calibrate_camera(photos([seen(T, rng) for T in [*middle, view.T_camera_target]]), CHARUCO, SIZE)
    place = NAMES.index(name)
    assert told.sigmas[place] < 0.8 * c.sigmas[place]


def test_views_at_one_distance_are_judged_a_little_beyond_it():
    rng = np.random.default_rng(22)
    placed = random_poses(camera(), CHARUCO, rng, 10, distances=(1.0, 1.0))
    c = calibrate_camera(photos([seen(T, rng) for T in placed]), CHARUCO, SIZE)
    distances = [view.distance for view in c.used]
    assert max(distances) < 1.02 * min(distances)
    assert c.work.far == pytest.approx(1.05 * min(distances), rel=1e-6)
