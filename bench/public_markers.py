"""Markers and two-marker boards in public pictures: python bench/public_markers.py FOLDER...

The folders hold unpacked packages, searched for the files of `SETS` (docs/sources.md, "Public pictures"); no picture
belongs to the project. The rules were set before any result was seen:

- a marker counts if OpenCV's detector finds it in the full picture with its default parameters; one whose shortest
  side is under 20 px counts in a row of its own, and so do the markers of rendered pictures;
- it is found if `detect_markers` has its id within half of its side;
- each two markers of a flat print whose centres are at least 2.5 markers apart (the wire board of `real_cell.py`: 2.65)
  are one board in a single photograph. Boards of one photograph share its errors: they are no independent cases.

The pose of the whole print, by all of its markers, is what a board's rotation is compared with.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from unittest.mock import patch

import cv2
import numpy as np
from real_cell import table, two_markers, versions
from scipy.optimize import minimize_scalar

from arm.se3 import Array, angle_between
from calib.camera.bundle_adjustment import View, residual_of
from calib.camera.initial_guess import pose_of
from vision.boards.pose import BoardAssessment, assess_board
from vision.camera.frame_source import read_grey
from vision.camera.model import Camera
from vision.markers import detect
from vision.markers.detect import Marker, detect_markers, shortest_side
from vision.markers.dictionaries import predefined
from vision.markers.edge_lines import LEAST_MODULE_PX
from vision.targets.target import Target

LEAST_PX = 20.0  # side of a marker: those below have a row of their own
APART = 2.5  # centres of a board's markers, in markers
SIZE = (640, 480)  # px, of OpenCV's pictures of prints
TUTORIAL = "tutorial_dict.yml"  # of OpenCV's older tutorial pictures: none of the predefined dictionaries
CHARUCO = Target("charuco", 5, 7, 0.040, 0.020, "DICT_6X6_250")


@dataclass(frozen=True)
class Print:
    """A flat print of markers.

    Attributes:
        lens: name of OpenCV's file for its photographs; if None, the focal length is fitted to the print.
        size: of a marker, m.
        centres: of the markers by id, x right and y up, m.
    """

    lens: str | None
    size: float
    centres: Mapping[int, tuple[float, float]]

    def scaled(self, by: float) -> Print:
        """The print if it were made that many times as large."""
        return Print(self.lens, by * self.size, {k: (by * x, by * y) for k, (x, y) in self.centres.items()})

    def corners(self, marker_id: int) -> Array:
        """Corners of a marker, (4, 3) m."""
        return np.asarray(two_markers("", (0, 1), self.size, self.centres[marker_id]).marker_corners()[1])


@dataclass(frozen=True, eq=False)
class PictureSet:
    """Pictures of one kind: a pattern of their names, their dictionary, and the print that they show."""

    name: str
    files: str
    dictionary: str
    shown: Print | None = None
    rendered: bool = False


_SQUARES = CHARUCO.marker_squares()
_CHARUCO = {k: (CHARUCO.square * x, -CHARUCO.square * y) for k, (x, y) in enumerate(_SQUARES)}
_PITCH = 0.0478  # m, of 40 mm markers: measured in the picture, because the tutorial's gaps are those of other prints
_GRID = {k: (_PITCH * (k % 5), -_PITCH * (k // 5)) for k in range(35)}
SETS = (
    PictureSet(
        "OpenCV, ChArUco 5 x 7",
        r"(img_0\d|chocclusion_original)\.jpg",
        CHARUCO.dictionary,
        Print("tutorial_camera_charuco.yml", CHARUCO.marker, _CHARUCO),
    ),
    PictureSet("OpenCV, grid 5 x 7", r"gboriginal\.\w+", TUTORIAL, Print(None, 0.040, _GRID)),
    PictureSet("OpenCV, diamonds", r"diamondmarkers\.\w+", TUTORIAL),
    PictureSet("OpenCV, single markers", r"singlemarkersoriginal\.\w+", "DICT_6X6_250"),
    PictureSet("AprilTag, cubes outdoors", r"\d{11}_\w+_c\.jpg", "DICT_APRILTAG_36h11"),
    PictureSet("ViSP, sheet", r"AprilTag\.pgm", "DICT_APRILTAG_36h11"),
    PictureSet("ViSP, 36h11", r"tag36_11_\w+\.png", "DICT_APRILTAG_36h11", rendered=True),
    PictureSet("ViSP, 25h9", r"tag25_09_\w+\.png", "DICT_APRILTAG_25h9", rendered=True),
    PictureSet("ViSP, 16h5", r"tag16_05_\w+\.png", "DICT_APRILTAG_16h5", rendered=True),
    PictureSet("april_vision", r"img-0\d\d\.png", "DICT_APRILTAG_36h11", rendered=True),
)


def read_dictionary(path: Path) -> cv2.aruco.Dictionary:
    """Read a dictionary from OpenCV's file."""
    dictionary, file = cv2.aruco.Dictionary(), cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    if not dictionary.readDictionary(file.root()):
        sys.exit(f"{path}: has no dictionary")
    return dictionary


