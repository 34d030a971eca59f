"""Places of a cube's sides."""

from __future__ import annotations

import numpy as np
import pytest

from vision.occupancy.cube_fit import FAINT, PLACES, likely


def _peak(place: float, height: float = 0.0) -> np.ndarray:
    return height - 0.5 * ((PLACES - place) / 2e-5) ** 2


def test_a_foot_that_is_taken_for_a_side_is_not_the_best_place() -> None:
    """The face of a bright cube passes for its top."""
    foot = 1.4e-3
    log = np.maximum(_peak(0.1e-3), _peak(-foot, 40.0))
    told, top = likely(log, foot)
    assert PLACES[top] == pytest.approx(0.1e-3)
    assert told[top] == 0.0
    assert told.max() == 0.0
    assert told.min() == -FAINT
    for other in (0.0, 0.7e-3, 2.0e-3):  # no face, one too narrow to be mistaken, one whose foot is elsewhere
        assert PLACES[likely(log, other)[1]] == pytest.approx(-foot)
