"""Flat calibration targets: ChArUco boards and checkerboards, their files, and their corners in an image.

The target frame is OpenCV's: origin at the top left corner of the print, x along the columns, y down the rows, z into
the board. Corners are the inner ones of the chessboard, row by row. They are saddle points, where OpenCV's refinement
is unbiased (docs/sources.md, "Corners in images": 0.026 px rms; for outer corners see `vision.markers.edge_lines`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import cv2
import numpy as np

from arm.io.keys import Keys, key
from arm.io.node import Node, Rule
from arm.io.rules import flag, integers, number, text
from arm.se3 import Array, Indices, frozen
from vision.camera.frame_source import Image, as_grey
from vision.markers.dictionaries import dictionary_names, predefined
from vision.targets.marker_print import MarkerPrint, family

_SADDLE_STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 50, 0.001)
FEWEST_CORNERS = 6
"""Fewer do not give a pose fit for calibration."""
SMALL_SQUARE = 0.006  # m; squares below are rather in cm
SHARES = 0.4, 0.9  # of a marker's edge in its square's, between which bits are large and the border is white
KIND = text("charuco", "checkerboard")


@dataclass(frozen=True)
class Target:
    """A calibration target.

    Attributes:
        kind: a chessboard, with or without markers in its white squares.
        columns, rows: squares along x and y.
        square: edge of a square, m.
        marker: edge of a marker's black square, m; 0 without markers.
        dictionary: of the markers, OpenCV's name; "" without.
        legacy: made for OpenCV before 4.6, whose ChArUco boards with an even number of rows have a white square, with
            a marker, at the top left.
    """

    kind: Literal["charuco", "checkerboard"] = "charuco"
    columns: int = 7
    rows: int = 5
    square: float = 0.030
    marker: float = 0.022
    dictionary: str = "DICT_5X5_100"
    legacy: bool = False

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the chessboard, m."""
        return self.columns * self.square, self.rows * self.square

    @property
    def corners(self) -> int:
        """Number of inner corners."""
        return (self.columns - 1) * (self.rows - 1)

    def points(self) -> Array:
        """Inner corners (n, 3) m in the target frame, row by row, z = 0."""
        x, y = np.meshgrid(np.arange(1, self.columns), np.arange(1, self.rows))
        flat = np.stack([x.ravel(), y.ravel(), np.zeros(self.corners)], axis=-1)
        return frozen(self.square * flat)

    @property
    def white_first(self) -> bool:
        """Whether the square at the top left is white."""
        return self.legacy and self.rows % 2 == 0

    def marker_squares(self) -> list[tuple[int, int]]:
        """Column and row of the white square of each marker, in the order of their ids."""
        return [
            (i, j) for j in range(self.rows) for i in range(self.columns) if (i + j + self.white_first) % 2
        ]

    def doubt(self) -> str:
        """Say what of the sizes may be in another unit, or too much for a detector; "" if nothing."""
        if self.square < SMALL_SQUARE:
            return (
                f"squares of {1e3 * self.square:g} mm: is the target in cm? All distances and limits are those of this "
                "size"
            )
        if self.kind == "charuco" and not SHARES[0] <= (share := self.marker / self.square) <= SHARES[1]:
            return (
                f"markers of {1e3 * self.marker:g} mm in squares of {1e3 * self.square:g} mm: from {SHARES[0]:g} to "
                f"{SHARES[1]:g} of a square they are found well, and these have {share:.2g}"
            )
        return ""

    def label(self) -> str:
        """A short description."""
        squares = f"{self.columns} x {self.rows} squares of {1e3 * self.square:g} mm"
        if self.kind == "checkerboard":
            return f"checkerboard, {squares}"
        layout = ", legacy layout" if self.legacy else ""
        return f"ChArUco, {squares}, markers {1e3 * self.marker:g} mm {self.dictionary}{layout}"


@dataclass(frozen=True, eq=False)
class TargetView:
    """A target in one image.

    Attributes:
        ids: (n,) of the detected corners, increasing.
        corners_px: (n, 2).
        outlines_px: (m, 4, 2) rough outlines of the markers, empty for a checkerboard.
        marker_ids: (m,).
    """

    ids: Indices
    corners_px: Array
    outlines_px: Array
    marker_ids: Indices


class CheckerboardKeys(Keys):
    """Keys of a target without markers."""

    kind: str = key("kind", KIND, "charuco")
    squares: tuple[int, ...] = key("squares", integers(2, 3, 100))
    square: float = key("square_mm", number("mm", 0.1, 1000))


