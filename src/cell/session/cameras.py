"""The camera of a real cell, selected by cell file and command line."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from arm.errors import InputError
from cell.config.camera_keys import OF_CELL
from cell.config.cell import Cell
from cell.console import say_on_stderr
from vision.camera.basler import BaslerCamera


def require_one_camera(images: Path | None, camera: str | None) -> None:
    """Refuse two sources of images.

    Raises:
        InputError: both are given.
    """
    if images is not None and camera is not None:
        raise InputError(
            f"--images {images} and --camera {camera}: give only one source of images",
            images=str(images),
            camera=camera,
        )


@contextmanager
def open_basler(cell: Cell, camera: str | None) -> Iterator[BaslerCamera]:
    """Open the camera named by the command line, or else by the cell file, and print its description.

    Args:
        cell: states the calibration's frame size and the camera settings.
        camera: the selector of ``--camera``; None and `OF_CELL` select the device of the cell file.

    Raises:
        InputError: the selector is invalid, or the cell file has no device.
        CameraError: the camera is not available.
    """
    selector = cell.basler.device if camera in (None, OF_CELL) else camera
    if selector is None:
        raise InputError(
            f"--camera {OF_CELL}: {cell.file} names no camera; write device = ... under [look.basler]",
            file=str(cell.file),
            key="look.basler.device",
        )
    with BaslerCamera(selector, cell.basler.settings, cell.camera.size, say_on_stderr) as opened:
        say_on_stderr(opened.description)
        yield opened
