"""Guided taking of views: which frames count, each refusal in its words, and when it is enough."""

from dataclasses import replace

import numpy as np
import pytest

from arm.se3 import frozen
from calib.camera.calibrate import calibrate_camera
from calib.camera.guided_capture import ENOUGH_VIEWS, FIRST, Advice, GuidedViews
from calib.camera.result import CameraCalibration
from calib.camera.view_selection import TargetPhoto
from pictures.targets import CHARUCO, photos, poses, quality, seen
from vision.targets.target import TargetView

SIZE = (1920, 1200)


def moved(view: TargetView, by_px: float) -> TargetView:
    return replace(view, corners_px=frozen(view.corners_px + (by_px, 0.0)))


def test_a_frame_counts_when_it_is_good_and_the_target_was_there_before() -> None:
    view = seen(poses(1, 1)[0], np.random.default_rng(1))
    guided = GuidedViews(CHARUCO, SIZE)
    (good,) = photos([view])
    assert guided.consider(TargetPhoto("empty.png", None, None)) == "no target in view"
    assert guided.consider(good) == "hold it still"
    assert guided.consider(replace(good, view=moved(view, 2.0))) == "hold it still"
    assert guided.consider(good) == "hold it still"
    for worse, words in (
        (quality(contrast=20.0), "too dark"),
        (quality(saturated=0.6), "overexposed"),
        (quality(blur_px=1.8), "blurred (1.8 px)"),
    ):
        assert guided.consider(replace(good, quality=worse)).startswith(words)
    assert guided.photos == []
    assert guided.consider(good) == ""
    assert guided.advice.words == FIRST[1]
    for by_px in (10.0, 10.2):
        told = guided.consider(replace(good, view=moved(view, by_px)))
    assert told == "shown before"
    for by_px in (30.0, 30.2):
        told = guided.consider(replace(good, view=moved(view, by_px)))
    assert told == ""
    assert len(guided.photos) == 2


def advice(known: CameraCalibration, count: int = len(FIRST), **changes: object) -> Advice:
    """After `count` views whose calibration is `known` with these changes."""

    class Guided(GuidedViews):
        def calibration(self) -> CameraCalibration:
            return replace(known, **changes)

    guided = Guided(CHARUCO, SIZE)
    for photo in photos([seen(T, np.random.default_rng(2)) for T in poses(4, count)]):
        guided.consider(photo)
        assert guided.consider(photo) == ""
    return guided.advice


def test_guidance_ends_when_all_is_known_to_a_third_of_the_limit_or_after_many_views() -> None:
    rng = np.random.default_rng(3)
    known = calibrate_camera(photos([seen(T, rng) for T in poses(3, 12)]), CHARUCO, SIZE)
    assert known.accepted
    lacking = {"k3": known.next[2]}
    good = {"work_sigmas": np.full(162, 0.09e-3), "undetermined": {}}
    fair = {**good, "work_sigmas": np.append(np.full(161, 0.09e-3), 0.11e-3)}
    assert advice(known, **good).done
    assert advice(known, **good).work_mm == pytest.approx(0.09)
    assert not advice(known, **fair).done
    assert advice(known, **fair).T_camera_target is known.next[0].T_camera_target
    assert not advice(known, **good, reasons=("bent",)).done
    told = advice(known, **{**good, "undetermined": lacking})
    assert not told.done
    assert told.words == known.next[2].words
    assert advice(known, ENOUGH_VIEWS, **fair).done
    assert not advice(known, ENOUGH_VIEWS, **fair, reasons=("bent",)).done
    assert not advice(known, ENOUGH_VIEWS - 1, **fair).done
    assert advice(known, next=()).words in FIRST[1:]
