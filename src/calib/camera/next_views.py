"""Propose the next views of a target: the information of a candidate view is known before it is taken."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np

from arm.se3 import Array, rot_z, rotation, transform
from calib.camera.bundle_adjustment import view_equations
from calib.model.optimal_design import OptimalDesign
from vision.camera.model import Camera
from vision.camera.projection import Projection
from vision.targets.target import Target

TILT = np.radians(35.0)
TURNED = 8  # tilt directions
MARGIN_PX = 8.0
LEAST_SEEN = 0.5  # fraction of the corners that must be in the image
_ACROSS = ("left", "", "right")
_DOWN = ("upper", "", "lower")
_NEARER = ("right", "lower right", "lower", "lower left", "left", "upper left", "upper", "upper right")


@dataclass(frozen=True, eq=False)
class NextView:
    """A view worth taking.

    Attributes:
        T_camera_target: pose of the target.
        words: the same in words.
        gain: relative reduction of the error at the work points, 0 to 1.
        information: (9, 9) that it adds.
    """

    T_camera_target: Array
    words: str
    gain: float
    information: Array


def next_views(
    camera: Camera, target: Target, information: Array, worth: Array, near: float, far: float, count: int = 3
) -> list[NextView]:
    """Choose the `count` best next views greedily.

    Args:
        camera: current estimate.
        target: the target.
        information: (9, 9) of the views so far and the prior, for corner errors of 1 px.
        worth: weights of the errors, see `calib.camera.working_volume.WorkingVolume.worth`.
        near, far: range of distances for the target, m.
    """
    candidates = _candidates(camera, target, near, far)
    if not candidates:
        return []
    design = OptimalDesign(np.array([c.information for c in candidates]), information, worth)
    best = design.best(count, exchange=False)
    return [
        replace(candidates[place], gain=1.0 - float(np.sqrt(after / before)))
        for place, (before, after) in zip(best.places, pairwise((best.before, *best.variances)), strict=True)
    ]


def _candidates(camera: Camera, target: Target, near: float, far: float) -> list[NextView]:
    middle = np.array([*target.size, 0.0]) / 2.0
    points = target.points()
    found = []
    last = np.array(camera.size) - 1.0 - MARGIN_PX
    # the target's long side is parallel to that of the image
    aligned = (camera.size[0] >= camera.size[1]) == (target.size[0] >= target.size[1])
    in_plane = rot_z(0.0 if aligned else np.pi / 2.0)
    aims = (np.array(list(product(range(3), range(3)))) * 0.3 + 0.2) * np.array(camera.size)
    rays = camera.rays(aims)
    places = product(range(3), range(3), (near, far), range(-1, TURNED))
    for column, row, z, turned in places:
        ray = rays[3 * column + row]
        if not np.isfinite(ray).all():
            continue
        angle = 2.0 * np.pi * turned / TURNED
        # rotating about this axis brings the edge in direction `angle` of the image nearer
        axis = np.array([-np.sin(angle), np.cos(angle), 0.0])
        R = rotation(TILT * axis if turned >= 0 else np.zeros(3)) @ in_plane
        T = transform(R, z * ray - R @ middle)
        pixels = Projection(camera, T, points).pixels
        inside = ((pixels >= MARGIN_PX) & (pixels <= last)).all(axis=1)
        if inside.mean() < LEAST_SEEN:
            continue
        information = view_equations(camera, T, points[inside]).S
        found.append(NextView(T, _words(column, row, z, turned), 0.0, information))
    return found


def _words(column: int, row: int, z: float, turned: int) -> str:
    place = " ".join(w for w in (_DOWN[row], _ACROSS[column]) if w)
    where = f"in the {place} part of the image" if place else "in the middle of the image"
    edge = f"its {_NEARER[turned]} edge" if turned % 2 == 0 else f"its {_NEARER[turned]} corner"
    tilt = "facing the camera" if turned < 0 else f"tilted {np.degrees(TILT):.0f} deg, {edge} nearer"
    return f"{where}, {1e3 * z:.0f} mm away, {tilt}"
