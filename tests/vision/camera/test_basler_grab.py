"""Frames of a Basler camera: current, undamaged, in order, or refused."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from pictures.cameras import SERIAL, Wrong, misnumbered, photographs, refused, settings, showing
from vision.camera.basler import BaslerCamera, BaslerSettings
from vision.camera.basler_grab import LAST_SHORT, NO_NUMBER, FrameOrder

pytestmark = pytest.mark.xdist_group("basler")


@pytest.fixture(autouse=True)
def two_cameras(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pylon counts its emulated cameras whenever it is asked what is there."""
    monkeypatch.setenv("PYLON_CAMEMU", "2")


def test_no_photograph_is_older_than_the_look(camera: BaslerCamera, tmp_path: Path) -> None:
    for seed in range(5):
        truth = photographs(tmp_path / "shots", seed=seed)
        assert np.array_equal(camera.grab(2), truth[:2])


def test_a_damaged_frame_is_told_and_taken_anew(
    camera: BaslerCamera, told: list[str], tmp_path: Path
) -> None:
    truth = photographs(tmp_path / "shots", 2, seed=1)
    camera.device.ForceFailedBufferCount.Value = 1
    camera.device.ForceFailedBuffer.Execute()
    assert np.array_equal(camera.grab(2), truth)
    (line,) = told
    assert "image 1 of 2 was damaged and is retaken: The buffer was incompletely grabbed" in line


def test_no_look_with_many_damaged_frames(camera: BaslerCamera, told: list[str], tmp_path: Path) -> None:
    camera.device.ImageFilename.Value = str(tmp_path / "nowhere")
    assert "3 frames of one look were damaged: Failed to load image file" in refused(camera, "failed")
    assert len(told) == 2
    camera.device.ImageFilename.Value = str(tmp_path / "shots")
    assert len(camera.grab(3)) == 3


def test_a_frame_that_does_not_come_ends_the_look(tmp_path: Path) -> None:
    truth = photographs(tmp_path / "shots")
    with BaslerCamera(SERIAL, settings(tmp_path, 0.3)) as camera:
        real = camera.device
        camera.device = Wrong(real, ExecuteSoftwareTrigger=lambda: None)
        assert "no frame within 0.3 s of its trigger" in refused(camera, "timeout")
        camera.device = Wrong(real, WaitForFrameTriggerReady=lambda *_: False)
        assert "was not ready for a trigger within 0.3 s" in refused(camera, "timeout")
        camera.device = real
        assert np.array_equal(camera.grab(3), truth)


def test_a_camera_that_does_not_tell_when_it_is_ready(camera: BaslerCamera, tmp_path: Path) -> None:
    real = camera.device

    def trigger() -> None:
        time.sleep(0.1)  # to be ready
        real.ExecuteSoftwareTrigger()

    camera.device = Wrong(
        real,
        CanWaitForFrameTriggerReady=lambda: False,
        WaitForFrameTriggerReady=lambda *_: False,
        ExecuteSoftwareTrigger=trigger,
    )
    assert np.array_equal(camera.grab(3), photographs(tmp_path / "shots"))


def test_a_frame_that_comes_too_late_is_never_passed_on(tmp_path: Path) -> None:
    big = (1920, 1200)
    photographs(tmp_path / "shots", 1, big)
    slow = BaslerSettings(timeout=0.004, features=showing(tmp_path / "shots", big))
    with BaslerCamera(SERIAL, slow) as camera:
        refused(camera, "timeout")
        camera.settings = settings(tmp_path)
        for seed in range(1, 4):
            (truth,) = photographs(tmp_path / "shots", 1, big, seed)
            assert np.array_equal(camera.grab(1)[0], truth)


@pytest.mark.parametrize("count", [1, 3])
def test_frames_that_nobody_asked_for_are_refused(camera: BaslerCamera, count: int) -> None:
    real = camera.device

    def twice() -> None:
        real.ExecuteSoftwareTrigger()
        real.WaitForFrameTriggerReady(1000)
        real.ExecuteSoftwareTrigger()

    def retrieve(*arguments: Any) -> Any:
        result, over = real.RetrieveResult(*arguments), time.monotonic() + 2.0
        while not real.NumReadyBuffers.Value and time.monotonic() < over:
            time.sleep(0.01)
        return result

    camera.device = Wrong(real, ExecuteSoftwareTrigger=twice, RetrieveResult=retrieve)
    assert "sent 1 frame without a trigger" in refused(camera, "stale", count)


@pytest.mark.parametrize(
    "number",
    [lambda n: 0, lambda n: 2 * n, lambda n: 5 - n, lambda n: n if n == 0 else 2**64 - 1],
    ids=["the same again", "one lost", "backwards", "none"],
)
def test_frames_that_do_not_follow_each_other_are_refused(camera: BaslerCamera, number: Any) -> None:
    camera.grab(1)
    camera.device = misnumbered(camera.device, number)
    assert "frames were lost, or this one is older than its trigger" in refused(camera, "stale", 3)


def test_frames_of_another_size_are_refused(tmp_path: Path) -> None:
    photographs(tmp_path / "shots")
    with BaslerCamera(SERIAL, settings(tmp_path), (1920, 1200)) as camera:
        message = refused(camera, "size")
    assert "320 x 200 px, but the camera's calibration is for 1920 x 1200 px" in message
    cv2.imwrite(str(tmp_path / "shots/01.png"), np.zeros((100, 320), np.uint8))
    with BaslerCamera(SERIAL, settings(tmp_path)) as camera:
        assert "320 x 100 px, but the previous frame was 320 x 200 px" in refused(camera, "size", 2)


@pytest.mark.parametrize(
    ("last", "frame", "first", "fits"),
    [
        (FrameOrder(), FrameOrder(0), True, True),
        (FrameOrder(), FrameOrder(17), True, True),  # nothing is known yet
        (FrameOrder(), FrameOrder(17), False, False),
        (FrameOrder(), FrameOrder(NO_NUMBER), True, False),
        (FrameOrder(), FrameOrder(None), True, False),
        (FrameOrder(4), FrameOrder(5), False, True),
        (FrameOrder(4), FrameOrder(4), False, False),
        (FrameOrder(4), FrameOrder(6), False, False),
        (FrameOrder(4), FrameOrder(3), False, False),
        (FrameOrder(4), FrameOrder(1), False, False),
        (FrameOrder(4), FrameOrder(1), True, True),  # numbers begin anew, or go on
        (FrameOrder(4), FrameOrder(5), True, True),
        (FrameOrder(4), FrameOrder(6), True, False),
        (FrameOrder(LAST_SHORT), FrameOrder(1), False, True),
        (FrameOrder(LAST_SHORT), FrameOrder(LAST_SHORT + 1), False, True),
        (FrameOrder(LAST_SHORT), FrameOrder(2), False, False),
        (FrameOrder(4, 100), FrameOrder(5, 101), False, True),
        (FrameOrder(4, 100), FrameOrder(5, 100), False, False),
        (FrameOrder(4, 100), FrameOrder(0, 99), True, False),
        (FrameOrder(4, 100), FrameOrder(5, 0), False, True),  # no stamps
    ],
)
def test_order_of_frames(last: FrameOrder, frame: FrameOrder, first: bool, fits: bool) -> None:
    assert last.is_next(frame, first) is fits
