"""Markers in an image: dictionaries, detection, edges, exposure."""

from typing import TYPE_CHECKING

from arm.former import FormerNames

if not TYPE_CHECKING:
    __getattr__ = FormerNames(__name__, "vision.markers.detect", "Marker", "detect_markers")
