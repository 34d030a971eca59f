"""Keys of the cell file about its Basler camera: the device and its settings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from arm.errors import InputError
from arm.io.keys import Keys, key
from arm.io.node import Node, Rule
from arm.io.rules import number, table, text
from vision.camera.basler import BaslerSettings
from vision.camera.basler_devices import read_selector

OF_CELL = "cell"  # the selector for the device of the cell file


@dataclass(frozen=True)
class CellCamera:
    """Camera of a cell file, apart from its calibration.

    Attributes:
        device: selector of a Basler camera, or None.
        settings: settings for any Basler camera of the cell.
    """

    device: str | None = None
    settings: BaslerSettings = field(default_factory=BaslerSettings)


def _selector(node: Node) -> str:
    device = text().read(node)
    try:
        read_selector(device)
    except InputError as error:
        raise node.error(str(error).partition(": ")[2]) from error
    if device == OF_CELL:
        raise node.error(f"must be a camera; write name:{OF_CELL} for a camera of that name")
    return device


def _features(node: Node) -> dict[str, Any]:
    features = table().read(node)
    for name, value in features.items():
        if not isinstance(value, bool | int | float | str):
            raise node.error(f"{name} must be a number, a string, true or false")
    return features


class CameraKeys(Keys):
    """Keys of ``[look.basler]``."""

    device: str | None = key("look.basler.device", Rule("a string", _selector), None)
    exposure: float | None = key("look.basler.exposure_us", number("us", 1, 6e7), None)
    gain: float | None = key("look.basler.gain_db", number("dB", 0, 60), None)
    timeout: float = key("look.basler.timeout_s", number("s", 0.01, 120), BaslerSettings.timeout)
    heartbeat: float = key("look.basler.heartbeat_s", number("s", 0.5, 60), BaslerSettings.heartbeat)
    features: Mapping[str, Any] | None = key("look.basler.features", Rule("a table", _features), None)


def camera_of(keys: CameraKeys, root: Node) -> CellCamera:
    """Return the camera.

    Raises:
        FileInputError: the timeout is not longer than the exposure.
    """
    settings = BaslerSettings(keys.exposure, keys.gain, keys.timeout, keys.heartbeat, keys.features or {})
    if keys.exposure is not None and keys.timeout <= keys.exposure:
        rule = f"must be more than the exposure, {keys.exposure:g} s"
        raise root.error_at("look.basler.timeout_s", rule, "default: 2")
    return CellCamera(keys.device, settings)
