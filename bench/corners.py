"""Marker corners in rendered images against the exact projection: border lines, OpenCV's SUBPIX, no refinement.

python bench/corners.py --images 40

The lab's camera, one board with 40 mm markers about 1.1 m away, tilted 0 to 15 degrees in a random direction, drawn by
`render` (16 rays a pixel at edges, lens blur 0.7 px), noise 2 grey, unless a row says otherwise. Each marker has its
own window. Errors are root mean squares per coordinate over all corners, px; "out" is the mean error outward from the
marker's centre, "bias" the larger of the mean errors in x and y. All methods see the same images.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from arm.board import PLATE_CENTRE, PLATE_SIZE
from arm.se3 import Array, apply
from cell.scene.bodies import plate_body
from pictures.boards import TABLE, lab_board, lab_camera, leaning, photograph, random_pose, window
from render.renderer import PlacedBoard, render, with_noise
from vision.camera.model import Camera, Image
from vision.markers.detect import detect_markers

MARGIN_PX = 60.0
PLATE_CORNERS = np.array(
    [
        (*(np.array(PLATE_CENTRE) + 0.5 * np.array((x, y)) * PLATE_SIZE[:2]), -PLATE_SIZE[2])
        for x in (-1, 1)
        for y in (-1, 1)
    ]
)
WAYS = ("lines", "SUBPIX", "none")


@dataclass(frozen=True)
class Conditions:
    """How a row is drawn.

    Attributes:
        size: of the marker, m.
        noise: standard deviation of grey levels.
        psf_px: the lens's blur.
        gain, offset: of grey levels, clipped at 0 and 255.
        jpeg: quality, or 0 for none.
        covered: part of the top side's length that a dark disc hides, or 0; of a quarter on no way finds the marker.
        shade: the right part of the image has this share of its light.
    """

    size: float = 0.040
    noise: float = 2.0
    psf_px: float = 0.7
    gain: float = 1.0
    offset: float = 0.0
    jpeg: int = 0
    covered: float = 0.0
    shade: float = 1.0


ROWS = {
    "40 mm, noise 2": Conditions(),
    "36 mm": Conditions(size=0.036),
    "20 mm": Conditions(size=0.020),
    "6 mm: 26 px": Conditions(size=0.006),
    "5 mm: 22 px": Conditions(size=0.005),
    "6 mm, blurred, 1.2 px": Conditions(size=0.006, psf_px=1.2),
    "noise 0": Conditions(noise=0.0),
    "noise 6": Conditions(noise=6.0),
    "blurred, 1.5 px": Conditions(psf_px=1.5),
    "blurred, 2.5 px": Conditions(psf_px=2.5),
    "dark, a quarter of the light": Conditions(gain=0.25),
    "bright, white at 250": Conditions(gain=1.1),
    "1.2 times too bright, half of the white saturated": Conditions(gain=1.2),
    "1.6 times too bright": Conditions(gain=1.6),
    "JPEG, quality 90": Conditions(jpeg=90),
    "JPEG, quality 60": Conditions(jpeg=60),
    "a shadow's edge across it": Conditions(shade=0.6),
    "a tenth of a side hidden": Conditions(covered=0.1),
    "a sixth of a side hidden": Conditions(covered=1.0 / 6.0),
}


@dataclass(frozen=True)
class Shot:
    """A photograph of one marker, the camera that took it, and the true corners (4, 2) px."""

    image: Image
    camera: Camera
    truth: Array


@dataclass(frozen=True)
class Measured:
    """Errors (4, 2) px of each way that found the marker, the outward unit vectors, and what lines fell back to."""

    errors: dict[str, Array]
    outward: Array
    method: str


def drawn(seed: int, of: Conditions) -> Shot:
    """The photograph of a seed."""
    rng = np.random.default_rng([seed, 11])
    board, whole = lab_board(marker_size=of.size), lab_camera()
    above = False
    while not above:  # no corner of the plate may dip into the table
        T = random_pose(rng, rng.uniform(0.0, 15.0))
        above = bool(apply(T, PLATE_CORNERS)[:, 2].min() > 0.0)
    corners = apply(T, board.marker_corners()[seed % 2])
    low = np.floor(whole.project_base(corners).min(axis=0) - MARGIN_PX)
    high = np.ceil(whole.project_base(corners).max(axis=0) + MARGIN_PX)
    camera = window(whole, low, (int(high[0] - low[0]), int(high[1] - low[1])))
    bodies = [TABLE, plate_body(board.name, T)]
    clean = render(camera, bodies, [PlacedBoard(board, T)], psf_px=of.psf_px)
    truth = camera.project_base(corners)
    clean = np.clip(of.gain * clean + of.offset, 0.0, 255.0).astype(np.float32)
    if of.shade < 1.0:
        middle = truth.mean(axis=0)
        x = np.arange(camera.size[0], dtype=np.float32)
        clean *= (1.0 - (1.0 - of.shade) / (1.0 + np.exp(-(x - middle[0])))).astype(np.float32)
    if of.covered > 0.0:
        a, b = truth[0], truth[1]
        middle, radius = a + rng.uniform(0.3, 0.7) * (b - a), 0.5 * of.covered * np.linalg.norm(b - a)
        cv2.circle(clean, np.rint(middle).astype(int).tolist(), int(np.rint(radius)), 30.0, -1, cv2.LINE_AA)
    image = with_noise(clean, rng, of.noise)
    if of.jpeg:
        _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, of.jpeg])
        image = np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE), dtype=np.uint8)
    return Shot(image, camera, truth)


def by_opencv(image: Image, refinement: int) -> Array | None:
    """Corners (4, 2) of the only marker by OpenCV's own detector."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = refinement
    parameters.minMarkerDistanceRate = 0.05
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), parameters)
    found, ids, _ = detector.detectMarkers(image)
    return None if ids is None or len(ids) != 1 else found[0].reshape(4, 2).astype(float)


