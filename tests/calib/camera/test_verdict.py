"""The verdict of a camera calibration: each reason to refuse is named with its figure, and each remark."""

from dataclasses import replace

import numpy as np
import pytest

from arm.errors import CalibrationRefused
from arm.se3 import rotation, transform
from calib.camera.calibrate import calibrate_camera
from calib.camera.result import CalibrationLimits
from calib.camera.score_tests import inwards
from calib.camera.verdict import coverage, where
from calib.camera.view_selection import TargetPhoto
from calib.model.intrinsics import vector_of
from cell.report.camera import lens_page
from cell.sim.target_photos import random_poses
from pictures.targets import CHARUCO, SIZE, bent, camera, photos, quality, seen, taken


@pytest.mark.slow
@pytest.mark.parametrize("tilt", [0.03, 0.11])
def test_views_that_face_the_camera_are_refused_and_no_distance_is_advised(tilt):
    c = calibrate_camera(photos(taken(6, tilt=tilt)), CHARUCO, SIZE)
    assert not c.accepted
    assert "do not separate focal length from distance" in c.reasons[0]
    assert c.next == ()


def middle_poses(rng):
    """Of a target in the middle of the image, tilted."""
    return [
        transform(
            R := rotation([*rng.uniform(-0.4, 0.4, 2), 0.0]), [0.02, 0.01, 1.1] - R @ [0.105, 0.075, 0.0]
        )
        for _ in range(12)
    ]


def test_views_in_the_middle_only_are_refused_with_the_view_that_helps():
    rng = np.random.default_rng(7)
    middle = middle_poses(rng)
    c = calibrate_camera(photos([seen(T, rng) for T in middle]), CHARUCO, SIZE)
    assert not c.accepted
    assert any("the limit is 0.3 mm; take a view in the" in reason for reason in c.reasons)
    assert any("corners lie in" in remark and "near the edges too" in remark for remark in c.remarks)
    helped = [
        *photos([seen(T, rng) for T in middle]),
        *photos([seen(v.T_camera_target, rng) for v in c.next]),
    ]
    again = calibrate_camera(helped, CHARUCO, SIZE, work=(c.work.near, c.work.far))
    assert again.work_sigmas.max() < 0.25 * c.work_sigmas.max()
    left = np.sqrt(np.mean(again.work_sigmas**2) / np.mean(c.work_sigmas**2))
    promised = np.prod([1.0 - v.gain for v in c.next])
    assert left == pytest.approx(promised, rel=0.5)


@pytest.mark.slow
def test_views_that_do_not_fill_the_corners_are_accepted_for_the_part_that_they_fill():
    """Refused for the whole image, with the option; the same fit is accepted for the region in which corners lie."""
    rng = np.random.default_rng(7)
    views = photos([seen(T, rng) for T in middle_poses(rng)])
    whole = calibrate_camera(views, CHARUCO, SIZE)
    assert any("or give the part of the image that matters with --work-region" in r for r in whole.reasons)
    corners = np.concatenate([p.view.corners_px for p in views])
    region = (*map(float, np.quantile(corners, 0.1, axis=0)), *map(float, np.quantile(corners, 0.9, axis=0)))
    part = calibrate_camera(views, CHARUCO, SIZE, region=region)
    assert part.accepted
    assert np.array_equal(part.camera.K, whole.camera.K)
    assert np.array_equal(part.covariance, whole.covariance)
    assert coverage(part) == 1.0
    assert coverage(whole) < 0.5
    assert not any("corners lie in" in remark for remark in part.remarks)
    strict = calibrate_camera(views, CHARUCO, SIZE, region=region, limits=CalibrationLimits(work_mm=1e-3))
    assert any(f"mm in {where(strict)} have a standard deviation" in r for r in strict.reasons)
    assert not any("--work-region" in r for r in strict.reasons)


def test_too_few_views_are_refused_with_what_became_of_each():
    views = taken(8, 5)
    with pytest.raises(CalibrationRefused, match=r"2 of 5 images are usable.*00\.png: blurred.*04\.png"):
        calibrate_camera(
            [
                *(replace(p, quality=quality(blur_px=4.0)) for p in photos(views)[:1]),
                *photos(views)[1:3],
                *(replace(p, view=None, quality=None) for p in photos(views)[3:]),
            ],
            CHARUCO,
            SIZE,
        )
    with pytest.raises(CalibrationRefused, match=r"2 of 2 images are usable, at least 3 are needed$"):
        calibrate_camera(photos(views[:2]), CHARUCO, SIZE)
    c = calibrate_camera(photos(views), CHARUCO, SIZE)
    needed = "take 3 or more others, tilted by 20 to 45 deg, also near the edges of the image"
    assert any(f"5 views are usable, at least 8 are needed: {needed}" in reason for reason in c.reasons)
    three = calibrate_camera(
        photos([v for v, p in zip(views, c.views, strict=True) if p.tilt > CalibrationLimits().tilt][:3]),
        CHARUCO,
        SIZE,
    )
    assert len(three.views) == 3
    (reason,) = three.reasons  # not that views face the camera
    assert reason.startswith("3 views are usable")


