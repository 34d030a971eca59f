"""Markers in an image: dictionaries, detection, edges, exposure."""

from importlib import import_module
from typing import TYPE_CHECKING

_FORMER = (
    "SEARCH_WIDTH_PX",
    "Marker",
    "detect_markers",
)  # of the module that this package was, for one version

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        if name in _FORMER:
            return getattr(import_module("vision.markers.detect"), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
