"""What print of markers an image shows: its dictionary, and the ChArUco layout of its squares if that explains them.

The centres of a flat board's markers are a homography of the centres of their squares. A board numbers its markers row
by row, so the number of columns and the colour of the first square say in which square each id is. The layout is the
only one of all numbers of columns that most markers fit.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import cv2
import numpy as np

from arm.se3 import Array, Indices
from vision.camera.frame_source import Image
from vision.markers.dictionaries import dictionary_names, predefined

FEWEST_MARKERS = 3  # large dictionaries give false detections in any clutter
FEWEST_FITTING = 6  # markers, and
FITTING = 0.8  # share of the markers, that establish a layout
OFF = 0.25  # largest distance of a marker from its place, in its edges
MOST_COLUMNS = 40
_FAMILY = re.compile(r"DICT_\dX\d_")


@dataclass(frozen=True)
class Layout:
    """Squares of a ChArUco board.

    Attributes:
        columns: along x.
        rows: along y, as many as have markers in view.
        white_first: whether the square at the top left is white, as in OpenCV's legacy layout.
    """

    columns: int
    rows: int
    white_first: bool


@dataclass(frozen=True)
class MarkerPrint:
    """Markers of one dictionary in an image.

    Attributes:
        dictionary: OpenCV's name, of the smallest one that has them all.
        ids: (n,).
        layout: None if they are on no ChArUco board, or too few to tell.
    """

    dictionary: str
    ids: Indices
    layout: Layout | None

    @classmethod
    def in_image(cls, image: Image, like: str = "") -> MarkerPrint | None:
        """Find the dictionary with most markers in an image, among all or those of the family of `like`."""
        best: tuple[str, Indices, Array] | None = None
        # a larger dictionary of a family begins with the markers of the smaller ones: prefer the smallest
        for name in sorted(dictionary_names(), key=lambda d: len(predefined(d).bytesList)):
            if like and family(name) != family(like):
                continue
            outlines, ids, _ = cv2.aruco.ArucoDetector(predefined(name)).detectMarkers(image)
            if ids is not None and len(ids) > (FEWEST_MARKERS - 1 if best is None else len(best[1])):
                best = (
                    name,
                    np.asarray(ids, np.intp).reshape(-1),
                    np.reshape(outlines, (-1, 4, 2)).astype(float),
                )
        return None if best is None else cls(best[0], best[1], find_layout(best[1], best[2]))

    def words(self) -> str:
        """Describe it."""
        text = f"{len(self.ids)} markers of {self.dictionary} (ids {self.ids.min()} to {self.ids.max()})"
        if self.layout is None:
            return text
        legacy = " in the legacy layout" if self.layout.white_first else ""
        return f"{text} on a board of {self.layout.columns} x {self.layout.rows} squares{legacy}"


def family(dictionary: str) -> str:
    """Name of the dictionaries with the same first markers, such as ``DICT_4X4_``; its own name if there are none."""
    match = _FAMILY.match(dictionary)
    return match[0] if match else dictionary


def find_layout(ids: Indices, outlines: Array) -> Layout | None:
    """Find the board of markers (n,) with outlines (n, 4, 2) px; None if no layout, or more than one, explains them."""
    if len(ids) < FEWEST_FITTING:
        return None
    centres = outlines.mean(axis=1)
    edge = float(np.median(np.linalg.norm(outlines - np.roll(outlines, 1, axis=1), axis=-1)))
    found: list[tuple[int, Layout]] = []
    for columns in range(3, MOST_COLUMNS + 1):
        for white_first in (False, True):
            squares = squares_of(ids, columns, white_first)
            fitting = _fitting(squares, centres, OFF * edge)
            if fitting.sum() < max(FEWEST_FITTING, FITTING * len(ids)):
                continue
            rows = int(squares[fitting, 1].max()) + 1
            rows += white_first and rows % 2  # a legacy board has an even number
            found.append((int(fitting.sum()), Layout(columns, max(rows, 3), white_first)))
    found.sort(key=lambda f: -f[0])
    clear = len(found) == 1 or (len(found) > 1 and found[1][0] < found[0][0])
    return found[0][1] if clear else None


def squares_of(ids: Indices, columns: int, white_first: bool) -> Indices:
    """Column and row (n, 2) of the squares in which a board has its markers `ids` (n,)."""
    upper = (columns + white_first) // 2  # markers in the first row; both rows of a pair have one a column
    pair, place = ids // columns, ids % columns
    lower = place >= upper
    column = 2 * np.where(lower, place - upper, place) + (lower == white_first)
    return np.stack([column, 2 * pair + lower], axis=-1).astype(np.intp)


def _fitting(squares: Indices, centres: Array, tolerance: float) -> Array:
    """Mask (n,) of the centres (n, 2) px that one homography maps from their squares to within `tolerance`, px."""
    if len(np.unique(squares[:, 1])) < 2 or len(np.unique(squares[:, 0])) < 2:
        return np.zeros(len(squares), dtype=bool)
    H, mask = cv2.findHomography(
        squares.astype(np.float32), centres.astype(np.float32), cv2.RANSAC, tolerance, maxIters=300
    )
    return np.zeros(len(squares), dtype=bool) if H is None else np.asarray(mask, dtype=bool).reshape(-1)
