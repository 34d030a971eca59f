"""Keys of the cell file about its live camera, a Basler camera or a video source: the device and its settings."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

from arm.credentials import without_url
from arm.errors import InputError
from arm.io.keys import Keys, key
from arm.io.node import Node, Rule
from arm.io.rules import flag, integers, number, path, table, text
from vision.camera.basler import BaslerSettings
from vision.camera.basler_devices import read_selector
from vision.camera.model import Camera
from vision.camera.video.selector import is_video, read_video
from vision.camera.video.settings import VideoSettings, property_code

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


def _is_property(node: Node, name: str, value: Any) -> None:
    """Refuse what is no property of OpenCV's, with the name that is."""
    plain = name.upper().removeprefix("CAP_PROP_")

    def refuse(key: str, _: Any, rule: str) -> Exception:
        return node.error(
            f"{key.removeprefix('features.')}: {rule}", f"did you mean {plain}?" if plain != name else ""
        )

    property_code(name, value, refuse)


def _camera_file(node: Node) -> Path:
    named = text().read(node)
    if re.match(r"(name|serial|ip|class|video|rtsp|http|https):|/dev/", named) or named.isdigit():
        where = "[look.basler]" if re.match(r"name|serial|ip|class|\d", named) else "[look.video]"
        shown = replace(node, value=without_url(named))
        raise shown.error(
            "must be a camera file, with lens and pose", f"a camera itself is device in {where}"
        )
    return path().read(node)


CAMERA_FILE = Rule("a string", _camera_file)


def _features(
    words: str, *kinds: type, check: Callable[[Node, str, Any], None] | None = None
) -> Rule[dict[str, Any]]:
    """Return the rule for a table of values of these types, which are `words`; `check` is that of each."""

    def read(node: Node) -> dict[str, Any]:
        features = table().read(node)
        for name, value in features.items():
            if type(value) not in kinds:
                raise node.error(f"{name} must be {words}")
            if check is not None:
                check(node, name, value)
        return features

    return Rule("a table", read)


_BASLER_FEATURES = _features("a number, a string, true or false", bool, int, float, str)
_VIDEO_FEATURES = _features("a number, or a string for FOURCC", int, float, str, check=_is_property)


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


def _require_size(keys: CameraKeys, root: Node, lens: Camera) -> None:
    """Refuse images of another size than the lens was calibrated for."""
    asked = None if keys.video_device is None else read_video(keys.video_device).size
    for name, size in (("size_px", keys.video_size), ("device", asked)):
        if size is not None and tuple(size) != lens.size:
            rule = f"must be of images of {lens.size[0]} x {lens.size[1]} px, those of the camera file"
            raise root.error_at(f"look.video.{name}", rule, "or calibrate the lens for this size")


def _require_one_setting(keys: CameraKeys, root: Node) -> None:
    """Refuse features that are settings with a key, or that a465 itself sets."""
    for name in keys.features or {}:
        for of, given, other in (
            (name.startswith("Exposure"), keys.exposure, "exposure_us"),
            (name in ("Gain", "GainAbs", "GainAuto"), keys.gain, "gain_db"),
        ):
            if of and given is not None:
                rule = f"has {name}, and look.basler.{other} sets it"
                raise root.error_at("look.basler.features", rule, "give one")
        if name.startswith("Trigger"):
            rule = f"has {name}, which a465 itself sets: a trigger for each image"
            raise root.error_at("look.basler.features", rule)


def camera_of(keys: CameraKeys, root: Node, lens: Camera) -> CellCamera:
    """Return the camera.

    Args:
        keys, root: of the cell file.
        lens: of the camera file.

    Raises:
        FileInputError: a timeout is not longer than its exposure, both tables name a device, images are to have another
            size than the lens, or a feature is set twice.
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
    _require_size(keys, root, lens)
    _require_one_setting(keys, root)
    return CellCamera(keys.device or keys.video_device, basler, video)
