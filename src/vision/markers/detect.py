"""Detect markers: find them in a reduced image and measure them in the full one."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import cv2
import numpy as np
import numpy.typing as npt

from arm.se3 import Array, frozen
from vision.camera.frame_source import Image, as_grey
from vision.camera.model import Camera
from vision.markers.border_shift import border_shift, moved_outwards
from vision.markers.dictionaries import predefined
from vision.markers.edge_lines import BY_TURN, PROFILE_PART, refine_by_border_lines
from vision.markers.edge_profiles import LEAST_HALF_PX

SEARCH_WIDTH_PX = 960  # images are searched at the integer fraction of their size that is at least this wide
_SUBPIX_HALF_PX = 2, 5  # half width of the window of `cornerSubPix`, least and most
_SUBPIX_PART = 0.8  # the same in modules: a wider window reaches the code, which pulls the corner inwards
_SUBPIX_STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 30, 0.01)


@dataclass(frozen=True)
class Marker:
    """A marker detected in one image.

    Attributes:
        id: in its dictionary.
        corners_px: (4, 2) top left, top right, bottom right, bottom left of the marker as printed.
        method: how the corners were measured: "lines", or "subpix" if a side is hidden, blurred or too short;
            "recorded" if a file does not give it.
        side_sigma_px: standard deviation of each side's remaining shift, common to all images, (4,) px
            (`vision.markers.border_shift`); None if unknown.
        noise: covariance of the corners in this image alone, (8, 8) px^2; None if unknown.
    """

    id: int
    corners_px: Array
    method: Literal["lines", "subpix", "recorded"]
    side_sigma_px: Array | None = None
    noise: Array | None = None


def detect_markers(image: Image, camera: Camera, dictionary: str = "DICT_4X4_50") -> list[Marker]:
    """Find all markers of a dictionary, ordered by id.

    A marker is found only if it lies at least some 3 px inside the image.

    Args:
        image: grey (h, w) or BGR (h, w, 3), of the camera's size.
        camera: for its distortion.
        dictionary: OpenCV's name.

    Raises:
        InputError: the image is not of the camera's size, or there is no such dictionary.
    """
    camera.require_size(image, "image")
    grey = as_grey(image)
    detector = _detector(dictionary)
    shrink = max(1, grey.shape[1] // SEARCH_WIDTH_PX)
    small = grey
    if shrink > 1:
        size = (grey.shape[1] // shrink, grey.shape[0] // shrink)
        small = np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    found, ids, _ = detector.detectMarkers(small)
    if ids is None or not len(ids):
        return []
    scale = np.array([grey.shape[1] / small.shape[1], grey.shape[0] / small.shape[0]])
    # the centre of the first pixel of a reduced image lies (scale - 1) / 2 pixels inside the full one
    rough = np.stack([c.reshape(4, 2) for c in found]).astype(float) * scale + (scale - 1.0) / 2.0
    modules = detector.getDictionary().markerSize + 2
    start = np.stack([_lines_start(grey, corners, modules) for corners in rough])
    lines = refine_by_border_lines(grey, start, camera, modules)
    image_f = grey.astype(np.float32)
    markers = []
    for index, marker_id in enumerate(ids.reshape(-1)):
        if lines.good[index]:
            corners = lines.corners_px[index]
            reach = PROFILE_PART * shortest_side(corners) / modules
            shift = border_shift(image_f, corners, _bits(dictionary, int(marker_id)), reach, camera)
            corners = moved_outwards(corners, -shift.shift_px)
            sigma = frozen(shift.sigma_px) if shift.known else None
            noise = _corner_noise(corners, lines.side_noise_px[index] ** 2, shift.noise)
            markers.append(Marker(int(marker_id), frozen(corners), "lines", sigma, frozen(noise)))
        elif _inside(rough[index], grey):
            markers.append(Marker(int(marker_id), frozen(_subpix(grey, rough[index], modules)), "subpix"))
    return sorted(markers, key=lambda marker: marker.id)


def _corner_noise(corners: Array, middle: Array, shift: Array) -> Array:
    """Covariance (8, 8) px^2 of corners that are intersections of lines.

    Both ends of a line share the error at its middle, and its turn moves them in opposite directions.

    Args:
        corners: (4, 2) px.
        middle: variance of each side at its middle, (4,) px^2.
        shift: covariance of a further shift of the sides, (4, 4) px^2.
    """
    by_shift = np.stack([moved_outwards(corners, one) - corners for one in np.eye(4)], axis=-1)
    last = np.roll(np.eye(4), 1, axis=0)[:, None]  # corner k + 1 ends side k, which starts at corner k
    by_turn = (by_shift * (2.0 * last - 1.0)).reshape(8, 4)
    by_shift = by_shift.reshape(8, 4)
    lines, turns = np.diag(middle), np.diag(BY_TURN * middle)
    return np.asarray(by_shift @ (lines + shift) @ by_shift.T + by_turn @ turns @ by_turn.T)


def _lines_start(grey: Image, rough_px: Array, modules: int) -> Array:
    """Corners to look for border lines at: profiles of small markers are too short for the error of rough corners."""
    small = PROFILE_PART * shortest_side(rough_px) / modules < LEAST_HALF_PX
    return _subpix(grey, rough_px, modules) if small and _inside(rough_px, grey) else rough_px


def _subpix(grey: Image, rough_px: Array, modules: int) -> Array:
    """Corners by OpenCV, (4, 2) px."""
    corners = np.ascontiguousarray(rough_px[:, None], dtype=np.float32)
    half = int(np.clip(_SUBPIX_PART * shortest_side(rough_px) / modules, *_SUBPIX_HALF_PX))
    cv2.cornerSubPix(grey, corners, (half, half), (-1, -1), _SUBPIX_STOP)
    return corners.reshape(4, 2).astype(float)


def shortest_side(corners_px: Array) -> float:
    """Length of the shortest side of a marker (4, 2), px."""
    return float(np.linalg.norm(np.roll(corners_px, -1, axis=0) - corners_px, axis=-1).min())


def _inside(corners_px: Array, grey: Image) -> bool:
    """Whether the widest windows of `cornerSubPix` are inside: clipped ones give corners that are pixels off."""
    edge = _SUBPIX_HALF_PX[1] + 1.0
    return bool((corners_px >= edge).all() and (corners_px <= np.array(grey.shape[::-1]) - 1.0 - edge).all())


@lru_cache(maxsize=256)
def _bits(dictionary: str, marker_id: int) -> npt.NDArray[np.uint8]:
    """The code of a marker (n, n), 1 is white."""
    known = _detector(dictionary).getDictionary()
    return np.asarray(known.getBitsFromByteList(known.bytesList[marker_id : marker_id + 1], known.markerSize))


@lru_cache(maxsize=4)
def _detector(dictionary: str) -> cv2.aruco.ArucoDetector:
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_NONE
    # by default a marker and its white border are one candidate, which is lost if the image cuts the border off
    parameters.minMarkerDistanceRate = 0.05
    parameters.minDistanceToBorder = 0  # boards fill the view; the border lines reject cut markers
    return cv2.aruco.ArucoDetector(predefined(dictionary), parameters)
