"""Selectors of video sources."""

from __future__ import annotations

from pathlib import Path

import pytest

from arm.errors import InputError
from vision.camera.video.selector import VideoSelector, is_video, read_video


@pytest.mark.parametrize(
    ("text", "selector"),
    [
        ("video:0", VideoSelector("device", "0")),
        (" video: 12 ", VideoSelector("device", "12")),
        ("video:/dev/video2", VideoSelector("device", "/dev/video2")),
        ("video:0@1920x1080", VideoSelector("device", "0", (1920, 1080))),
        ("video:/dev/v4l/by-id/a b@640x480", VideoSelector("device", "/dev/v4l/by-id/a b", (640, 480))),
        ("video:rtsp://u:p@h/a@640x480", VideoSelector("stream", "rtsp://u:p@h/a@640x480")),
        ("video:HTTP://h:8080/x", VideoSelector("stream", "HTTP://h:8080/x")),
        ("video:clip.mp4", VideoSelector("file", "clip.mp4")),
        ("video:./0", VideoSelector("file", "./0")),
        ("video:C:\\clip.mp4", VideoSelector("file", "C:\\clip.mp4")),
        ("video:a@640x480", VideoSelector("file", "a@640x480")),
    ],
)
def test_a_selector_says_what_kind_of_source_it_is(text: str, selector: VideoSelector) -> None:
    assert is_video(text)
    assert read_video(text) == selector


def test_a_link_to_a_device_is_a_device_and_a_file_below_dev_is_none(tmp_path: Path) -> None:
    (tmp_path / "front").symlink_to("/dev/null")
    assert read_video(f"video:{tmp_path / 'front'}").kind == "device"
    assert read_video("video:/dev/../etc/passwd").kind == "file"


@pytest.mark.parametrize(
    "url",
    [
        "rtsp://",
        "http://host:99999/x",
        "http://host:0/x",
        "rtsp://me:sec/ret@host",
        "rtsp://me:sec ret@host/1",
    ],
)
def test_a_url_that_names_no_place_is_refused_unseen(url: str) -> None:
    with pytest.raises(InputError, match="with a host and a port from 1 to 65535") as caught:
        read_video(f"video:{url}")
    assert f"camera video:{url[:4]}://...: " in str(caught.value)
    assert "ret" not in f"{caught.value} {caught.value.data}"
    assert read_video("video:udp://@:1234").kind == "stream"  # listens


def test_a_password_is_not_shown() -> None:
    for text, shown in (
        ("video:rtsp://me:se@cret@host:554/a:b", "video:rtsp://***@host:554/a:b"),
        ("video:rtsp://host:554/a:b", "video:rtsp://host:554/a:b"),
        ("video:http://host/live?user=me&pwd=secret", "video:http://host/live?***"),
        ("video:http:/me:secret@host/x", "video:***@host/x"),
        ("video:clip@2.mp4", "video:clip@2.mp4"),
    ):
        selector = read_video(text)
        assert str(selector) == shown
        assert "cret" not in repr(selector)
    assert str(read_video("video:0@640x480")) == "video:0@640x480"
    with pytest.raises(InputError) as caught:
        read_video("video:ftp://me:secret@host/x")
    assert "video:ftp://...: a stream's protocol must be one of rtsp" in str(caught.value)
    assert "secret" not in f"{caught.value} {caught.value.data}"


@pytest.mark.parametrize("text", ["video:", "video: ", "0", "serial:0"])
def test_what_names_no_video_source_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="must be video:NUMBER, video:/dev/NAME"):
        read_video(text)


def test_paths_and_protocols() -> None:
    assert read_video("video:3").path == Path("/dev/video3")
    assert read_video("video:RTSP://h/x").scheme == "rtsp"
    assert read_video("video:clip.mp4").scheme == ""


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("video:0@1920", "video:0@1920: its size must be WIDTHxHEIGHT in px: video:0@1920x1200"),
        ("video:/dev/video0@1920*1200", "its size must be WIDTHxHEIGHT in px: video:/dev/video0@1920x1200"),
        ("video:seen/image-0001.PNG", "is an image, and video:FILE is a recording; --images FOLDER reads"),
    ],
)
def test_a_size_that_is_none_and_an_image_are_told(text: str, told: str) -> None:
    with pytest.raises(InputError) as caught:
        read_video(text)
    assert told in str(caught.value)
