"""Words on pictures can be read where a report shows the picture smaller."""

from __future__ import annotations

import numpy as np
import pytest

from vision.drawing import Pen

COLOUR = (200, 0, 200)


def rows_drawn(words: str, width: int) -> np.ndarray:
    picture = np.full((width // 2, width, 3), 90, np.uint8)
    Pen(picture).text(words, np.array([width / 2.0, width / 4.0]), COLOUR)
    return np.flatnonzero((picture == COLOUR).all(axis=-1).any(axis=1))


@pytest.mark.parametrize("width", [960, 1920])
def test_letters_are_ten_px_high_where_the_picture_is_shown_640_px_wide(width: int) -> None:
    rows = rows_drawn("H", width)
    assert (rows[-1] - rows[0] + 1) * 640.0 / width > 9.5


def test_lines_stand_below_each_other_about_the_place() -> None:
    one, two = rows_drawn("H", 960), rows_drawn("H\nH", 960)
    assert len(two) == 2 * len(one)
    assert np.diff(two).max() > 3
    assert two.mean() == pytest.approx(one.mean(), abs=1.5)


def test_what_is_not_in_the_picture_is_left_out() -> None:
    assert not len(rows_drawn("", 480))
    picture = np.zeros((40, 40, 3), np.uint8)
    Pen(picture).text("H", np.array([np.nan, 3.0]), COLOUR)
    assert not picture.any()
