"""Poses of a tool along an outline: its position on it, its z axis along it or fixed, and no needless turn about z."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.errors import InputError
from arm.numerics.angles import arctan2
from arm.numerics.products import mul, norm
from arm.se3 import Array, cross, frozen, rot_z
from cell.program.outline import Outline

CHORD_ERROR = 5e-6  # m; largest distance of a path from the chords between its poses
LONGEST = 5e-3  # m, between poses
TURN = np.radians(1.0)  # largest change of the z axis between poses, rad
_NARROWEST = 1e-3  # of a window; a shorter chord across it has no direction


@dataclass(frozen=True, eq=False)
class PathPoses:
    """Poses along a path.

    Attributes:
        s: (m,), arc lengths, ascending from 0, m.
        T_work_tool: (m, 4, 4), the tool in the frame of the workpiece.
        stops: arc lengths of the corners at which the arm must stop, m.
    """

    s: Array
    T_work_tool: Array
    stops: Array


def smoothed_directions(outline: Outline, s: Array, window: float) -> Array:
    """Return unit directions (m, 3) at arc lengths (m,): of the chord from `window` before to `window` after, m.

    Further than that from corners of lines they are the lines' directions. The turn at a corner is spread over it.

    Raises:
        InputError: the outline comes back to where it was within the window.
    """
    if window <= 0.0:
        return outline.directions(s)
    chords = outline.at(s + window) - outline.at(s - window)
    lengths = np.sqrt((chords * chords).sum(axis=1))
    if lengths.min() < _NARROWEST * window:
        place = float(s[np.argmin(lengths)])
        why = (
            f"the path turns back on itself at {1e3 * place:.0f} mm, within {1e3 * window:g} mm of its length"
        )
        raise InputError(f"{why}; give a shorter window_mm, or an axis", at=place, window=window)
    return np.asarray(chords / lengths[:, None])


def transported(z: Array, x: Array) -> Array:
    """Return rotations (m, 3, 3) whose z axes are `z` (m, 3), each turned from the one before by the least angle.

    Args:
        z: unit vectors.
        x: (3,), whose part normal to the first z axis is the direction of the first x axis.

    Raises:
        InputError: it has no such part, or a z axis is opposite to the one before.
    """
    x = x - mul(x, z[0]) * z[0]
    if norm(x) < 1e-9:
        raise InputError("transported: x is parallel to the first z axis", x=x.tolist())
    axes = np.empty((len(z), 3))
    axes[0] = x / norm(x)
    for k in range(1, len(z)):
        both = 1.0 + float(mul(z[k - 1], z[k]))
        if both < 1e-9:
            raise InputError("transported: a z axis turns by 180 deg at once", index=k)
        # the rotation by the least angle maps a vector v normal to z to v - (v . z') / (1 + z . z') (z + z')
        turned = axes[k - 1] - float(mul(axes[k - 1], z[k])) / both * (z[k - 1] + z[k])
        turned = turned - float(mul(turned, z[k])) * z[k]
        axes[k] = turned / norm(turned)
    return np.stack([axes, cross(z, axes), z], axis=2)


def first_x(z: Array) -> Array:
    """Return the axis of the workpiece that is taken for the tool's x axis: x, or y if z (3,) is nearly along x."""
    return np.array([1.0, 0.0, 0.0]) if abs(float(z[0])) < 0.9 else np.array([0.0, 1.0, 0.0])


def poses_along(
    outline: Outline, axis: Array | None, sign: float = 1.0, window: float = 0.0, turn: float = 0.0
) -> PathPoses:
    """Return the poses of a tool along an outline.

    Args:
        outline: of the tool's origin, in the frame of the workpiece.
        axis: (3,), unit direction of the tool's z axis in the frame of the workpiece; None: along the outline.
        sign: 1 or -1: whether z points along the outline or against it, if `axis` is None.
        window: see `smoothed_directions`.
        turn: of the tool about its z axis, at the start from `first_x`, rad.

    Raises:
        InputError: see `smoothed_directions`; or the direction jumps at a corner and there is no window.
    """
    corners = outline.corners()
    s = outline.sampled(CHORD_ERROR, LONGEST)
    if axis is not None:
        z = np.broadcast_to(axis, (len(s), 3))
    else:
        if window <= 0.0 and len(corners):
            why = f"the path has a corner at {1e3 * corners[0]:.0f} mm, where a tool along it cannot turn at once"
            raise InputError(f"{why}; give window_mm", at=float(corners[0]))
        s = _fine(outline, _with_windows(outline, s, window), window)
        z = sign * smoothed_directions(outline, s, window)
    R = mul(transported(z, first_x(z[0])), rot_z(turn))
    T = np.tile(np.eye(4), (len(s), 1, 1))
    T[:, :3, :3], T[:, :3, 3] = R, outline.at(s)
    return PathPoses(frozen(s), frozen(T), frozen(corners))


def _with_windows(outline: Outline, s: Array, window: float) -> Array:
    """Add the arc lengths at which the turning of the direction begins and ends."""
    joints = outline.joints
    more = np.concatenate([joints - window, joints + window])
    both = np.concatenate([s, more[(more > 0.0) & (more < outline.length)]])
    both = np.unique(np.round(both, 9))
    both[-1] = outline.length
    return both


def _fine(outline: Outline, s: Array, window: float) -> Array:
    """Halve intervals until the direction changes by at most `TURN` in each."""
    while True:
        z = smoothed_directions(outline, s, window)
        turned = arctan2(np.sqrt((cross(z[:-1], z[1:]) ** 2).sum(axis=1)), (z[:-1] * z[1:]).sum(axis=1))
        wide = (turned > TURN) & (np.diff(s) > 1e-6)
        if not wide.any():
            return s
        s = np.sort(np.concatenate([s, (s[:-1][wide] + s[1:][wide]) / 2.0]))
