"""The camera of a real cell: of the command line, else of the environment, else of the cell file."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from arm.credentials import without_url
from arm.errors import InputError
from cell.config.camera_keys import OF_CELL, CellCamera
from cell.config.cell import Cell
from cell.console import say_on_stderr
from vision.camera.basler import BaslerCamera
from vision.camera.basler_devices import read_selector
from vision.camera.video.camera import VideoCamera
from vision.camera.video.selector import is_video, read_video

VARIABLE = "A465_CAMERA"


def require_one_camera(images: Path | None, camera: str | None) -> None:
    """Refuse two sources of images.

    Raises:
        InputError: both are given.
    """
    if images is not None and camera is not None:
        why = f"--images {images} and --camera {camera}: give only one source of images"
        raise InputError(why, images=str(images), camera=camera)


def require_live(live: CellCamera, selector: str) -> None:
    """Check that a camera can show the cell as it is, which an arm that moves needs.

    Args:
        live: camera settings of the cell.
        selector: of ``--camera``.

    Raises:
        InputError: the selector is invalid, names a recording, or a stream whose latency nobody has stated.
    """
    if not is_video(selector):
        read_selector(selector)
        return
    video = read_video(selector)
    if video.kind == "file":
        raise InputError(
            f"--camera {video}: is a recording, which cannot show the present cell; only a465 look, doctor, "
            "calibrate camera and calibrate background take one",
            camera=str(video),
        )
    if video.kind == "stream" and live.video.latency is None:
        raise InputError(
            f"--camera {video}: a stream does not tell how old its frames are; measure it (docs/cameras.md) and write "
            "latency_s = NUMBER under [look.video] of the cell file",
            camera=str(video),
            key="look.video.latency_s",
        )


def camera_by(
    selector: str,
    live: CellCamera | None = None,
    size: tuple[int, int] | None = None,
    tell: Callable[[str], None] = lambda text: None,
) -> BaslerCamera | VideoCamera:
    """The camera that a selector of ``--camera`` names, not yet open.

    Args:
        selector: of a Basler camera (`vision.camera.basler_devices`) or video source (`vision.camera.video.selector`).
        live: settings; None: the camera's own.
        size: required width and height of frames, px; None: any.
        tell: called with one line per problem that does not stop the work.

    Raises:
        InputError: the selector is invalid.
    """
    live = live or CellCamera()
    if is_video(selector):
        return VideoCamera(selector, live.video, size, tell)
    return BaslerCamera(selector, live.basler, size, tell)


def device_of(live: CellCamera | None) -> str | None:
    """The selector that the environment names, or else the cell file; None if neither does."""
    return os.environ.get(VARIABLE) or (None if live is None else live.device)


def selected(cell: Cell, camera: str | None) -> str:
    """The selector of the command line, or else the one of the cell file.

    Args:
        cell: names a device in its file, or not.
        camera: the selector of ``--camera``; None and `OF_CELL` select that of `device_of`.

    Raises:
        InputError: the cell file has no device.
    """
    selector = device_of(cell.live_camera) if camera in (None, OF_CELL) else camera
    if selector is None:
        raise InputError(
            f"--camera {OF_CELL}: {cell.file} names no camera; write device = ... under [look.basler] or [look.video], "
            f"or set {VARIABLE}",
            file=str(cell.file),
            key="look.basler.device",
        )
    return selector


@contextmanager
def open_camera(cell: Cell, camera: str | None) -> Iterator[BaslerCamera | VideoCamera]:
    """Open the camera named by the command line, or else by the cell file; print its description.

    Args:
        cell: states the calibration's frame size and the camera settings.
        camera: see `selected`.

    Raises:
        InputError: the selector is invalid, or the cell file has no device.
        CameraError: the camera is not available.
    """
    chosen = selected(cell, camera)
    if camera in (None, OF_CELL) and os.environ.get(VARIABLE):
        say_on_stderr(f"camera: {without_url(chosen)}, of {VARIABLE}")
    with camera_by(chosen, cell.live_camera, cell.camera.size, say_on_stderr) as opened:
        say_on_stderr(opened.description)
        yield opened
