"""The occupancy of a hole: empty, a cube, or a cube that is not seated."""

from arm.former import former_names

former_names(__name__, "vision.occupancy.classify", "Weight", "Occupancy", "hole_occupancy")
