"""Settings of a video source, and how OpenCV's driver is given them."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from vision.camera.video.selector import VideoSelector

Refuse = Callable[[str, Any, str], Exception]
"""Returns the error for a setting that cannot be made, from its key, its value and the rule."""
DEVICE_LATENCY_S = 0.5  # a few frames inside a camera, and its exposure
STREAM_LATENCY_S = 2.0  # for looks without an arm; with one it must be measured and stated
EXPOSURE_UNIT_S = 1e-4  # of V4L2_CID_EXPOSURE_ABSOLUTE
V4L2_MANUAL = 1  # of V4L2_CID_EXPOSURE_AUTO


@dataclass(frozen=True)
class VideoSettings:
    """Settings of a video source; None leaves the driver's own value.

    Attributes:
        size: width and height, px; None: the calibration's, if known.
        exposure: of a V4L2 device, s.
        gain: of a device, in the driver's own unit.
        latency: a frame counts as taken after a request if it was received at least this much later, s; None: 0.5 for
            a device, 2 for a stream.
        timeout: for a frame, s.
        stamps: whether time stamps are those of a clock; None: yes, but not those of HTTP.
        features: other properties of OpenCV's, by their names without ``CAP_PROP_``, made in this order.
    """

    size: tuple[int, int] | None = None
    exposure: float | None = None
    gain: float | None = None
    latency: float | None = None
    timeout: float = 2.0
    stamps: bool | None = None
    features: Mapping[str, float | str] = field(default_factory=dict)

    def latency_of(self, selector: VideoSelector) -> float:
        """Latency for a source, s."""
        if self.latency is not None:
            return self.latency
        return STREAM_LATENCY_S if selector.kind == "stream" else DEVICE_LATENCY_S

    def first_of_device(self) -> str | None:
        """Key of the first setting that only a device has; None if there is none."""
        given = {"exposure_us": self.exposure, "gain": self.gain, "features": self.features or None}
        return next((key for key, value in given.items() if value is not None), None)

    def words(self) -> str:
        """Exposure and gain for a description, each after a comma."""
        exposure = "" if self.exposure is None else f", exposure {1e3 * self.exposure:g} ms"
        return exposure + ("" if self.gain is None else f", gain {self.gain:g}")


def set_device(
    device: Any, settings: VideoSettings, size: tuple[int, int] | None, refuse: Refuse
) -> tuple[str, ...]:
    """Make the settings of a device.

    Args:
        device: OpenCV's VideoCapture, open.
        settings: to make.
        size: width and height to ask for, px; the driver may choose others.
        refuse: makes the error for a setting.

    Returns:
        What the driver changes by itself, a sentence each.
    """
    import cv2

    codes = {name: property_code(name, value, refuse) for name, value in settings.features.items()}
    if form := settings.features.get("FOURCC"):  # the format first, as it decides on sizes
        wanted = float(cv2.VideoWriter.fourcc(*str(form)))
        _set(device, codes["FOURCC"], wanted, "features.FOURCC", form, refuse)
    if size is not None:
        device.set(cv2.CAP_PROP_FRAME_WIDTH, size[0])
        device.set(cv2.CAP_PROP_FRAME_HEIGHT, size[1])
    for name, value in settings.features.items():
        if name != "FOURCC":
            _set(device, codes[name], float(value), f"features.{name}", value, refuse)
    if settings.exposure is not None:
        _set_exposure(device, settings.exposure, refuse)
    if settings.gain is not None:
        _set(device, cv2.CAP_PROP_GAIN, settings.gain, "gain", settings.gain, refuse)
    doubts = []
    if device.get(cv2.CAP_PROP_AUTOFOCUS) > 0.0:
        doubts.append(
            "its focus is automatic, which changes the lens: features = { AUTOFOCUS = 0, FOCUS = NUMBER }"
        )
    return tuple(doubts)


def _set_exposure(device: Any, exposure: float, refuse: Refuse) -> None:
    import cv2

    wanted_us = 1e6 * exposure
    if not sys.platform.startswith("linux"):
        rule = "its unit is known on Linux only; use features = { EXPOSURE = NUMBER } in the driver's unit"
        raise refuse("exposure_us", wanted_us, rule)
    if not device.set(cv2.CAP_PROP_AUTO_EXPOSURE, V4L2_MANUAL):
        raise refuse("exposure_us", wanted_us, "automatic exposure of this camera cannot be switched off")
    units = float(max(1, round(exposure / EXPOSURE_UNIT_S)))
    _set(device, cv2.CAP_PROP_EXPOSURE, units, "exposure_us", wanted_us, refuse)


def property_code(name: str, value: Any, refuse: Refuse) -> int:
    """Return OpenCV's number of a property, after a check of its name and the type of its value."""
    import cv2

    code = getattr(cv2, f"CAP_PROP_{name}", None)
    if not isinstance(code, int):
        raise refuse(
            f"features.{name}", value, "OpenCV has no such property; use its names without CAP_PROP_"
        )
    if isinstance(value, str) != (name == "FOURCC") or (name == "FOURCC" and len(str(value)) != 4):
        raise refuse(f"features.{name}", value, 'must be a number, and of FOURCC four letters such as "YUYV"')
    return code


def _set(device: Any, code: int, wanted: float, key: str, value: Any, refuse: Refuse) -> None:
    import cv2

    accepted = device.set(code, wanted)
    now = float(device.get(code))
    near = 0.0 if code == cv2.CAP_PROP_FOURCC else 0.01 * abs(wanted) + 1e-9
    if not accepted or abs(now - wanted) > near:
        rule = (
            f"the driver does not take it; it has {now:.10g} in its own unit, and was asked for {wanted:.10g}"
        )
        raise refuse(key, value, rule)
