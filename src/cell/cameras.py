"""The camera of a real cell: which one the cell file and the command line say, and how it takes photographs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from arm.errors import InputError
from arm.toml_table import TomlTable
from cell.console import say_on_stderr
from vision.basler import BaslerCamera, BaslerSettings
from vision.basler_devices import read_selector

if TYPE_CHECKING:
    from cell.cellfile import Cell

OF_CELL = "cell"  # the selector for the device of the cell file


@dataclass(frozen=True)
class CellCamera:
    """What a cell file says of its camera, beside the calibration.

    Attributes:
        device: selector of a Basler camera; None if there is none.
        settings: of any Basler camera that looks at the cell.
    """

    device: str | None = None
    settings: BaslerSettings = field(default_factory=BaslerSettings)


def read_cell_camera(look: TomlTable) -> CellCamera:
    """``[look.basler]``: device, exposure_us, gain_db, timeout_s, heartbeat_s, and features by the camera's own names.

    Raises:
        FileInputError: a value breaks its rule.
    """
    table = look.table("basler", required=False)
    device = table.text("device") if "device" in table else None
    if device is not None:
        try:
            read_selector(device)
        except InputError as error:
            raise table.error("device", str(error).partition(": ")[2]) from error
        if device == OF_CELL:
            raise table.error("device", f"must be a camera; write name:{OF_CELL} for one of that name")
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


def require_one_camera(images: Path | None, camera: str | None) -> None:
    """Photographs come from one place.

    Raises:
        InputError: two are given.
    """
    if images is not None and camera is not None:
        raise InputError(
            f"--images {images} and --camera {camera} are two places for photographs; give one of them",
            images=str(images),
            camera=camera,
        )


@contextmanager
def open_basler(cell: Cell, camera: str | None) -> Iterator[BaslerCamera]:
    """The camera that the command line or else the cell file names, open; it is told which one that is.

    Args:
        cell: whose calibration says how large frames are, and whose file how they are taken.
        camera: the selector of ``--camera``; None and `OF_CELL` are the device of the cell file.

    Raises:
        InputError: the selector is none, or the cell file has no device.
        CameraError: the camera cannot be had.
    """
    selector = cell.basler.device if camera in (None, OF_CELL) else camera
    if selector is None:
        raise InputError(
            f"--camera {OF_CELL}: {cell.file} names no camera; write device = ... under [look.basler]",
            file=str(cell.file),
            key="look.basler.device",
        )
    with BaslerCamera(selector, cell.basler.settings, cell.camera.size, _tell) as opened:
        _tell(opened.description)
        yield opened


def _tell(text: str) -> None:
    say_on_stderr(text)
