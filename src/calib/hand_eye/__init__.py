"""Hand-eye calibration: camera, joint zeros and links of an arm, and the poses to take for it."""

from importlib import import_module
from typing import TYPE_CHECKING

_FORMER = (
    "LINKS",
    "ZERO",
    "LENGTH",
    "ANGLE",
    "GAUGES",
    "HAND_EYE_LIMITS",
    "HandEye",
    "hand_eye_problem",
    "calibrate_hand_eye",
)  # of the module that this package was, for one version

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        if name in _FORMER:
            return getattr(import_module("calib.hand_eye.calibrate"), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
