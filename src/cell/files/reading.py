"""How the numbers of a list of poses are read that the list has without a key."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.errors import InputError
from arm.io.node import Node
from arm.se3 import Array, frozen

FRAMES = ("flange", "tool")
ANGLES = {"rad": 1.0, "deg": float(np.radians(1.0))}
LENGTHS = {"m": 1.0, "mm": 1e-3}


@dataclass(frozen=True)
class Reading:
    """Interpretation of numbers without a key; None: not stated.

    Attributes:
        frame: frame of poses, of `FRAMES`.
        angles: unit of joint angles, of `ANGLES`.
        lengths: unit of positions in poses, of `LENGTHS`.
        joints: number of the arm's joints; two that are as many as the numbers of a pose cannot be told from it.
        slides: whether one of them slides; then configurations are in rad and m.
        options: which of the first three a person gave; a file that states another value is refused.
    """

    frame: str | None = None
    angles: str | None = None
    lengths: str = "m"
    joints: int = 6
    slides: bool = False
    options: tuple[str, ...] = ()

    def q(self, node: Node, values: Array, angles: str) -> Array:
        """Return a configuration, rad (m), of numbers in a unit of `ANGLES`.

        Raises:
            FileInputError: not one number for each joint, or degrees where a joint slides.
        """
        if len(values) != self.joints:
            raise node.error(f"must be {self.joints} numbers, not {len(values)}")
        if self.slides and angles != "rad":
            raise node.error("must be in rad, and in m where a joint slides")
        return frozen(values * ANGLES[angles])


def reading_of(frame: str | None, angles: str | None, lengths: str | None) -> Reading:
    """Return the interpretation from the options of a command.

    Raises:
        InputError: an option has an unknown value.
    """
    known = {"frame": FRAMES, "angles": ANGLES, "lengths": LENGTHS}
    given = {
        option: value
        for option, value in zip(known, (frame, angles, lengths), strict=True)
        if value is not None
    }
    for option, value in given.items():
        if value not in known[option]:
            raise InputError(f"--{option} {value}: must be one of {', '.join(known[option])}", value=value)
    return Reading(frame, angles, lengths or "m", options=tuple(given))
