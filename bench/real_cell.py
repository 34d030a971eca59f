"""What the project makes of photographs of a real cell that it did not draw: python bench/real_cell.py FOLDER.

FOLDER has the photographs and their catalogue (catalog.json, groups.json); none of them belongs to the project. Lens
and camera pose of that cell are not known: the intrinsics here are assumed, so lengths along the axis are nominal.
"""

from __future__ import annotations

import argparse
import itertools
import json
import platform
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from arm.board import Board
from arm.errors import A465Error
from arm.poses import BoardPose
from arm.se3 import Array, inverse, rotation, rotation_vector
from calib.camera.calibrate import calibrate_camera
from calib.camera.view_selection import TargetPhoto
from cell.files.board_shift import board_shift
from vision.background.camera_shift import CameraShift, as_calibrated, measure_shift
from vision.background.features import Background, background_features
from vision.boards.pose import assess_board
from vision.camera.frame_source import read_grey
from vision.camera.model import Camera, Image
from vision.markers.detect import detect_markers
from vision.observe import with_camera_uncertainty
from vision.targets.quality import measure_quality
from vision.targets.target import Target, TargetFinder

SIZE = (1920, 1200)
FOCAL, K1, DISTANCE = 4740.0, -0.25, 1.19  # px, -, m: assumed
SQUARE, SECOND = 0.040, (0.075, -0.075)  # m, of the wire board
TOLERATED = 0.15  # px between the background's shift and the board's own
LARGE = 0.65  # px of a board's shift that must be reported
NOISE = 2.0  # grey levels added to the same photograph
FLAT_SHEET = Target("charuco", 5, 5, 0.025, 0.018, "DICT_4X4_50")
LARGE_SHEET = Target("charuco", 10, 14, 0.020, 0.015, "DICT_4X4_100", legacy=True)


@dataclass(frozen=True)
class Photos:
    """A folder of photographs with its catalogue."""

    folder: Path

    @cached_property
    def catalog(self) -> dict[str, Any]:
        """A row for each photograph."""
        return dict(json.loads((self.folder / "catalog.json").read_text()))

    @cached_property
    def groups(self) -> dict[str, Any]:
        """Boards that stood still."""
        return dict(json.loads((self.folder / "groups.json").read_text()))

    def image(self, name: str) -> Image:
        """A photograph without its last row and column, which are black in this set, repeated from their neighbours."""
        image = read_grey(self.folder / name).copy()
        image[-1], image[:, -1] = image[-2], image[:, -2]
        return image


def assumed_camera() -> Camera:
    """The assumed lens, with the camera frame as base."""
    K = np.array([[FOCAL, 0.0, (SIZE[0] - 1) / 2.0], [0.0, FOCAL, (SIZE[1] - 1) / 2.0], [0.0, 0.0, 1.0]])
    return Camera(K, np.array([K1, 0.0, 0.0, 0.0, 0.0]), SIZE, np.eye(4))


def two_markers(
    name: str, ids: tuple[int, int], size: float, second: tuple[float, float], tolerance: float = 1e-4
) -> Board:
    """A board of two markers of this size, made within `tolerance`, all m; its holes are unused."""
    return Board(name, ids, np.zeros((4, 3)), size, second, tolerance=tolerance)


def wire_board(tolerance: float = 1e-4) -> Board:
    """The board of the hoop with its two markers."""
    return two_markers("wire", (1, 2), SQUARE, SECOND, tolerance)


def table(title: str, *header: str) -> None:
    """Print a heading and the head of a table."""
    print(f"\n## {title}\n\n| {' | '.join(header)} |\n|{'---|' * len(header)}")


def markers(photos: Photos, camera: Camera) -> None:
    """Markers against OpenCV, photograph by photograph."""
    ours = theirs = same = by_lines = 0
    for name, row in photos.catalog.items():
        found = detect_markers(photos.image(name), camera)
        ids = {m.id for m in found}
        wanted = set(row["aruco_opencv"])
        ours, theirs, same = ours + len(ids & wanted), theirs + len(wanted), same + (ids == wanted)
        by_lines += sum(m.method == "lines" for m in found if m.id in wanted)
    header = "photographs", "markers of OpenCV", "found", "by border lines", "photographs with the same set"
    table("Markers", *header)
    share = f"{by_lines} ({100 * by_lines / theirs:.1f} %)"
    print(f"| {len(photos.catalog)} | {theirs} | {ours} | {share} | {same} |")