class CharucoKeys(CheckerboardKeys):
    """Keys of a target with markers."""

    marker: float = key("marker_mm", number("mm", 0.1, 1000))
    dictionary: str = key("dictionary", Rule("one of OpenCV's dictionaries", text(*dictionary_names()).read))
    legacy: bool = key("legacy", flag(), False)


def read_target(path: Path) -> Target:
    """Read a target file: kind, squares = [columns, rows], square_mm, and of a ChArUco board marker_mm and dictionary.

    Raises:
        FileInputError: a value breaks its rule, or it is the file of a target in the gripper.
    """
    root = Node.of_toml(path, "target")
    if "hand" in root:
        what = (
            "is a target in the gripper, by its [hand], and a target that is held in no gripper belongs here"
        )
        raise root.error(
            what, "a465 calibrate hand-eye takes it; for the same print give a file without [hand]"
        )
    is_charuco = root.get("kind", KIND, "charuco") == "charuco"
    for name in () if is_charuco else ("marker_mm", "dictionary", "legacy"):
        if name in root:
            help = f'for one with markers write kind = "charuco", else leave {name} out'
            raise root.error_at(name, 'is of a target with markers, and kind is "checkerboard"', help)
    return target_of((CharucoKeys if is_charuco else CheckerboardKeys).read(root), root)


def target_of(keys: CheckerboardKeys, root: Node) -> Target:
    """Return the target of a file's keys; `root` is the file, for messages.

    Raises:
        FileInputError: a value breaks its rule.
    """
    columns, rows = keys.squares
    if not isinstance(keys, CharucoKeys):
        if (columns + rows) % 2 == 0:
            raise root.error_at(
                "squares",
                "must be one even and one odd number: any other checkerboard looks the same rotated by 180 deg",
            )
        return Target("checkerboard", columns, rows, keys.square, 0.0, "")
    if keys.marker >= keys.square:
        raise root.error_at("marker_mm", f"must be less than square_mm = {1e3 * keys.square:g}")
    target = Target("charuco", columns, rows, keys.square, keys.marker, keys.dictionary, keys.legacy)
    known = len(predefined(keys.dictionary).bytesList)
    if len(target.marker_squares()) > known:
        rule = f"need {len(target.marker_squares())} markers; {keys.dictionary} has {known}"
        raise root.error_at("squares", rule)
    return target


