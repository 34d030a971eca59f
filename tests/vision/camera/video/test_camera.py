"""Cameras by OpenCV: frames from before a request are never used, and every fault ends with its reason, in time."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest

from arm.errors import CameraError
from video.fake_device import DEVICE, SIZE, STREAM, FakeDevice, plugged, scene_of
from vision.camera.frame_source import FrameSource, Image
from vision.camera.video import camera as video
from vision.camera.video.camera import MOST_REPEATS, VideoCamera
from vision.camera.video.settings import VideoSettings

pytestmark = pytest.mark.xdist_group("video")
QUICK = VideoSettings(latency=0.05, timeout=0.3)
PATIENT = VideoSettings(latency=0.05, timeout=5.0)


@pytest.fixture
def device(monkeypatch: pytest.MonkeyPatch) -> FakeDevice:
    monkeypatch.setattr(video, "MARGIN_S", 0.2)
    monkeypatch.setattr(video, "CLOSE_S", 0.2)
    return plugged(monkeypatch, FakeDevice())


def refused(camera: VideoCamera, reason: str, count: int = 1) -> str:
    with pytest.raises(CameraError) as caught:
        camera.grab(count)
    assert caught.value.data["reason"] == reason, str(caught.value)
    return str(caught.value)


def not_opened(
    selector: str, settings: VideoSettings, reason: str, size: tuple[int, int] | None = None
) -> str:
    with pytest.raises(CameraError) as caught, VideoCamera(selector, settings, size):
        pass
    assert caught.value.data["reason"] == reason, str(caught.value)
    return str(caught.value)


def test_the_driver_is_read_all_the_time(device: FakeDevice) -> None:
    with VideoCamera(DEVICE, QUICK) as camera:
        source: FrameSource = camera
        device.wait_grabs(20)  # nobody has asked for an image
        device.show(2)
        images = source.grab(3)
        assert [image.shape for image in images] == [SIZE[::-1]] * 3
        assert images[0].dtype == np.uint8
        assert [scene_of(image) for image in images] == [2, 2, 2]
        assert not np.array_equal(images[0], images[1])
    assert device.released


def test_frames_that_a_network_held_back_are_told_by_their_stamps(monkeypatch: pytest.MonkeyPatch) -> None:
    device = plugged(monkeypatch, FakeDevice("own"))
    with VideoCamera(STREAM, PATIENT) as camera:
        for scene in (2, 3):
            device.wait_grabs(10)
            device.hold(0.4)
            time.sleep(0.1)
            device.show(scene)  # what was held back until now arrives after request and latency
            assert {scene_of(image) for image in camera.grab(20)} == {scene}


def test_without_stamps_the_latency_guards(monkeypatch: pytest.MonkeyPatch) -> None:
    device = plugged(monkeypatch, FakeDevice(""))
    with VideoCamera(STREAM, VideoSettings(latency=0.5, timeout=5.0)) as camera:
        device.wait_grabs(10)
        device.hold(0.2)
        time.sleep(0.1)
        device.show(2)
        assert {scene_of(image) for image in camera.grab(5)} == {2}
        assert any("no time stamps of use: only latency_s = 0.5" in doubt for doubt in camera.doubts)


def test_an_open_source_has_handed_over_what_waited_while_it_was_opened(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    device = plugged(monkeypatch, FakeDevice(""))
    device.opening, begun = 0.3, time.monotonic()
    with VideoCamera(STREAM, PATIENT):
        assert time.monotonic() - begun >= 2.0 * device.opening


def test_a_frozen_stream_is_stale(device: FakeDevice) -> None:
    with VideoCamera(DEVICE, QUICK) as camera:
        assert len(camera.grab(1)) == 1
        device.frozen = True
        assert "sent the same image" in refused(camera, "stale", 2)
        assert "sent the same image" in refused(camera, "stale")  # not one of them is new in the next look
        device.frozen = False
        assert len(camera.grab(2)) == 2


def test_stamps_that_go_back_are_stale(device: FakeDevice) -> None:
    with VideoCamera(DEVICE, QUICK) as camera:
        device._stamps = "own"
        assert "is not after the one before" in refused(camera, "stale")


def test_stamps_that_count_frames_are_told_and_can_be_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    device = plugged(monkeypatch, FakeDevice("counted"))  # 200 frames/s, stamped as 1000
    with VideoCamera(STREAM, VideoSettings(latency=0.0, timeout=0.2)) as camera:
        device.wait_grabs(60)
        assert "late by their time stamps" in refused(camera, "stale")
    for selector, stamps in ((STREAM, False), ("video:http://camera/1", None)):
        with VideoCamera(selector, VideoSettings(latency=0.0, timeout=0.2, stamps=stamps)) as camera:
            device.wait_grabs(60)
            assert len(camera.grab(4)) == 4


@pytest.mark.parametrize(
    ("wrong", "reason", "told"),
    [
        (lambda device: setattr(device, "dead", True), "removed", "sends no more frames: it was unplugged"),
        (lambda device: device.hangs.add("grab"), "hung", "no answer within 0.5 s; unplug"),
        (lambda device: setattr(device, "slow", 0.4), "timeout", "no frame within 0.3 s"),
        (lambda device: setattr(device, "damaged", 1000), "failed", "3 frames of one look could not be decoded"),
        (lambda device: setattr(device, "size", (64, 24)), "size", "sent a frame of 64 x 24 px, but 32 x 24 px are"),
    ],
    ids=["dies", "hangs", "slow", "damaged", "size"],
)  # fmt: skip
def test_what_goes_wrong_has_its_reason(
    device: FakeDevice, wrong: Callable[[FakeDevice], None], reason: str, told: str
) -> None:
    with VideoCamera(DEVICE, QUICK) as camera:
        device.wait_grabs(5)
        wrong(device)
        assert told in refused(camera, reason)
    device.free.set()
    refused(camera, "closed")


def test_two_damaged_frames_are_told_and_left_out(device: FakeDevice) -> None:
    told: list[str] = []
    with VideoCamera(DEVICE, QUICK, tell=told.append) as camera:
        device.damaged = 2
        assert len(camera.grab(3)) == 3
    assert told == ["camera video:/dev/null: image 1 of 3 was damaged and is taken again"] * 2


@pytest.mark.parametrize("call", ["open", "grab"])
def test_an_opening_that_hangs_holds_nothing_up(
    device: FakeDevice, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    monkeypatch.setattr(video, "OPEN_S", 0.1)
    device.hangs.add(call)
    assert "no answer within 0.1 s" in not_opened(DEVICE, QUICK, "hung")
    device.free.set()


def test_a_release_that_hangs_is_told(device: FakeDevice) -> None:
    told: list[str] = []
    device.hangs.add("release")
    with VideoCamera(DEVICE, QUICK, tell=told.append):
        pass
    assert told == [
        "camera video:/dev/null: closing it: no answer within 0.2 s; unplug the camera and plug it in again"
    ]
    device.free.set()


def test_a_source_that_cannot_be_opened_is_told(
    device: FakeDevice, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(video, "why_no_stream", lambda url, waited, deadline: f"{deadline:g} s")
    assert "/dev/video9x: not found" in not_opened("video:/dev/video9x", QUICK, "missing")
    assert "no such video file" in not_opened(f"video:{tmp_path / 'no.avi'}", QUICK, "missing")
    assert "are needed" in not_opened(DEVICE, QUICK, "size", (64, 48))
    device.properties[cv2.CAP_PROP_FRAME_COUNT] = 300.0
    assert "is a recording that is sent over the network" in not_opened(STREAM, QUICK, "stale")
    device.dead = True
    monkeypatch.setattr(video, "VIDEO_MAJOR", os.major(os.stat("/dev/null").st_rdev))
    assert "another program has it open" in not_opened(DEVICE, QUICK, "in use")
    told = not_opened(STREAM, QUICK, "missing")
    assert told.startswith("camera video:rtsp://***@camera/1: 10 s")


@pytest.mark.parametrize(
    ("path", "kind"),
    [
        ("", "a directory"),
        ("pipe", "a pipe"),
        ("/dev", "a directory"),
        ("/dev/null", "a character device that is no camera"),
    ],
)
def test_what_exists_and_is_no_camera_is_named(
    device: FakeDevice, tmp_path: Path, path: str, kind: str
) -> None:
    os.mkfifo(tmp_path / "pipe")
    device.dead = True
    said = not_opened(f"video:{tmp_path / path}", QUICK, "missing")
    assert said.endswith(f"is no video file or camera: {kind}")


def test_a_device_that_one_may_not_open_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.access", lambda path, mode: False)
    assert "usermod -aG video" in not_opened(DEVICE, QUICK, "permission")


def test_streams_have_limits_for_opening_and_reading(device: FakeDevice) -> None:
    with VideoCamera(STREAM, QUICK) as camera:
        assert camera.description == "camera video:rtsp://***@camera/1: 32 x 24 px"
        assert "compression can shift edges" in " ".join(camera.doubts)
    source, backend, limits = device.opened
    assert (source, backend) == ("rtsp://me:secret@camera/1", cv2.CAP_FFMPEG)
    assert limits == [
        cv2.CAP_PROP_OPEN_TIMEOUT_MSEC,
        10000,
        cv2.CAP_PROP_READ_TIMEOUT_MSEC,
        300,
        cv2.CAP_PROP_N_THREADS,
        1,
    ]
    for settings in (
        VideoSettings(gain=3.0),
        VideoSettings(exposure=0.01),
        VideoSettings(features={"HUE": 1.0}),
    ):
        assert "set it in the camera itself" in not_opened(STREAM, settings, "setting")


def write_clip(file: Path, codec: str, images: Sequence[Image]) -> None:
    height, width = images[0].shape[:2]
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*codec), 10.0, (width, height))
    for image in images:
        writer.write(image)
    writer.release()


def test_a_recording_that_repeats_its_frames_gives_each_image_once(tmp_path: Path) -> None:
    """As one that was recorded faster than its camera sends: scatter between images was told to be 0."""
    rng = np.random.default_rng(1)
    images = [rng.integers(0, 256, (48, 64, 3), dtype=np.uint8) for _ in range(3)]
    file = tmp_path / "doubled.mkv"
    write_clip(file, "FFV1", [image for image in images for _ in range(2)])
    with VideoCamera(f"video:{file}") as camera:
        found = camera.grab(3)
        assert not any(np.array_equal(a, b) for a, b in pairwise(found))
        assert "its last 1 repeat the one before to the bit; 3 were used" in refused(camera, "ended")
    frozen = tmp_path / "frozen.mkv"
    write_clip(frozen, "FFV1", images[:1] * (MOST_REPEATS + 2))
    with VideoCamera(f"video:{frozen}") as camera:
        camera.grab(1)
        assert f"repeats the same image more than {MOST_REPEATS} times" in refused(camera, "stale")


def test_a_file_gives_each_of_its_frames_once(tmp_path: Path) -> None:
    file, rng = tmp_path / "clip.avi", np.random.default_rng(0)
    truth = [np.full((48, 64, 3), level, dtype=np.uint8) for level in (40, 80, 120)]
    for image in truth:
        image[8:16] = rng.integers(0, 256, (1, 64, 1))
    write_clip(file, "MJPG", truth)
    with VideoCamera(f"video:{file}") as camera:
        first, second = camera.grab(2)
        assert abs(int(first[40, 3]) - 40) < 3
        assert abs(int(second[40, 3]) - 80) < 3
        assert abs(int(camera.grab(1)[0][40, 3]) - 120) < 3
        assert "the recording has no more frames; 3 were used" in refused(camera, "ended")
        assert "it is a recording" in camera.doubts[0]
    with VideoCamera(f"video:{file}", size=(32, 24)) as camera:
        assert "sent a frame of 64 x 48 px" in refused(camera, "size")
    (tmp_path / "text.avi").write_text("no video")
    assert "cannot be read as a video" in not_opened(f"video:{tmp_path / 'text.avi'}", QUICK, "missing")
