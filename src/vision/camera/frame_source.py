"""Sources of images: a protocol, and its implementation for a folder of files."""

from __future__ import annotations

import os
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Protocol

import numpy as np
import numpy.typing as npt

from arm.errors import FileInputError, InputError
from arm.io.foreign import archive
from arm.io.kind import kind_of_file, words_of
from arm.io.outputs import named_as_file
from arm.io.slips.names import missing
from arm.io.storage import open_file, read_bytes

Image = npt.NDArray[np.uint8]
"""An image: 8-bit grey (h, w) or BGR (h, w, 3)."""

_STANDARD_ERROR = threading.Lock()  # held while it is taken from the libraries that decode images
IMAGE_SUFFIXES = (".png", ".bmp", ".tif", ".tiff", ".jpg", ".jpeg", ".pgm")


def as_grey(image: Image) -> Image:
    """An image as grey (h, w), with OpenCV's weights of colours."""
    import cv2

    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)


def read_grey(file: Path) -> Image:
    """Read an image as 8-bit grey in the orientation of the sensor; an orientation tag in the file is ignored.

    Raises:
        InputError: it cannot be read.
    """
    import cv2

    data = np.frombuffer(read_bytes(file, "photograph"), dtype=np.uint8)
    flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
    said: list[str] = []
    try:
        with _of_libraries(said):
            image = cv2.imdecode(data, flags) if len(data) else None
    except cv2.error:  # more pixels than OpenCV supports
        image = None
    if image is None or any("premature end" in line.lower() for line in said):
        why = f": the file is damaged ({said[0]})" if said else ""
        raise InputError(f"{file}: cannot be read as an image{why}", path=str(file))
    return np.asarray(image, dtype=np.uint8)


@contextmanager
def _of_libraries(said: list[str]) -> Iterator[None]:
    """Take what libpng and libjpeg write to standard error; what others write there meanwhile is written after."""
    with _STANDARD_ERROR, tempfile.TemporaryFile() as taken:
        kept = os.dup(2)
        try:
            os.dup2(taken.fileno(), 2)
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            taken.seek(0)
            lines = taken.read().decode(errors="replace").splitlines()
            said += [line for line in lines if "libpng" in line or "JPEG" in line]
            for line in lines:
                if line not in said:
                    os.write(2, f"{line}\n".encode())


class FrameSource(Protocol):
    """Anything that takes current images of the cell."""

    def grab(self, count: int) -> list[Image]:
        """Take `count` images, exposed after the call.

        Args:
            count: number of images.

        Returns:
            arrays of dtype uint8, grey (h, w) or BGR (h, w, 3), all of the size of the lens calibration: (h, w) is
            (`Camera.size[1]`, `Camera.size[0]`).

        Raises:
            CameraError: the camera is absent, late, stale or wrongly set; `data["reason"]` is one of docs/cameras.md.
            InputError: the images are not available for another reason, such as files that differ in size.
        """
        ...


def require_folder(path: Path) -> None:
    """Require a folder, for its images.

    Raises:
        InputError: there is none of this name, or it is a file.
    """
    if not path.is_dir():
        rule = f"no such folder of images ({help})" if (help := missing(path)) else "no such folder of images"
        if path.is_file():
            where = "a folder of images" if kind_of_file(path) else "the folder that it is in"
            packed = archive(_beginning(path))
            rule = (
                f"{packed}; unpack it, and give the folder"
                if packed
                else f"is {words_of(path)}; give {where}"
            )
        raise InputError(f"{path}: {rule}", path=str(path))


def require_folder_name(path: Path) -> None:
    """Refuse the name of a folder for images that is the name of an image, or of another file.

    Raises:
        InputError: it is, and there is no folder of this name.
    """
    if path.suffix.lower() in IMAGE_SUFFIXES and not path.is_dir():
        raise InputError(
            f"-o {path}: is the name of an image; give that of a folder for images", path=str(path)
        )
    if named_as_file(path):
        why = f"-o {path}: is the name of a file ({path.suffix}); give that of a folder for images"
        raise InputError(why, path=str(path))


def _beginning(path: Path) -> bytes:
    """Return the first bytes of a file, enough to see what it is; none if it cannot be read."""
    with suppress(FileInputError, OSError), open_file(path, "log") as stream:
        return stream.read(512)
    return b""


def _folders_of_images(path: Path) -> list[Path]:
    """Return the folders in a folder that have images, by name; those that may not be read are left out."""
    return sorted(
        folder
        for folder in path.iterdir()
        if folder.is_dir()
        and os.access(folder, os.R_OK | os.X_OK)
        and any(p.suffix.lower() in IMAGE_SUFFIXES for p in folder.iterdir())
    )


class ImageFolder:
    """Images in a folder, in the order of their names.

    Each is returned once, because an old image does not show the current cell. New images need later names.
    """

    def __init__(self, path: Path, only_new: bool = False) -> None:
        """
        Args:
            path: the folder.
            only_new: whether to ignore the images that are in it now.

        Raises:
            InputError: it does not exist.
        """
        require_folder(path)
        self.path = path
        self._used: set[str] = {p.name for p in path.iterdir()} if only_new else set()

    def grab(self, count: int) -> list[Image]:
        """Return the next `count` new images.

        Raises:
            InputError: too few are left, one cannot be read, or they differ in size.
        """
        files = sorted(p for p in self.path.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES)
        fresh = [p for p in files if p.name not in self._used][:count]
        if len(fresh) < count:
            used = f" ({len(self._used)} were used before)" if self._used else ""
            why = (
                f"{self.path}: has {len(fresh)} new images{used}, but {count} are needed; "
                f"file names end in {' '.join(IMAGE_SUFFIXES)}"
            )
            others = sorted(
                {p.suffix for p in self.path.iterdir() if p.is_file() and p.suffix} if not files else ()
            )
            if others:
                why += f"; it has files {' '.join(others)}: save them as one of these, such as PNG"
            if not files and (folders := _folders_of_images(self.path)):
                last = folders[-1]
                more = f", one of {len(folders)} such folders in it" if len(folders) > 1 else ""
                why += f"; are the images those of {last}{more}? give that folder"
            raise InputError(why, path=str(self.path), found=len(fresh), count=count)
        images: list[Image] = []
        for file in fresh:
            images.append(read_grey(file))
            if images[-1].shape != images[0].shape:
                raise InputError(
                    f"{file}: is {images[-1].shape[1]} x {images[-1].shape[0]} px, but {fresh[0].name} is "
                    f"{images[0].shape[1]} x {images[0].shape[0]} px; the images of one look must have the same size",
                    path=str(file),
                )
        self._used.update(p.name for p in fresh)
        return images
