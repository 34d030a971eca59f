"""Keys of the cell file about its live camera, a Basler camera or a video source: the device and its settings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

from arm.credentials import without_url
from arm.errors import InputError
from arm.io.keys import Keys, key
from arm.io.node import Node, Rule
from arm.io.rules import flag, integers, number, table, text
from vision.camera.basler import BaslerSettings
from vision.camera.basler_devices import read_selector
from vision.camera.video.selector import is_video, read_video
from vision.camera.video.settings import VideoSettings

OF_CELL = "cell"  # the selector for the device of the cell file
T = TypeVar("T")


@dataclass(frozen=True)
class CellCamera:
    """Camera of a cell file, apart from its calibration.

    Attributes:
        device: selector of a Basler camera or video source, or None.
        basler: settings for any Basler camera of the cell.
        video: settings for any video source of the cell.
    """

    device: str | None = field(default=None, repr=False)  # a URL may hold a password
    basler: BaslerSettings = field(default_factory=BaslerSettings)
    video: VideoSettings = field(default_factory=VideoSettings)


def _parsed(node: Node, parse: Callable[[str], T]) -> tuple[str, T]:
    """Return the selector of a device, and what `parse` makes of it."""
    device = text().read(node)
    try:
        return device, parse(device)
    except InputError as error:
        shown = replace(node, value=without_url(device))
        raise shown.error(str(error).partition(": ")[2]) from error


def _selector(node: Node) -> str:
    device, _ = _parsed(node, read_selector)
    if device == OF_CELL:
        raise node.error(f"must be a camera; write name:{OF_CELL} for a camera of that name")
    return device


def _video_selector(node: Node) -> str:
    device, video = _parsed(node, read_video)
    if video.kind == "file":
        raise node.error("must be a device or a stream; a recording cannot show the present cell")
    return device


def require_device(selector: str) -> None:
    """Check the selector of a cell's own camera.

    Raises:
        InputError: it is invalid, or names a recording.
    """
    if not is_video(selector):
        read_selector(selector)
    elif read_video(selector).kind == "file":
        raise InputError(f"camera {selector}: must be a device or a stream, not a recording", camera=selector)


def _features(words: str, *kinds: type) -> Rule[dict[str, Any]]:
    """Return the rule for a table of values of these types, which are `words`."""

    def read(node: Node) -> dict[str, Any]:
        features = table().read(node)
        for name, value in features.items():
            if type(value) not in kinds:
                raise node.error(f"{name} must be {words}")
        return features

    return Rule("a table", read)


_BASLER_FEATURES = _features("a number, a string, true or false", bool, int, float, str)
_VIDEO_FEATURES = _features("a number, or a string for FOURCC", int, float, str)


class CameraKeys(Keys):
    """Keys of ``[look.basler]`` and ``[look.video]``."""

    device: str | None = key("look.basler.device", Rule("a string", _selector), None)
    exposure: float | None = key("look.basler.exposure_us", number("us", 1, 6e7), None)
    gain: float | None = key("look.basler.gain_db", number("dB", 0, 60), None)
    timeout: float = key("look.basler.timeout_s", number("s", 0.01, 120), BaslerSettings.timeout)
    heartbeat: float = key("look.basler.heartbeat_s", number("s", 0.5, 60), BaslerSettings.heartbeat)
    features: Mapping[str, Any] | None = key("look.basler.features", _BASLER_FEATURES, None)
    video_device: str | None = key("look.video.device", Rule("a string", _video_selector), None)
    video_size: tuple[int, ...] | None = key("look.video.size_px", integers(2, 16, 20000), None)
    video_exposure: float | None = key("look.video.exposure_us", number("us", 100, 6e7), None)
    video_gain: float | None = key("look.video.gain", number("", 0, 1e6), None)
    video_latency: float | None = key("look.video.latency_s", number("s", 0, 60), None)
    video_timeout: float = key("look.video.timeout_s", number("s", 0.01, 120), VideoSettings.timeout)
    video_stamps: bool | None = key("look.video.stamps", flag(), None)
    video_features: Mapping[str, Any] | None = key("look.video.features", _VIDEO_FEATURES, None)


def camera_of(keys: CameraKeys, root: Node) -> CellCamera:
    """Return the camera.

    Raises:
        FileInputError: a timeout is not longer than its exposure, or both tables name a device.
    """
    basler = BaslerSettings(keys.exposure, keys.gain, keys.timeout, keys.heartbeat, keys.features or {})
    size = None if keys.video_size is None else (keys.video_size[0], keys.video_size[1])
    optional = size, keys.video_exposure, keys.video_gain, keys.video_latency
    video = VideoSettings(*optional, keys.video_timeout, keys.video_stamps, keys.video_features or {})
    for table_name, made in (("basler", basler), ("video", video)):
        if made.exposure is not None and made.timeout <= made.exposure:
            rule = f"must be more than the exposure, {made.exposure:g} s"
            raise root.error_at(f"look.{table_name}.timeout_s", rule, "default: 2")
    if keys.device is not None and keys.video_device is not None:
        rule = f"must be the cell's only camera, but look.basler.device is {keys.device!r}"
        raise root.error_at("look.video.device", rule, "name one; --camera selects another")
    return CellCamera(keys.device or keys.video_device, basler, video)
