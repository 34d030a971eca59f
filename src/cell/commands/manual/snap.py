"""``a465 snap``: images of the cell as its camera shows it now."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from arm.errors import InputError
from cell.console import Console
from cell.files.task import cell_of
from cell.session.cameras import open_camera, selected
from cell.task.look import write_png
from vision.camera.frame_source import require_folder_name
from vision.markers.detect import detect_markers

MOST = 1000
_OURS = re.compile(r"image-(\d{4,})\.png")


def snap_step(
    place: Path, camera: str | None, output: Path, count: int | None, console: Console
) -> dict[str, Any]:
    """Take images with the cell's camera and write them to a folder, beside those that are there.

    Args:
        place: cell or task file.
        camera: selector; None: the camera of the cell file.
        output: folder, created if there is none.
        count: number of images; None: that of a look.
        console: output.

    Raises:
        InputError: a file or value is wrong, there is no camera, or it delivers no image; nothing was written.
    """
    cell = cell_of(place)
    if count is not None and not 1 <= count <= MOST:
        raise InputError(f"--count {count}: must be from 1 to {MOST}", option="--count", value=count)
    if output.exists() and not output.is_dir():
        raise InputError(f"{output}: is not a folder", folder=str(output))
    require_folder_name(output)
    selected(cell, camera)
    with console.doing("taking images"), open_camera(cell, camera) as source:
        images = source.grab(count or cell.photographs)
    first = _first_free(output)
    files = [output / f"image-{number:04d}.png" for number in range(first, first + len(images))]
    for file, image in zip(files, images, strict=True):
        write_png(file, image)
    markers = sorted(marker.id for marker in detect_markers(images[0], cell.camera, cell.dictionary))
    grey = float(images[0].mean())
    shown = ", ".join(map(str, markers)) or "none"
    console.say(f"{len(files)} images in {output}: {files[0].name} to {files[-1].name}")
    console.say(f"the first: mean grey {grey:.0f} of 255; markers {shown}")
    return {"files": [str(file) for file in files], "mean_grey": grey, "markers": markers}


def _first_free(folder: Path) -> int:
    """The number after those of the images in a folder."""
    names = [] if not folder.exists() else [file.name for file in folder.iterdir()]
    return max((int(found[1]) for name in names if (found := _OURS.fullmatch(name))), default=0) + 1
