"""Markers in an image: dictionaries, detection, edges, exposure."""

from arm.former import former_names

former_names(__name__, "vision.markers.detect", "Marker", "detect_markers")
