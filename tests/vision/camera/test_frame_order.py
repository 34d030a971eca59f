"""Frames that follow each other."""

from __future__ import annotations

import pytest

from vision.camera.frame_order import LAST_SHORT, NO_NUMBER, FrameOrder

pytestmark = pytest.mark.xdist_group("basler_parts")


@pytest.mark.parametrize(
    ("last", "frame", "first", "fits"),
    [
        (FrameOrder(), FrameOrder(0), True, True),
        (FrameOrder(), FrameOrder(17), True, True),  # nothing is known yet
        (FrameOrder(), FrameOrder(17), False, False),
        (FrameOrder(), FrameOrder(NO_NUMBER), True, False),
        (FrameOrder(), FrameOrder(None), True, False),
        (FrameOrder(4), FrameOrder(5), False, True),
        (FrameOrder(4), FrameOrder(4), False, False),
        (FrameOrder(4), FrameOrder(6), False, False),
        (FrameOrder(4), FrameOrder(3), False, False),
        (FrameOrder(4), FrameOrder(1), False, False),
        (FrameOrder(4), FrameOrder(1), True, True),  # numbers begin anew, or go on
        (FrameOrder(4), FrameOrder(5), True, True),
        (FrameOrder(4), FrameOrder(6), True, False),
        (FrameOrder(LAST_SHORT), FrameOrder(1), False, True),
        (FrameOrder(LAST_SHORT), FrameOrder(LAST_SHORT + 1), False, True),
        (FrameOrder(LAST_SHORT), FrameOrder(2), False, False),
        (FrameOrder(4, 100), FrameOrder(5, 101), False, True),
        (FrameOrder(4, 100), FrameOrder(5, 100), False, False),
        (FrameOrder(4, 100), FrameOrder(0, 99), True, False),
        (FrameOrder(4, 100), FrameOrder(5, 0), False, True),  # no stamps
    ],
)
def test_order_of_frames(last: FrameOrder, frame: FrameOrder, first: bool, fits: bool) -> None:
    assert last.is_next(frame, first) is fits
