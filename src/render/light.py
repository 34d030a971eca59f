"""Light and the grey levels of things.

One lamp and light from all around (ambient). A surface of grey level g (what it shows when it faces the lamp) shows
g (ambient + (1 - ambient) max(0, n . l)) with its normal n and the direction l of the lamp (Lambert's cosine law).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from arm.robot.shapes import Body
from arm.se3 import Array

# Grey levels facing the lamp. Kinds that are not listed are OTHER.
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
    """How the cell is lit.

    Attributes:
        lamp: place of the lamp in the base frame, m; above everything that the camera sees.
        ambient: share of the light that comes from all around, 0 to 1.
        gain: exposure, a factor on all grey levels (the image saturates at 255).
        shadow: share of the light that the lamp's shadow takes away, 0 (none) to 1 - ambient.
        vignette: share of the light lost in the image's corners.
        penumbra: standard deviation of a shadow's edge, m; it stands for the size of the lamp.
    """

    lamp: tuple[float, float, float] = (1.1, -0.7, 2.6)
    ambient: float = 0.45
    gain: float = 1.0
    shadow: float = 0.3
    vignette: float = 0.08
    penumbra: float = 7e-3

    def towards(self, point: npt.ArrayLike) -> Array:
        """Unit vector to the lamp from a point (3,) m; taken at a body's centre it serves for the whole body."""
        direction = np.asarray(self.lamp) - np.asarray(point, dtype=float)
        unit: Array = direction / np.linalg.norm(direction)
        return unit

    def lambert(self, cosine: npt.ArrayLike) -> Array:
        """Factor on the grey level of surfaces whose normals have that cosine to the lamp, any shape."""
        lit: Array = self.gain * (self.ambient + (1.0 - self.ambient) * np.maximum(cosine, 0.0))
        return lit


def body_grey(body: Body) -> float:
    """Grey level of a body that faces the lamp: by its name for the arm's dark parts, else by its kind."""
    return NAME_GREY.get(body.name, KIND_GREY.get(body.kind, OTHER_GREY))
