"""Cameras of pylon's own emulation, and devices that misbehave: real ones, with one call put wrong."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from arm.errors import CameraError
from vision.camera.basler import BaslerCamera, BaslerSettings
from vision.camera.frame_source import Image

SERIAL = "serial:0815-0000"


def photographs(
    folder: Path, count: int = 3, size: tuple[int, int] = (320, 200), seed: int = 0
) -> list[Image]:
    """Files of noise for an emulated camera, and what is in them."""
    folder.mkdir(exist_ok=True)
    rng = np.random.default_rng(seed)
    images = [rng.integers(0, 256, size[::-1], dtype=np.uint8) for _ in range(count)]
    for number, image in enumerate(images):
        cv2.imwrite(str(folder / f"{number:02d}.png"), image)
    return images


def showing(folder: Path, size: tuple[int, int] = (320, 200)) -> dict[str, bool | int | float | str]:
    """Features that make an emulated camera send the files of a folder, in the order of their names."""
    return {
        "TestImageSelector": "Off",
        "ImageFilename": str(folder),
        "ImageFileMode": "On",
        "Width": size[0],
        "Height": size[1],
    }


class Wrong:
    """A device, frame or node map of which some attributes are others; the rest is the real one's."""

    def __init__(self, real: Any, **others: Any) -> None:
        self.real = real
        self._others = others

    def __getattr__(self, name: str) -> Any:
        return self._others[name] if name in self._others else getattr(self.real, name)


def misnumbered(device: Any, number: Callable[[int], int]) -> Wrong:
    """A device whose frames have other numbers."""

    def retrieve(*arguments: Any) -> Wrong:
        result = device.RetrieveResult(*arguments)
        return Wrong(result, BlockID=number(result.BlockID))

    return Wrong(device, RetrieveResult=retrieve)


def nameless(nodes: Any, *hidden: str) -> Wrong:
    """A node map without some features, as on cameras of another generation."""
    return Wrong(nodes, GetNode=lambda name: nodes.GetNode("NoSuchFeature" if name in hidden else name))


def settings(folder: Path, timeout: float = 2.0) -> BaslerSettings:
    return BaslerSettings(timeout=timeout, features=showing(folder / "shots"))


def refused(camera: BaslerCamera, reason: str, count: int = 1) -> str:
    with pytest.raises(CameraError) as caught:
        camera.grab(count)
    assert caught.value.data["reason"] == reason
    assert str(caught.value).startswith(f"camera {camera.selector}: ")
    return str(caught.value)
