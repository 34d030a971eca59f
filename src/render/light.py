"""Light and grey levels of surfaces.

There is one lamp, and ambient light. A surface of grey level g (when facing the lamp) with normal n appears as
g (ambient + (1 - ambient) max(0, n . l)), where l is the direction to the lamp (Lambert's cosine law).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from arm.robot.shapes import Body
from arm.se3 import Array

# grey levels of surfaces that face the lamp; kinds that are not listed have OTHER_GREY
KIND_GREY = {
    "table": 112.0,
    "wall": 88.0,
    "post": 88.0,
    "stand": 66.0,
    "board": 150.0,
    "cube": 205.0,
    "robot": 182.0,
}
NAME_GREY = {"gripper": 96.0, "palm": 78.0, "finger_l": 58.0, "finger_r": 58.0}  # dark metal on a light arm
OTHER_GREY = 128.0
BACKGROUND_GREY = 40.0  # the floor beside the table
MARKER_WHITE, MARKER_BLACK = 235.0, 22.0
FINGER_HOLE = 18.0


@dataclass(frozen=True)
class Light:
    """Light in the cell.

    Attributes:
        lamp: position of the lamp in the base frame, m; above everything in the camera's view.
        ambient: fraction of ambient light, 0 to 1.
        gain: exposure, a factor on all grey levels (the image saturates at 255).
        shadow: fraction of the light that the lamp's shadow removes, 0 (none) to 1 - ambient.
        vignette: fraction of the light lost in the image's corners.
        penumbra: standard deviation of a shadow's edge, m; represents the size of the lamp.
    """

    lamp: tuple[float, float, float] = (1.1, -0.7, 2.6)
    ambient: float = 0.45
    gain: float = 1.0
    shadow: float = 0.3
    vignette: float = 0.08
    penumbra: float = 7e-3

    def towards(self, point: npt.ArrayLike) -> Array:
        """Return the unit vector from a point (3,) m to the lamp; a body's centre serves for the whole body."""
        direction = np.asarray(self.lamp) - np.asarray(point, dtype=float)
        return np.asarray(direction / np.linalg.norm(direction))

    def lambert(self, cosine: npt.ArrayLike) -> Array:
        """Return the factor on grey levels for cosines, any shape, of the angle between normal and lamp."""
        return np.asarray(self.gain * (self.ambient + (1.0 - self.ambient) * np.maximum(cosine, 0.0)))


def body_grey(body: Body) -> float:
    """Return the grey level of a body facing the lamp: by name for the arm's dark parts, else by kind."""
    return NAME_GREY.get(body.name, KIND_GREY.get(body.kind, OTHER_GREY))
