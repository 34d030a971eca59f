"""True network streams on this machine: no frame is older than its request, and every fault ends in one line."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager

import pytest

from arm.errors import CameraError
from video.http_camera import http_camera
from video.rtsp_camera import rtsp_camera
from video.timed_frames import TimedCamera, time_of
from vision.camera.video import camera as video
from vision.camera.video.camera import VideoCamera
from vision.camera.video.settings import VideoSettings

pytestmark = pytest.mark.xdist_group("video")
PATIENT = VideoSettings(latency=0.02, timeout=5.0)
QUICK = VideoSettings(latency=0.02, timeout=1.0)
Serve = Callable[..., AbstractContextManager[str]]
both = pytest.mark.parametrize("serve", [http_camera, rtsp_camera], ids=["http", "rtsp"])


def require_new(camera: VideoCamera, count: int) -> None:
    """Take images, each of which must have been taken after the request; times in frames are cut to ms."""
    asked = time.monotonic()
    images = camera.grab(count)
    assert min(map(time_of, images)) >= asked - 0.001


def why(camera: VideoCamera, reason: str) -> str:
    with pytest.raises(CameraError) as caught:
        camera.grab(1000)
    assert caught.value.data["reason"] == reason, str(caught.value)
    return str(caught.value)


def why_not_open(selector: str, reason: str, settings: VideoSettings = QUICK) -> str:
    with pytest.raises(CameraError) as caught, VideoCamera(selector, settings):
        pass
    assert caught.value.data["reason"] == reason, str(caught.value)
    return str(caught.value)


@both
def test_no_frame_that_queued_before_the_request_is_used(serve: Serve) -> None:
    sender = TimedCamera(0.01)
    with serve(sender) as selector, VideoCamera(selector, PATIENT) as camera:
        for _ in range(2):
            begun = sender.sent
            while sender.sent < begun + 25:  # as many would queue while nobody reads
                time.sleep(0.01)
            require_new(camera, 3)


@both
def test_no_frame_that_the_network_held_back_is_used(serve: Serve) -> None:
    sender = TimedCamera(0.01)
    with serve(sender) as selector, VideoCamera(selector, PATIENT) as camera:
        sender.held = True
        time.sleep(0.15)
        threading.Timer(0.15, setattr, (sender, "held", False)).start()
        require_new(camera, 10)


@both
def test_a_new_size_is_refused(serve: Serve) -> None:
    sender = TimedCamera(0.01)
    with serve(sender) as selector, VideoCamera(selector, PATIENT) as camera:
        sender.size = (192, 80)  # which OpenCV alone would scale to the old one
        assert "sent a frame of 192 x 80 px, but 128 x 80 px are needed" in why(camera, "size")


@both
@pytest.mark.parametrize("fault", ["stalled", "ended"])
def test_a_stream_that_stalls_or_ends_is_told_in_one_line(
    serve: Serve, fault: str, capfd: pytest.CaptureFixture[str]
) -> None:
    sender = TimedCamera(0.01)
    with serve(sender) as selector, VideoCamera(selector, QUICK) as camera:
        setattr(sender, fault, True)
        time.sleep(0.2)  # the last frame has come
        told = why(camera, "removed")
        assert (
            "sends no more frames: it was unplugged, its stream ended, or its network is lost; nothing"
            in told
        )
        assert ("nothing came for 1." in told) == (fault == "stalled")
        assert "sends no more frames" in why(camera, "removed")
    assert capfd.readouterr().err == ""  # OpenCV and FFmpeg add no lines of their own


@both
def test_a_first_frame_may_be_late_but_has_a_deadline(serve: Serve, monkeypatch: pytest.MonkeyPatch) -> None:
    with serve(TimedCamera(0.01, first_after=0.2)) as selector, VideoCamera(selector, PATIENT) as camera:
        require_new(camera, 1)
    monkeypatch.setattr(video, "OPEN_S", 1.0)
    with serve(TimedCamera(0.01, first_after=60.0)) as selector:
        reason, told = {
            "http": ("missing", "no frame came from there within 0.5 s"),
            "rtsp": ("removed", "opened, but gives no frame"),  # its answers came
        }[selector.split(":")[1]]
        assert told in why_not_open(selector, reason, VideoSettings(timeout=0.3))


def test_an_address_without_a_stream_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(video, "OPEN_S", 1.0)
    with http_camera(TimedCamera()) as selector:
        wrong = selector.replace("live", "wrong")
        assert "answers, but gives no stream; check path, user name and password" in why_not_open(
            wrong, "missing"
        )
        silent = selector.replace("live", "silent")
        assert "no frame came from there within 0.5 s" in why_not_open(silent, "missing")
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        for scheme in ("http", "rtsp"):
            url = f"video:{scheme}://127.0.0.1:{closed.getsockname()[1]}/live"
            assert "cannot be reached (Connection refused); is the camera on" in why_not_open(url, "missing")


def test_a_login_is_used_and_never_shown(capfd: pytest.CaptureFixture[str]) -> None:
    with rtsp_camera(TimedCamera(0.01), "me:sec@ret") as selector:
        right, wrong = (selector.replace("//", f"//{login}@") for login in ("me:sec%40ret", "me:guess"))
        with VideoCamera(right, PATIENT) as camera:
            require_new(camera, 1)
            shown = f"{camera.description} {camera.doubts} {camera.selector!r}"
        refused = why_not_open(wrong, "missing")
        assert "check path, user name and password" in refused
        assert "//***@127.0.0.1" in refused
    said = capfd.readouterr()
    for secret in ("sec", "guess"):
        assert secret not in f"{shown} {refused} {said.out} {said.err}".replace("seconds", "")
