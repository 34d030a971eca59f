"""Cameras: the model with its distortion, and where frames come from."""

from importlib import import_module
from typing import TYPE_CHECKING

_FORMER = (
    "Camera",
    "read_camera",
    "read_lens",
    "write_camera",
)  # of the module that this package was, for one version

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        if name in _FORMER:
            return getattr(import_module("vision.camera.model"), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
