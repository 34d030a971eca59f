"""Which camera a selector means."""

from __future__ import annotations

from pathlib import Path

import pytest

from arm.errors import CameraError, InputError
from vision.camera.basler_devices import FoundDevice, Selector, read_selector

pytestmark = pytest.mark.xdist_group("basler_parts")

LAB = [
    FoundDevice("camera-crs93", "21923415", "192.168.0.7", "BaslerGigE", "acA1920-40gm"),
    FoundDevice("camera-crs97", "21923416", "192.168.0.8", "BaslerGigE", "acA1920-40gm"),
    FoundDevice("21923415", "40000001", "", "BaslerUsb", "a2A1920-160um"),
    FoundDevice("", "40000002", "", "BaslerUsb", "a2A1920-160um"),
    FoundDevice("twin", "40000003", "", "BaslerCamEmu", "Emulation"),
    FoundDevice("twin", "40000004", "", "BaslerCXP", "boA1936"),
]


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("camera-crs93", 0),
        ("name:camera-crs97", 1),
        ("serial:21923415", 0),
        ("21923415", 2),  # a name goes before a serial number
        ("40000002", 3),
        (" ip : 192.168.0.8 ", 1),
        ("class:BaslerCXP", 5),
    ],
)
def test_a_selector_finds_its_camera(text: str, number: int) -> None:
    assert read_selector(text).choose(LAB) == number


@pytest.mark.parametrize(
    ("text", "reason", "message"),
    [
        (
            "twin",
            "ambiguous",
            "camera twin: matches 2 cameras; use serial:NUMBER; connected: acA1920-40gm name:camera",
        ),
        ("class:BaslerUsb", "ambiguous", "matches 2 cameras"),
        ("name:21923416", "missing", "camera name:21923416: not found; connected:"),
        ("serial:camera-crs93", "missing", "serial:21923415 ip:192.168.0.7 class:BaslerGigE"),
        ("ip:192.168.0.9", "missing", "not found"),
    ],
)
def test_a_selector_that_means_none_or_several_lists_all(text: str, reason: str, message: str) -> None:
    with pytest.raises(CameraError, match=message) as caught:
        read_selector(text).choose(LAB)
    assert caught.value.data["reason"] == reason
    assert len(caught.value.data["found"]) == len(LAB)
    with pytest.raises(CameraError, match="not found, nor is any other; is it powered"):
        read_selector(text).choose([])


def test_a_folder_or_a_recording_for_a_camera_is_told(tmp_path: Path) -> None:
    (clip := tmp_path / "clip.mp4").touch()
    for devices in ([], LAB):
        with pytest.raises(CameraError, match=r"is no camera but a folder \(images of a folder: --images\)"):
            read_selector(str(tmp_path)).choose(devices)
        with pytest.raises(CameraError, match=rf"is no camera but a file \(a recording: video:{clip}\)"):
            read_selector(str(clip)).choose(devices)


@pytest.mark.parametrize("text", ["", "  ", "name:", ":x", "colour:red", "ip:camera", "ip:192.168.0.300"])
def test_what_is_no_selector_is_told(text: str) -> None:
    with pytest.raises(InputError, match="must be"):
        read_selector(text)


def test_a_selector_is_written_as_it_was_read() -> None:
    assert str(read_selector("ip:10.0.0.1")) == "ip:10.0.0.1"
    assert read_selector(" lab ") == Selector("", "lab")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("0", True),
        ("12", True),
        ("name:0", False),
        ("21", True),
        ("40123456", False),
        ("/dev/video0", True),
        ("/dev/v4l/by-id/usb-cam", True),
        ("/dev/sda", False),
    ],
)
def test_the_number_or_device_of_a_webcam_is_told_with_its_kind(text: str, told: bool) -> None:
    with pytest.raises(CameraError) as refused:
        read_selector(text).choose([])
    assert (f"for a webcam give video:{text}" in str(refused.value)) == told


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("Serial:21923415", "kinds are written small: serial:"),
        ("rtsp://host/a", "a stream is video:rtsp://"),
        ("sn:21923415", "cameras of other makes are video:SOURCE"),
    ],
)
def test_what_may_be_meant_by_another_kind_is_told(text: str, told: str) -> None:
    with pytest.raises(InputError) as caught:
        read_selector(text)
    assert told in str(caught.value)


def test_a_bare_address_is_sent_to_its_kind() -> None:
    with pytest.raises(CameraError, match=r"not found.*\(for a camera of this address give ip:10\.0\.0\.7\)"):
        read_selector("10.0.0.7").choose([])