def boards(photos: Photos, camera: Camera) -> None:
    """The wire board in single photographs that show both of its markers."""
    print("\n## Board of two markers, single photographs\n")
    accepted, refused = 0, []
    for name in photos.catalog:
        if not name.startswith("hoop_arm/"):
            continue
        found = detect_markers(photos.image(name), camera)
        if not {1, 2} <= {m.id for m in found} or len(found) > 4:
            continue
        verdict = assess_board(wire_board(), [found], camera)
        accepted += verdict.accepted
        if not verdict.accepted:
            refused.append(f"{name}: {verdict.doubts[0] if verdict.doubts else 'no pose'}")
    print(f"accepted {accepted} of {accepted + len(refused)}")
    for line in refused:
        print(f"- {line}")


def covered_by(image: Image, camera: Camera) -> list[Array]:
    """Discs about each marker and about all of them: plates, stands and their shadows."""
    round_ = np.stack([np.cos(np.linspace(0, 2 * np.pi, 40)), np.sin(np.linspace(0, 2 * np.pi, 40))], axis=1)
    corners = [m.corners_px for m in detect_markers(image, camera)]
    discs = [c.mean(axis=0) + 2.6 * np.linalg.norm(c[0] - c[1]) * round_ for c in corners]
    if len(corners) > 1:
        centre = np.concatenate(corners).mean(axis=0)
        discs.append(centre + 1.6 * np.linalg.norm(np.concatenate(corners) - centre, axis=1).max() * round_)
    return discs


def shift_at(point: Array, shift: CameraShift, camera: Camera) -> Array:
    """Shift of the background at a point, (2,) px."""
    at = as_calibrated_point(point, shift, camera)
    return np.asarray(at - point)


def as_calibrated_point(point: Array, shift: CameraShift, camera: Camera) -> Array:
    """Where a background point of the reference image is now, (2,) px."""
    ray = np.append(camera.normalised(point), 1.0)
    return np.asarray(camera.project(ray @ rotation(shift.rotation)))


@dataclass
class Watched:
    """Photographs of a group against each other."""

    photos: Photos
    camera: Camera

    def background(self, name: str) -> Background:
        """Features of one photograph outside its boards."""
        image = self.photos.image(name)
        return background_features([image], self.camera, covered_by(image, self.camera))

    def pairs(self, group: dict[str, Any]) -> Iterator[tuple[Array, Array, bool]]:
        """The board's own shift, the background's at its place, px, and whether the camera is said to have moved."""
        place = np.mean([np.array(v) for v in group["mean_corners_px"].values()], axis=(0, 1))
        kept: dict[str, Background] = {}
        for pair in group["pairs"]:
            first, second = (f"hoop_arm/{pair[k]}.png" for k in "ab")
            if first not in kept:
                kept[first] = self.background(first)
            shift = measure_shift(kept[first], self.photos.image(second), self.camera, DISTANCE)
            yield np.array(pair["board_shift_px"]), shift_at(place, shift, self.camera), shift.is_certain


def background(photos: Photos, camera: Camera, noisy: int) -> None:
    """Shift of the background against that of a board that stands still; and no shift where there is none."""
    watched = Watched(photos, camera)
    header = (
        "group",
        "pairs",
        f"within {TOLERATED} px",
        "median, p95, max px",
        f"shifts of >= {LARGE} px: reported",
    )
    table("Shift of the background against the board's own", *header)
    for name, group in photos.groups.items():
        rows = list(watched.pairs(group))
        off = np.array([np.linalg.norm(b - t) for b, t, _ in rows])
        large = [said for b, _, said in rows if np.linalg.norm(b) >= LARGE]
        figures = f"{np.median(off):.3f}, {np.quantile(off, 0.95):.3f}, {off.max():.3f}"
        print(
            f"| {name} | {len(off)} | {(off < TOLERATED).sum()} | {figures} | {sum(large)} of {len(large)} |"
        )
    names = [n for n in photos.catalog if n.startswith("hoop_arm/data")]
    rng = np.random.default_rng(0)
    said = 0
    for k in range(noisy):
        name = names[k % len(names)]
        clean = photos.image(name)
        again = np.clip(np.rint(clean + rng.normal(0.0, NOISE, clean.shape)), 0, 255).astype(np.uint8)
        said += measure_shift(watched.background(name), again, camera, DISTANCE).is_certain
    print(f"\nsame photograph with new noise of {NOISE:g} grey levels: said to have moved {said} of {noisy}")


