"""Cameras: model, distortion, and sources of frames."""

from typing import TYPE_CHECKING

from arm.former import FormerNames

if not TYPE_CHECKING:
    __getattr__ = FormerNames(__name__, "vision.camera.model", "Camera", "read_camera", "write_camera")
