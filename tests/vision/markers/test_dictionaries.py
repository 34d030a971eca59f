"""Dictionaries of markers."""

from __future__ import annotations

import numpy as np
import pytest

from cell.config.board_keys import DICTIONARIES
from pictures.markers import one_marker
from vision.markers.detect import detect_markers


@pytest.mark.few(6)
@pytest.mark.parametrize("dictionary", DICTIONARIES)
def test_every_dictionary(dictionary: str) -> None:
    """Right id, and corners in the order in which the marker is printed."""
    image, camera, truth = one_marker(2, 7.0, dictionary=dictionary)
    (marker,) = detect_markers(image, camera, dictionary)
    assert (marker.id, marker.method) == (1, "lines")
    assert np.abs(marker.corners_px - truth).max() < 0.06