def still(photos: Photos, camera: Camera) -> None:
    """Boards that stood still: scatter of single photographs over their repeatability, with the camera's shift out."""
    watched = Watched(photos, camera)
    group = photos.groups["A"]
    names = [f"hoop_arm/{n}.png" for n in group["photographs"]]
    reference = watched.background(names[0])
    rows: list[tuple[BoardPose, BoardPose]] = []
    for name in names:
        image = photos.image(name)
        shift = measure_shift(reference, image, camera, DISTANCE)
        steady = as_calibrated(image, camera, shift)
        both = [
            assess_board(wire_board(tolerance=0.0), [detect_markers(i, camera)], camera)
            for i in (image, steady)
        ]
        taken, corrected = (v.pose if v.accepted else None for v in both)
        if taken is not None and corrected is not None:
            rows.append((taken, with_camera_uncertainty(corrected, camera, shift)))
    header = (
        "images",
        "photographs",
        "scatter across, depth mm",
        "repeatability across, depth mm",
        "ratio",
        "deg, repeatability, ratio",
        "standard deviation of the pose across, depth mm; deg",
    )
    table("A board that stands still (group A), single photographs", *header)
    for name, poses in zip(("as taken", "corrected by the background"), zip(*rows, strict=True), strict=True):
        print(f"| {name} | {len(poses)} | {spread(poses)} |")
    print(f"\nbetween two corrected ones, any point of the plate moves {moved([pose for _, pose in rows])}")


def moved(poses: Sequence[BoardPose]) -> str:
    """How far a board at rest seems to move between two looks, as `look.moved_mm` and `look.moved_deg` compare them."""
    shifts = [
        board_shift(a.board, 0.0, a.T_base_board, b.T_base_board) for a, b in itertools.combinations(poses, 2)
    ]
    far, turn = 1e3 * np.array([s.farthest for s in shifts]), np.degrees([s.turn for s in shifts])
    middle, most = (f"{of(far):.2f} mm, {of(turn):.2f} deg" for of in (np.median, np.max))
    return f"{middle} (median), {most} (most)"


def spread(poses: Sequence[BoardPose]) -> str:
    """Scatter of poses of one board beside their repeatability, and their standard deviations."""
    mean = poses[0].T_base_board
    t = np.array([p.T_base_board[:3, 3] for p in poses])
    turns = np.array([rotation_vector((inverse(mean) @ p.T_base_board)[:3, :3]) for p in poses])
    scatter, turn = t.std(axis=0, ddof=1), turns.std(axis=0, ddof=1)
    found = _across_depth_turn(np.hstack([scatter, turn]))
    again, whole = (
        _across_depth_turn(np.sqrt(np.mean([np.diag(_in_camera(p, c)) for p, c in of], axis=0)))
        for of in ([(p, p.repeatability) for p in poses], [(p, p.covariance) for p in poses])
    )
    ratio = found / again
    return (
        f"{found[0]:.3f}, {found[1]:.3f} | {again[0]:.3f}, {again[1]:.3f} | {ratio[0]:.2f}, {ratio[1]:.2f} | "
        f"{found[2]:.3f}, {again[2]:.3f}, {ratio[2]:.2f} | {whole[0]:.3f}, {whole[1]:.3f}; {whole[2]:.3f}"
    )


def _across_depth_turn(sigma: Array) -> Array:
    """Mean of x and y mm, z mm, and length of the turn deg, of standard deviations (6,) m and rad."""
    return np.array(
        [1e3 * np.hypot(*sigma[:2]) / 2**0.5, 1e3 * sigma[2], np.degrees(np.linalg.norm(sigma[3:]))]
    )


def _in_camera(pose: BoardPose, covariance: Array | None) -> Array:
    R = np.kron(np.eye(2), pose.T_base_board[:3, :3])
    return np.full((6, 6), np.nan) if covariance is None else np.asarray(R @ covariance @ R.T)


