"""What stands in a hole: nothing, a cube, or a cube that does not sit."""

from importlib import import_module
from typing import TYPE_CHECKING

_FORMER = (
    "LEAST_CONTRAST",
    "REACH",
    "TOLERANCE",
    "MOST_TOLERANCE",
    "MOST_STD",
    "BLUR",
    "LEAST_STATIONS",
    "LEAST_MARKER",
    "SURE",
    "EVEN",
    "EVEN_SIDE",
    "FLOOR_RADII",
    "MOUTH_BANDS",
    "MOST_FAINT",
    "RIM_STEP",
    "ABSENT",
    "Weight",
    "WEIGHTS",
    "LIGHT",
    "NO_MARKER",
    "OUT",
    "POSE",
    "FAINT",
    "OTHER",
    "Occupancy",
    "hole_occupancy",
)  # of the module that this package was, for one version

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        if name in _FORMER:
            return getattr(import_module("vision.occupancy.classify"), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
