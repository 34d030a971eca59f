"""Where photographs come from: one small protocol, and the folder of files that implements it."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

import numpy as np
import numpy.typing as npt

from arm.errors import InputError
from arm.io.storage import read_bytes

Image = npt.NDArray[np.uint8]
"""A photograph: 8-bit grey (h, w) or BGR (h, w, 3)."""

IMAGE_SUFFIXES = (".png", ".bmp", ".tif", ".tiff", ".jpg", ".jpeg", ".pgm")


def read_grey(file: Path) -> Image:
    """A photograph as 8-bit grey, as it lies on the sensor: how its file says to turn it is no matter of the lens.

    Raises:
        InputError: it cannot be read.
    """
    import cv2

    data = np.frombuffer(read_bytes(file, "photograph"), dtype=np.uint8)
    try:
        image = (
            cv2.imdecode(data, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION) if len(data) else None
        )
    except cv2.error:  # more pixels than OpenCV takes
        image = None
    if image is None:
        raise InputError(f"{file}: cannot be read as an image", path=str(file))
    return np.asarray(image, dtype=np.uint8)


class FrameSource(Protocol):
    """Anything that takes photographs of the cell as it is now."""

    def grab(self, count: int) -> list[Image]:
        """`count` photographs, all of one size.

        Raises:
            InputError: they cannot be had.
        """
        ...


class ImageFolder:
    """Photographs in a folder, in the order of their names.

    Each is handed out once: a photograph that was already looked at says nothing about the cell of now. Whoever
    takes new photographs puts them into the folder under later names.
    """

    def __init__(self, path: Path, only_new: bool = False) -> None:
        """
        Args:
            path: the folder.
            only_new: photographs that are there now are old and never handed out.

        Raises:
            InputError: it is not there.
        """
        if not path.is_dir():
            raise InputError(f"{path}: there is no such folder of photographs", path=str(path))
        self.path = path
        self._used: set[str] = {p.name for p in path.iterdir()} if only_new else set()

    def fresh(self) -> int:
        """How many photographs were not handed out yet."""
        names = (p.name for p in self.path.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES)
        return len(set(names) - self._used)

    def grab(self, count: int) -> list[Image]:
        """The next `count` photographs that were not handed out before.

        Raises:
            InputError: too few are left, one cannot be read, or they differ in size.
        """
        files = sorted(p for p in self.path.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES)
        fresh = [p for p in files if p.name not in self._used][:count]
        if len(fresh) < count:
            used = f" ({len(self._used)} were looked at before)" if self._used else ""
            raise InputError(
                f"{self.path}: holds {len(fresh)} new photographs{used}, but {count} are asked for; "
                f"file names end in {' '.join(IMAGE_SUFFIXES)}",
                path=str(self.path),
                found=len(fresh),
                count=count,
            )
        images: list[Image] = []
        for file in fresh:
            image = read_grey(file)
            images.append(image)
            if images[-1].shape != images[0].shape:
                raise InputError(
                    f"{file}: is {image.shape[1]} x {image.shape[0]} px, but {fresh[0].name} beside it is "
                    f"{images[0].shape[1]} x {images[0].shape[0]} px; photographs of one look have one size",
                    path=str(file),
                )
        self._used.update(p.name for p in fresh)
        return images
