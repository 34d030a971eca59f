"""Settings of video devices: made in an order that drivers need, and read back."""

from __future__ import annotations

import cv2
import pytest

from arm.errors import CameraError
from video.fake_device import FakeDevice
from vision.camera.video.selector import read_video
from vision.camera.video.settings import VideoSettings, set_device


def refuse(key: str, value: object, rule: str) -> CameraError:
    return CameraError("c", "setting", f"{key} = {value!r}: {rule}")


def test_settings_reach_the_driver_in_its_units() -> None:
    device = FakeDevice()
    features = {"AUTOFOCUS": 0, "FOURCC": "YUYV", "FOCUS": 30}
    assert set_device(device, VideoSettings(None, 0.0082, 4.0, features=features), (64, 48), refuse) == ()
    assert list(device.properties.items()) == [
        (cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*"YUYV")),
        (cv2.CAP_PROP_FRAME_WIDTH, 64),
        (cv2.CAP_PROP_FRAME_HEIGHT, 48),
        (cv2.CAP_PROP_AUTOFOCUS, 0.0),
        (cv2.CAP_PROP_FOCUS, 30.0),
        (cv2.CAP_PROP_AUTO_EXPOSURE, 1),  # manual
        (cv2.CAP_PROP_EXPOSURE, 82.0),  # of 100 us
        (cv2.CAP_PROP_GAIN, 4.0),
    ]


def test_a_focus_that_moves_is_told() -> None:
    device = FakeDevice()
    device.properties[cv2.CAP_PROP_AUTOFOCUS] = 1.0
    (doubt,) = set_device(device, VideoSettings(), None, refuse)
    assert "focus is automatic, which changes the lens" in doubt


@pytest.mark.parametrize(
    ("settings", "fixed", "told"),
    [
        (VideoSettings(gain=7.0), cv2.CAP_PROP_GAIN, "gain = 7.0: the driver does not take it; it has 3 in its own"),
        (VideoSettings(exposure=0.01), cv2.CAP_PROP_EXPOSURE, "exposure_us = 10000.0: the driver does not"),
        (VideoSettings(features={"FOURCC": "YU12"}), cv2.CAP_PROP_FOURCC, "features.FOURCC = 'YU12': the driver"),
        (VideoSettings(features={"FOCAL": 1}), None, "features.FOCAL = 1: OpenCV has no such property"),
        (VideoSettings(features={"FOCUS": "near"}), None, "features.FOCUS = 'near': must be a number"),
        (VideoSettings(features={"FOURCC": "YUY"}), None, "four letters"),
    ],
)  # fmt: skip
def test_a_setting_that_is_not_taken_is_refused(
    settings: VideoSettings, fixed: int | None, told: str
) -> None:
    device = FakeDevice()
    if fixed is not None:
        device.fixed.add(fixed)
        device.properties[fixed] = cv2.VideoWriter.fourcc(*"YV12") if fixed == cv2.CAP_PROP_FOURCC else 3.0
    with pytest.raises(CameraError) as caught:
        set_device(device, settings, None, refuse)
    assert told in str(caught.value)


def test_the_latency_depends_on_the_source_unless_stated() -> None:
    device, stream = read_video("video:0"), read_video("video:rtsp://h/x")
    assert [VideoSettings().latency_of(s) for s in (device, stream)] == [0.5, 2.0]
    assert [VideoSettings(latency=0.1).latency_of(s) for s in (device, stream)] == [0.1, 0.1]
    assert VideoSettings(exposure=0.01, gain=2.0).words() == ", exposure 10 ms, gain 2"