class TargetFinder:
    """Finds one target in images; keeps OpenCV's detector between images."""

    def __init__(self, target: Target) -> None:
        self.target = target
        self._charuco: cv2.aruco.CharucoDetector | None = None
        if target.kind == "charuco":
            board = cv2.aruco.CharucoBoard(
                (target.columns, target.rows), target.square, target.marker, predefined(target.dictionary)
            )
            board.setLegacyPattern(target.legacy)
            self._charuco = cv2.aruco.CharucoDetector(board)

    def find(self, image: Image) -> TargetView | None:
        """Find the target; None if fewer than `FEWEST_CORNERS` of its corners are detected.

        Args:
            image: 8-bit grey (h, w) or BGR (h, w, 3).
        """
        grey = as_grey(image)
        return self._find_checkerboard(grey) if self._charuco is None else _find_charuco(self._charuco, grey)

    def _find_checkerboard(self, grey: Image) -> TargetView | None:
        inner = (self.target.columns - 1, self.target.rows - 1)
        found, corners = cv2.findChessboardCornersSB(grey, inner, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
        if not found:
            return None
        corners = np.asarray(corners, dtype=np.float32).reshape(-1, 2)
        across = np.linalg.norm(np.diff(corners.reshape(inner[1], inner[0], 2), axis=1), axis=-1).min()
        half = int(np.clip(across / 4.0, 2, 7))
        refined = corners.reshape(-1, 1, 2).copy()
        cv2.cornerSubPix(grey, refined, (half, half), (-1, -1), _SADDLE_STOP)
        return TargetView(
            np.arange(self.target.corners),
            frozen(_first_square_dark(grey, refined.reshape(-1, 2).astype(float), inner)),
            frozen(np.empty((0, 4, 2))),
            np.empty(0, dtype=np.intp),
        )

    def seen_instead(self, image: Image, loose: bool = True) -> str:
        """Describe what an image shows instead, with a remedy: its mirror image, another print; "" if neither.

        Args:
            image: without the target.
            loose: whether markers that are on no ChArUco board count as another print.
        """
        is_charuco = self.target.kind == "charuco"
        if is_charuco and self.find(np.ascontiguousarray(image[:, ::-1])) is not None:
            return "its mirror image: print it again, or take the image without a mirror"
        shown = MarkerPrint.in_image(image)
        if shown is None or not (shown.layout or (is_charuco and loose)):
            return "" if is_charuco else self._other_checkerboard(as_grey(image))
        return f"{shown.words()}: {self._remedy(shown)}"

    def _other_checkerboard(self, grey: Image) -> str:
        """Describe a checkerboard with other squares than the target's; "" if there is none."""
        columns, rows = self.target.columns, self.target.rows
        flags = cv2.CALIB_CB_NORMALIZE_IMAGE
        if cv2.findChessboardCornersSB(grey, (columns, rows), flags=flags)[0]:
            fits = f"squares = [{columns + 1}, {rows + 1}]"
            return f"one of {columns} x {rows} inner corners: the file of --target needs {fits}, which counts squares"
        found, _, inner = cv2.findChessboardCornersSBWithMeta(grey, (3, 3), flags | cv2.CALIB_CB_LARGER)
        if not found:
            return ""
        across, down = sorted(inner.shape, reverse=True)
        return f"a checkerboard of about {across + 1} x {down + 1} squares: count them, and correct squares"

    def read_in_part(self, image: Image) -> str:
        """Describe the larger print that has the target as its upper rows, with a remedy; "" if there is none.

        Such a print has the target's markers where the target has them, and its other corners would be left out.
        """
        target = self.target
        shown = MarkerPrint.in_image(image, target.dictionary) if target.kind == "charuco" else None
        if shown is None or (layout := shown.layout) is None or layout.rows <= target.rows:
            return ""
        same = (layout.columns, layout.white_first) == (target.columns, target.white_first)
        return f"{shown.words()}: {self._remedy(shown)}" if same else ""

    def _remedy(self, shown: MarkerPrint) -> str:
        """What to change in the target file to read a print."""
        layout, target = shown.layout, self.target
        if layout is None:
            return "give images of the target, or the target file of this print with --target"
        is_charuco = target.kind == "charuco"
        has_all = is_charuco and len(predefined(target.dictionary).bytesList) > shown.ids.max()
        # the image may show some rows only, but a legacy board has an even number
        fits = layout.columns == target.columns and layout.rows <= target.rows
        fits &= not (layout.white_first and target.rows % 2)
        needed = {
            'kind = "charuco"': not is_charuco,
            f"squares = [{layout.columns}, {layout.rows}]": not fits,
            f'dictionary = "{shown.dictionary}"': not has_all
            or family(shown.dictionary) != family(target.dictionary),
            f"legacy = {str(layout.white_first).lower()}": layout.white_first != target.white_first,
        }
        keys = [text for text, differs in needed.items() if differs]
        if not keys:
            return "the target, too small or too blurred for its corners; take it nearer, and in focus"
        return f"the file of --target needs {', '.join(keys)}"


def _find_charuco(detector: cv2.aruco.CharucoDetector, grey: Image) -> TargetView | None:
    corners, ids, outlines, marker_ids = detector.detectBoard(grey)
    if ids is None or len(ids) < FEWEST_CORNERS:
        return None
    order = np.argsort(ids.reshape(-1))
    found = len(marker_ids) if marker_ids is not None else 0
    return TargetView(
        np.asarray(ids.reshape(-1)[order], dtype=np.intp),
        frozen(corners.reshape(-1, 2)[order]),
        frozen(np.stack([o.reshape(4, 2) for o in outlines]) if found else np.empty((0, 4, 2))),
        np.asarray(marker_ids, dtype=np.intp).reshape(-1) if found else np.empty(0, dtype=np.intp),
    )


def _first_square_dark(grey: Image, corners: Array, inner: tuple[int, int]) -> Array:
    """Return the corners in the order that starts at the dark outer square: unchanged, or reversed."""
    grid = corners.reshape(inner[1], inner[0], 2)
    outside = [2.0 * grid[i, i] - grid[j, j] for i, j in ((0, 1), (-1, -2))]
    middles = [(grid[i, i] + o) / 2.0 for (i, o) in zip((0, -1), outside, strict=True)]
    height, width = grey.shape
    levels = [float(grey[int(np.clip(y, 0, height - 1)), int(np.clip(x, 0, width - 1))]) for x, y in middles]
    return corners if levels[0] <= levels[1] else corners[::-1].copy()