def measured(seeds: range, of: Conditions) -> list[Measured]:
    """Errors of all ways over images."""
    results = []
    for seed in seeds:
        shot = drawn(seed, of)
        ours = detect_markers(shot.image, shot.camera)
        found = {
            "lines": ours[0].corners_px if len(ours) == 1 else None,
            "SUBPIX": by_opencv(shot.image, cv2.aruco.CORNER_REFINE_SUBPIX),
            "none": by_opencv(shot.image, cv2.aruco.CORNER_REFINE_NONE),
        }
        outward = shot.truth - shot.truth.mean(axis=0)
        outward /= np.linalg.norm(outward, axis=-1, keepdims=True)
        errors = {way: corners - shot.truth for way, corners in found.items() if corners is not None}
        results.append(Measured(errors, outward, ours[0].method if ours else "not found"))
    return results


def told(results: Iterable[Measured], way: str) -> str:
    """rms, bias and outward error of one way."""
    pairs = [(m.errors[way], m.outward) for m in results if way in m.errors]
    if not pairs:
        return "- | - | -"
    errors, outward = (np.array(part) for part in zip(*pairs, strict=True))
    bias = np.abs(errors.mean(axis=(0, 1))).max()
    return f"{np.sqrt(np.mean(errors**2)):.4f} | {bias:.4f} | {(errors * outward).sum(axis=-1).mean():+.4f}"


def times(repeats: int) -> dict[str, list[float]]:
    """Processor ms of one whole photograph with four markers, one thread; wall ms too."""
    camera = lab_camera()
    boards = [
        (lab_board("01-02", 0.040), leaning((0.46, 0.11, 0.04), 175.0, 7.0, 265.0)),
        (lab_board("03-04", 0.040), leaning((0.46, -0.13, 0.09), 90.0, 15.0, 270.0)),
    ]
    image = photograph(camera, boards, np.random.default_rng(1)).images[0]
    cv2.setNumThreads(1)
    jobs: dict[str, Callable[[], object]] = {
        "lines": lambda: detect_markers(image, camera),
        "SUBPIX": lambda: by_opencv(image, cv2.aruco.CORNER_REFINE_SUBPIX),
        "none": lambda: by_opencv(image, cv2.aruco.CORNER_REFINE_NONE),
    }
    took: dict[str, list[float]] = {}
    for name, job in jobs.items():
        for _ in range(repeats):
            started = time.process_time()
            job()
            took.setdefault(name, []).append(1e3 * (time.process_time() - started))
    return took


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--images", type=int, default=40, help="of each row, one marker each")
    parser.add_argument("--repeats", type=int, default=20, help="of the timing")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    print(
        f"Python {platform.python_version()}, OpenCV {cv2.__version__}, {os.cpu_count()} processors, load "
        f"{os.getloadavg()[0]:.1f}; {options.images} images a row, {4 * options.images} corners",
        flush=True,
    )
    print(f"\n| | {' | '.join(f'{w} rms px | bias | out' for w in WAYS)} | by lines % | found % (SUBPIX %) |")
    print(f"|{'---|' * (3 * len(WAYS) + 3)}", flush=True)
    with ProcessPoolExecutor(options.jobs) as pool:
        for name, of in ROWS.items():
            seeds = [range(i, min(i + 5, options.images)) for i in range(0, options.images, 5)]
            results = [m for part in pool.map(measured, seeds, repeat(of)) for m in part]
            lines = 100 * np.mean([m.method == "lines" for m in results])
            found, theirs = (100 * np.mean([w in m.errors for m in results]) for w in ("lines", "SUBPIX"))
            cells = " | ".join(told(results, way) for way in WAYS)
            print(f"| {name} | {cells} | {lines:.0f} | {found:.0f} ({theirs:.0f}) |", flush=True)
    print(
        "\n| four markers, 1920 x 1200 px, one thread | least ms of processor time | median |\n|---|---|---|"
    )
    for name, took in times(options.repeats).items():
        print(f"| {name} | {min(took):.1f} | {np.median(took):.1f} |")


if __name__ == "__main__":
    main()
