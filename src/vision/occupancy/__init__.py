"""The occupancy of a hole: empty, a cube, or a cube that is not seated."""

from typing import TYPE_CHECKING

from arm.former import FormerNames

if not TYPE_CHECKING:
    __getattr__ = FormerNames(__name__, "vision.occupancy.classify", "Weight", "Occupancy", "hole_occupancy")
