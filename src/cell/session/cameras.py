"""The camera of a real cell: which one the cell file and the command line say, and how it takes photographs."""

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