@pytest.mark.slow
def test_views_over_hours_and_views_that_are_too_bright_are_remarked():
    given = [replace(p, taken_s=900.0 * i) for i, p in enumerate(photos(taken(17)))]
    given[5] = replace(given[5], quality=quality(saturated=0.2))
    without = TargetPhoto("nothing.png", None, None)
    c = calibrate_camera([*given, without], CHARUCO, SIZE)
    assert any("views span 3.2 h" in remark for remark in c.remarks)
    assert any("white is overexposed in 05.png:" in remark for remark in c.remarks)


def test_a_small_bend_is_told_but_does_not_refuse():
    c = calibrate_camera(photos(taken(18, count=20, shape=bent(0.08e-3))), CHARUCO, SIZE)
    assert c.accepted
    bend = next(h for h in c.hypotheses if h.name == "bent target")
    change = np.outer(bend.intrinsics_change, bend.intrinsics_change)
    alone = c.work.sigmas(c.covariance - change)
    assert np.mean(c.work_sigmas**2) > 1.5 * np.mean(alone**2)  # what the bend moves is in it
    assert c.work_sigmas**2 == pytest.approx(alone**2 + c.work.shifts(bend.intrinsics_change) ** 2)
    assert any("the target is bent by 0.0" in r and "their error includes this" in r for r in c.remarks)


@pytest.mark.slow
def test_corners_biased_inwards_are_told_and_in_the_standard_deviations():
    """Of 0.3 px: named with their amount; the lens is not refused for them, and its covariance covers what they do."""
    scores = []
    for seed in range(2):
        views = [
            replace(view, corners_px=view.corners_px + 0.3 * inwards(view.corners_px))
            for view in taken(40 + seed)
        ]
        c = calibrate_camera(photos(views), CHARUCO, SIZE)
        assert c.accepted
        remark = next(r for r in c.remarks if "corners are seen" in r)
        assert "px nearer to the middle of each view than they are: use even light" in remark
        bias = next(h for h in c.hypotheses if h.name == "biased corners")
        assert bias.amount == pytest.approx(0.3, abs=5.0 * bias.sigma)
        off = vector_of(c.camera) - vector_of(camera())
        scores.append(np.mean(c.work.shifts(off) ** 2) / np.mean(c.work_sigmas**2))
        assert np.mean(c.work.shifts(bias.intrinsics_change) ** 2) > 0.3 * np.mean(c.work_sigmas**2)
    assert np.mean(scores) < 2.0
    assert "+0.3" in lens_page(c, "biased")


@pytest.mark.slow
def test_distances_that_do_not_fit_the_work_are_remarked():
    far = calibrate_camera(photos(taken(19)), CHARUCO, SIZE, work=(0.9, 2.0))
    assert any("the working distance is 900 to 2000 mm" in remark for remark in far.remarks)
    rng = np.random.default_rng(20)
    placed = random_poses(camera(), CHARUCO, rng, 14, distances=(1.0, 1.03))
    flat = calibrate_camera(photos([seen(T, rng) for T in placed]), CHARUCO, SIZE)
    assert any("show the target at more distances" in remark for remark in flat.remarks)


@pytest.mark.slow
def test_the_worst_work_point_decides():
    views = photos(taken(21))
    c = calibrate_camera(views, CHARUCO, SIZE)
    between = 0.5e3 * float(c.work_sigmas.max() + c.work_sigmas.mean())
    assert c.accepted
    assert not calibrate_camera(views, CHARUCO, SIZE, limits=CalibrationLimits(work_mm=between)).accepted


@pytest.mark.slow
def test_a_lens_without_inverse_in_the_corners_is_a_verdict():
    """Corners in a fifth of the image: distortion that is extrapolated from there turns back on itself outside."""
    rng = np.random.default_rng(2)
    middle = np.array([*CHARUCO.size, 0.0]) / 2.0
    views = []
    for _ in range(10):
        around, tilt, z = rng.uniform(-np.pi, np.pi), rng.uniform(0.0, 0.4), rng.uniform(2.0, 2.4)
        R = rotation(tilt * np.array([np.cos(around), np.sin(around), 0.0]))
        place = np.array([rng.uniform(-0.08, 0.08), rng.uniform(-0.06, 0.06), z])
        views.append(seen(transform(R, place - R @ middle), rng, noise_px=0.3))
    c = calibrate_camera(photos(views), CHARUCO, SIZE)
    assert not c.accepted
    assert 0.0 < c.work.blind < 1.0
    assert np.isfinite(c.work_sigmas).all()
    assert any(
        "has no inverse in" in reason and "show the target there too" in reason for reason in c.reasons
    )
    page = lens_page(c, "middle")
    assert "the lens model has no inverse there" in page
    assert "nan" not in page