def read_lens(path: Path) -> Camera:
    """Read intrinsics from OpenCV's file; the camera frame as base."""
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    K, distortion = file.getNode("camera_matrix").mat(), file.getNode("distortion_coefficients").mat()
    return Camera(np.asarray(K, dtype=float), np.asarray(distortion, dtype=float).ravel(), SIZE, np.eye(4))


def plain_lens(size: tuple[int, int], focal: float) -> Camera:
    """A lens without distortion, of this focal length, px; the camera frame as base."""
    K = np.array([[focal, 0.0, (size[0] - 1) / 2.0], [0.0, focal, (size[1] - 1) / 2.0], [0.0, 0.0, 1.0]])
    return Camera(K, np.zeros(5), size, np.eye(4))


def fitted_lens(view: View) -> Camera:
    """The plain lens by which a view of a print fits best."""

    def squares(focal: float) -> float:
        camera = plain_lens(SIZE, focal)
        return float((residual_of(camera, pose_of(view, camera), view) ** 2).sum())

    return plain_lens(SIZE, float(minimize_scalar(squares, bounds=(0.5 * SIZE[0], 3.0 * SIZE[0])).x))


@dataclass(frozen=True)
class Folders:
    """The unpacked packages."""

    paths: Sequence[Path]

    def __iter__(self) -> Iterator[Path]:
        return (file for path in self.paths for file in sorted(path.rglob("*")) if file.is_file())

    def named(self, pattern: str) -> list[Path]:
        """Files of that name, each name once."""
        found = {file.name: file for file in reversed(list(self)) if re.fullmatch(pattern, file.name)}
        return [found[name] for name in sorted(found)]

    def file(self, name: str) -> Path:
        """The file of that name."""
        found = self.named(re.escape(name))
        if not found:
            sys.exit(f"{', '.join(map(str, self.paths))}: no {name}")
        return found[0]

    def predefined(self, name: str) -> cv2.aruco.Dictionary:
        """A dictionary by OpenCV's name, or by a file's."""
        return read_dictionary(self.file(name)) if name.endswith(".yml") else predefined(name)


@dataclass(frozen=True)
class Compared:
    """A marker of OpenCV's with its shortest side, px, and ours; and the side that border lines need, px."""

    id: int
    side: float
    needed: float
    ours: Marker | None


def compared(folders: Folders, pictures: PictureSet) -> dict[str, list[Compared]]:
    """The markers of each picture of a set."""
    dictionary = folders.predefined(pictures.dictionary)
    needed = LEAST_MODULE_PX * (dictionary.markerSize + 2)
    detector = cv2.aruco.ArucoDetector(dictionary)
    found: dict[str, list[Compared]] = {}
    for path in folders.named(pictures.files):
        image = read_grey(path)
        lens = pictures.shown and pictures.shown.lens
        camera = (
            read_lens(folders.file(lens))
            if lens
            else plain_lens((image.shape[1], image.shape[0]), image.shape[1])
        )
        ours = detect_markers(image, camera, pictures.dictionary)
        outlines, ids, _ = detector.detectMarkers(image)
        found[path.name] = []
        for outline, marker_id in zip(outlines, [] if ids is None else ids.ravel(), strict=True):
            corners = outline.reshape(4, 2).astype(float)
            side = shortest_side(corners)
            same = (
                m
                for m in ours
                if m.id == marker_id
                and np.linalg.norm(m.corners_px.mean(axis=0) - corners.mean(axis=0)) < side / 2.0
            )
            found[path.name].append(Compared(int(marker_id), side, needed, next(same, None)))
    return found


def markers(found: Mapping[PictureSet, Mapping[str, Sequence[Compared]]]) -> None:
    """Markers against OpenCV, set by set."""
    head = "pictures", "dictionary", "side px", "number", "markers of OpenCV", "found", "by border lines"
    table("Markers", *head, "of those with sides that border lines need")
    for pictures, images in found.items():
        every = [m for image in images.values() for m in image]
        large = [m for m in every if m.side >= LEAST_PX]
        for few, small in (
            (large, ""),
            ([m for m in every if m.side < LEAST_PX], f", under {LEAST_PX:g} px"),
        ):
            if few:
                ours = [m.ours for m in few if m.ours is not None]
                lines = sum(m.method == "lines" for m in ours)
                fit = [m for m in few if m.side >= m.needed]
                fit_lines = sum(m.ours is not None and m.ours.method == "lines" for m in fit)
                sides = f"{min(m.side for m in few):.0f} to {max(m.side for m in few):.0f}"
                kind = f"{pictures.name}{', rendered' if pictures.rendered else ''}{small}"
                cells = kind, pictures.dictionary, sides, len(images), len(few), len(ours), lines
                print(
                    f"| {' | '.join(map(str, cells))} | {fit_lines} of {len(fit)} (>= {few[0].needed:.0f} px) |"
                )