def borders(photos: Photos, camera: Camera) -> None:
    """Borders of ChArUco markers, as markers are measured, against the corners of the squares around them."""
    table(
        "Borders of markers against the corners of squares",
        "print",
        "markers",
        "outwards px, scatter of markers",
    )
    flat_names = sorted(n for n in photos.catalog if n.startswith("charuco_flat/"))
    for target, names in ((FLAT_SHEET, flat_names), (LARGE_SHEET, ["hoop_arm/image_012.png"])):
        finder, squares = TargetFinder(target), target.marker_squares()
        off: list[float] = []
        for image in (photos.image(name) for name in names):
            view = finder.find(image)
            if view is None:
                continue
            H, _ = cv2.findHomography(camera.normalised(view.corners_px), target.points()[view.ids, :2])
            for marker in detect_markers(image, camera, target.dictionary):
                if marker.method == "lines" and marker.id < len(squares):
                    on_print = cv2.perspectiveTransform(camera.normalised(marker.corners_px)[:, None], H)[
                        :, 0
                    ]
                    edge, edge_px = _edge(np.asarray(on_print, dtype=float)), _edge(marker.corners_px)
                    off.append((1.0 - target.marker / edge) * edge_px / 2.0)
        print(f"| {target.label()} | {len(off)} | {np.mean(off):+.3f}, {np.std(off):.3f} |")


def _edge(corners: Array) -> float:
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=-1).mean())


def flat(photos: Photos) -> None:
    """The flat ChArUco sheet: refused, and what it says of the focal length."""
    target = FLAT_SHEET
    print(f"\n## {target.label()}, flat on the table, 15 views\n")
    finder = TargetFinder(target)
    names = sorted(n for n in photos.catalog if n.startswith("charuco_flat/"))
    views = []
    for name in names:
        view = finder.find(image := photos.image(name))
        views.append(TargetPhoto(name, view, None if view is None else measure_quality(image, target, view)))
    try:
        found = calibrate_camera(views, target, SIZE)
    except A465Error as error:
        print(f"refused: {error}")
        return
    sigma = np.sqrt(np.diag(found.covariance)[:2])
    f = np.diag(found.camera.K)[:2]
    print(f"{'accepted' if found.accepted else 'refused'}: {'; '.join(found.reasons)}")
    off = np.abs(f - FOCAL) / sigma
    print(f"\nfx {f[0]:.0f} +- {sigma[0]:.0f}, fy {f[1]:.0f} +- {sigma[1]:.0f}")
    print(f"that is {off[0]:.1f}, {off[1]:.1f} standard deviations from the assumed {FOCAL:g}")


def other_targets(photos: Photos) -> None:
    """A sheet of another dictionary and of the old layout."""
    print("\n## image_012: ChArUco 10 x 14, DICT_4X4_100, legacy layout\n")
    image = photos.image("hoop_arm/image_012.png")
    for rows, dictionary, legacy in (
        (14, "DICT_4X4_100", True),
        (14, "DICT_4X4_100", False),
        (10, "DICT_4X4_50", True),
        (10, "DICT_4X4_50", False),
    ):
        target = Target("charuco", 10, rows, 0.020, 0.015, dictionary, legacy)
        finder = TargetFinder(target)
        view = finder.find(image)
        said = finder.seen_instead(image) if view is None else finder.read_in_part(image)
        corners = 0 if view is None else len(view.ids)
        print(f"- as {target.label()}: {corners} corners of {target.corners}{said and f'; refused: {said}'}")


def versions() -> str:
    """Commit and versions."""
    commit = subprocess.run(
        ["git", "describe", "--always", "--dirty"], capture_output=True, text=True, check=False
    )
    return (
        f"commit {commit.stdout.strip()}; Python {platform.python_version()}, numpy {np.__version__}, OpenCV "
        f"{cv2.__version__}"
    )


TABLES = ("markers", "boards", "background", "still", "borders", "flat", "targets")


def main() -> None:
    """Print the tables that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="with catalog.json and groups.json")
    parser.add_argument("--tables", nargs="*", choices=TABLES, default=TABLES)
    parser.add_argument("--noisy", type=int, default=200, help="photographs with new noise")
    options = parser.parse_args()
    photos, camera = Photos(options.folder), assumed_camera()
    assumed = f"assumed f {FOCAL:g} px, k1 {K1:g}, camera {DISTANCE:g} m above the table"
    print(f"# Photographs of a real cell\n\n{versions()}; {assumed}")
    for name in options.tables:
        if name == "markers":
            markers(photos, camera)
        elif name == "boards":
            boards(photos, camera)
        elif name == "background":
            background(photos, camera, options.noisy)
        elif name == "still":
            still(photos, camera)
        elif name == "borders":
            borders(photos, camera)
        elif name == "flat":
            flat(photos)
        else:
            other_targets(photos)


if __name__ == "__main__":
    main()
