"""Cameras: model, distortion, and sources of frames."""

from arm.former import former_names

former_names(__name__, "vision.camera.model", "Camera", "read_camera", "write_camera")