def boards(folders: Folders, name: str, images: Mapping[str, Sequence[Compared]], shown: Print) -> None:
    """Each two markers of a print that are far enough apart as a board, in single photographs."""
    tallies = {True: Tally(), False: Tally()}
    for every in images.values():
        ours = {m.id: m.ours for m in every if m.ours and m.id in shown.centres}
        points = np.concatenate([shown.corners(k) for k in ours])
        view = View(points, np.concatenate([m.corners_px for m in ours.values()]))
        camera = read_lens(folders.file(shown.lens)) if shown.lens else fitted_lens(view)
        whole = pose_of(view, camera)[:3, :3]
        large = sorted(m.id for m in every if m.side >= LEAST_PX and m.id in ours)
        for low, high in combinations(large, 2):
            x, y = np.subtract(shown.centres[high], shown.centres[low])
            if np.hypot(x, y) >= APART * shown.size:
                board = two_markers(f"{low}-{high}", (low, high), shown.size, (float(x), float(y)))
                pair = [ours[low], ours[high]]
                by_lines = all(m.method == "lines" for m in pair)
                tallies[by_lines].add(assess_board(board, [pair], camera), whole)
    lens = shown.lens or f"fitted: {camera.K[0, 0]:.0f} px"
    for by_lines, tally in tallies.items():
        how = "both by border lines" if by_lines else "one or both by cornerSubPix"
        print(f"| {name} | {1e3 * shown.size:g} | {lens} | {len(images)} | {how} | {tally.words()} |")


@dataclass
class Tally:
    """Verdicts, reasons of refusals, and rotations against the pose of the whole print, deg."""

    off: dict[bool, list[float]] = field(default_factory=lambda: {True: [], False: []})
    why: Counter[str] = field(default_factory=Counter)

    def add(self, verdict: BoardAssessment, whole: Array) -> None:
        """Count a board."""
        if verdict.pose is not None:
            angle = angle_between(verdict.pose.T_base_board[:3, :3], whole)
            self.off[verdict.accepted].append(float(np.degrees(angle)))
        if not verdict.accepted:
            self.why[reason(verdict.doubts)] += 1

    def words(self) -> str:
        """Cells of a row."""
        accepted, total = len(self.off[True]), len(self.off[True]) + self.why.total()
        angles = (
            f"{np.sqrt(np.mean(np.square(off))):.1f}, {max(off):.1f}" if off else "-"
            for off in self.off.values()
        )
        refused = ", ".join(f"{n} {words}" for words, n in self.why.most_common())
        share = f"{accepted} of {total} ({100.0 * accepted / max(total, 1):.1f} %)"
        return f"{share} | {' | '.join(angles)} | {refused or '-'}"


def reason(doubts: Sequence[Exception]) -> str:
    """The first doubt in few words."""
    if not doubts:
        return "no pose"
    first = str(doubts[0])
    kinds = {
        "cannot be distinguished": "ambiguous tilt",
        "too uncertain": "uncertain",
        "marker size": "marker size",
        "do not fit": "misfit",
        "is in none": "marker not found",
    }
    word = next((short for words, short in kinds.items() if words in first), first)
    if word == "uncertain":
        over = (w for w in ("sideways", "height", "rotation") if w in first.split("standard")[0])
        word += f" ({', '.join(over)})"
    return word


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", type=Path, nargs="+", help="of unpacked packages")
    parser.add_argument(
        "--scales",
        type=float,
        nargs="+",
        default=(1.0, 0.25),
        help="prints are taken to be that many times as large, which no picture shows: 0.25 gives some 4 px per mm, as "
        "in the cell, instead of 1",
    )
    options = parser.parse_args()
    folders = Folders(options.folders)
    print(f"# Markers in public pictures\n\n{versions()}")
    with patch.object(detect, "predefined", folders.predefined):
        found = {s: images for s in SETS if folders.named(s.files) and (images := compared(folders, s))}
        if not found:
            sys.exit(f"{', '.join(map(str, folders.paths))}: none of the known pictures")
        markers(found)
        head = "print", "marker mm", "lens", "photographs", "corners", "accepted", "off deg: rms, max"
        table("Boards of two markers", *head, "refused ones: rms, max", "refused as")
        for pictures, images in found.items():
            if pictures.shown is not None:
                for scale in options.scales:
                    boards(folders, pictures.name, images, pictures.shown.scaled(scale))


if __name__ == "__main__":
    main()
