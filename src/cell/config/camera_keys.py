"""Keys of the cell file about its Basler camera: the device and its settings."""

from __future__ import annotations

from dataclasses import dataclass, field

from arm.errors import InputError
from arm.io.toml_reader import TomlTable
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


def read_cell_camera(look: TomlTable) -> CellCamera:
    """Read ``[look.basler]``: device, exposure_us, gain_db, timeout_s, heartbeat_s and features (GenICam names).

    Raises:
        FileInputError: a value is wrong.
    """
    table = look.table("basler", required=False)
    device = table.text("device") if "device" in table else None
    if device is not None:
        try:
            read_selector(device)
        except InputError as error:
            raise table.error("device", str(error).partition(": ")[2]) from error
        if device == OF_CELL:
            raise table.error("device", f"must be a camera; write name:{OF_CELL} for a camera of that name")
    default = BaslerSettings()
    exposure_us = table.number("exposure_us", "us", 1, 6e7) if "exposure_us" in table else None
    features = table.table("features", required=False).value_dict()
    for name, value in features.items():
        if not isinstance(value, bool | int | float | str):
            raise table.error("features", f"{name} must be a number, a text, true or false")
    settings = BaslerSettings(
        exposure=None if exposure_us is None else exposure_us / 1e6,
        gain=table.number("gain_db", "dB", 0, 60) if "gain_db" in table else None,
        timeout=table.number("timeout_s", "s", 0.01, 120, default=default.timeout),
        heartbeat=table.number("heartbeat_s", "s", 0.5, 60, default=default.heartbeat),
        features=features,
    )
    if settings.exposure is not None and settings.timeout <= settings.exposure:
        raise table.error(
            "timeout_s", f"must be more than the exposure, {settings.exposure:g} s", "default: 2"
        )
    table.finish()
    return CellCamera(device, settings)
