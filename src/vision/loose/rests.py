"""How a cube can rest at a place: prior knowledge of its pose from its contacts with plate and pocket.

Each rest predicts quantities of a pose in the frame of the place, with standard deviations:

- flat on the plane of the place, anywhere, at any yaw;
- upright in the pocket, aligned with it, at any height from its seat to the plane;
- leaning in the pocket: one lower edge in its seat against a wall, the opposite side raised, in four directions;
- wedged in the pocket, in four directions: one lower edge as deep as a seated cube's, where the two walls at its ends
  hold it, and the opposite part of the bottom on the rim. So does a cube come to rest that was released beside its
  pocket.

A free cube has only weak priors; the image alone determines its pose.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from arm.board import POCKET_DEPTH, seat_depth
from arm.se3 import Array

CONTACT = 0.5e-3  # m, standard deviation of the height of a contact: plate's pose, dirt, rounded edges
FLAT_TILT = np.radians(0.6)  # standard deviation of the tilt of a cube that lies flat
UPRIGHT_TILT = np.radians(1.0)  # the same in a pocket
POCKET_YAW = np.radians(2.5)
ASIDE = 1.0e-3  # m, standard deviation along the walls that a cube does not touch
CENTRED = (
    0.2e-3  # m, standard deviation of a seated cube's place: tolerances of the pocket and of the place's pose
)
PLAY = 0.6  # that of a higher one, in clearances of the pocket at that height
LIFT = (3.5e-3, 2.5e-3)  # m, mean and standard deviation of the height of an upright cube above its seat
LEAN = (np.radians(8.0), np.radians(2.0))  # mean and standard deviation of the tilt of a leaning cube
SEAT = 0.7e-3  # m, standard deviation of the depth of a leaning or wedged cube's lower edge
WALL = 0.5e-3  # m, standard deviation of a leaning cube's lower edge from its wall
# the same of a wedged cube along its edge, and of its tilt about the direction across: one that was released off both
# axes of its pocket is raised at one end of the edge, too
WEDGED_ASIDE, WEDGED_TILT = 1.5e-3, np.radians(2.0)
EDGE = (12e-3, 4e-3)  # m, mean and standard deviation of a wedged cube's lower edge from the hole's axis
RIM = np.radians(0.7)  # standard deviation of its tilt from that with its bottom on the rim
ANYWHERE = 40e-3  # m, standard deviation of a cube's place on the plane
LEAST_LEAN, MOST_LEAN = np.radians(3.0), np.radians(15.0)  # limits of the tilt of a leaning cube
LEAST_WEDGED, MOST_WEDGED = np.radians(11.0), np.radians(17.0)  # of a wedged one
MOST_POCKET_YAW = np.radians(7.0)  # of a cube in a pocket
MOST_LIFT = 9e-3  # m, of an upright cube in a pocket
SLACK = 0.7e-3  # m, by which a cube may be beyond its limits on the plane
USUAL_TILT = {"leaning": LEAN[0], "wedged": np.radians(13.5)}
FREE_TILT, FREE_HEIGHT = np.radians(10.0), 8e-3

Kind = Literal["flat", "upright", "leaning", "wedged", "free"]
DIRECTIONS = ((0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0))


@dataclass(frozen=True)
class Rest:
    """A way to rest.

    Attributes:
        kind: see the module.
        towards: direction in which a leaning or wedged cube's lower edge lies from the hole's axis, unit vector.
    """

    kind: Kind
    towards: tuple[float, float] = (0.0, 0.0)


def rests(pocket: tuple[float, float] | None) -> list[Rest]:
    """All ways to rest at a place; `pocket`: widths of its mouth and floor, m, or None for a plane."""
    flat = [Rest("flat")]
    if pocket is None:
        return flat
    kinds: tuple[Kind, ...] = ("leaning", "wedged")
    return [*flat, Rest("upright"), *(Rest(kind, towards) for kind in kinds for towards in DIRECTIONS)]


def usual_normal(rest: Rest) -> Array:
    """Usual normal of the top of a cube at a rest, (3,) in the frame of the place."""
    tilt = USUAL_TILT.get(rest.kind, 0.0)
    return np.array([np.sin(tilt) * rest.towards[0], np.sin(tilt) * rest.towards[1], np.cos(tilt)])


def prior(rest: Rest, T_place_cube: Array, size: float, pocket: tuple[float, float] | None) -> Array:
    """Deviations of a pose from a rest, each divided by its standard deviation, (6,).

    Args:
        rest: a way to rest.
        T_place_cube: pose of the cube in the frame of the place, z of the cube near that of the place, yaw within
            45 degrees of the place's.
        size: edge of the cube, m.
        pocket: widths of mouth and floor, m.
    """
    x, y, z = T_place_cube[:3, 3]
    nx, ny = T_place_cube[:2, 2]
    yaw = _yaw(T_place_cube)
    half = size / 2.0
    if rest.kind == "free":
        height = (z - half + 3e-3) / FREE_HEIGHT
        return np.array([x / ANYWHERE, y / ANYWHERE, height, nx / FREE_TILT, ny / FREE_TILT, 0.0])
    if rest.kind == "flat" or pocket is None:
        return np.array(
            [x / ANYWHERE, y / ANYWHERE, (z - half) / CONTACT, nx / FLAT_TILT, ny / FLAT_TILT, 0.0]
        )
    depth, slope = seat_depth(size, pocket), (pocket[0] - pocket[1]) / 2.0 / POCKET_DEPTH
    if rest.kind == "upright":
        lift = z - half + depth
        play = np.hypot(CENTRED, PLAY * slope * max(lift, 0.0))
        return np.array(
            [
                x / play,
                y / play,
                (lift - LIFT[0]) / LIFT[1],
                nx / UPRIGHT_TILT,
                ny / UPRIGHT_TILT,
                yaw / POCKET_YAW,
            ]
        )
    tx, ty = rest.towards
    # the lower edge nearest to the wall: the cube's axis that points there is one of +-x, +-y
    R = T_place_cube[:3, :3]
    axes = np.concatenate([R[:, 0], R[:, 1], -R[:, 0], -R[:, 1]]).reshape(4, 3)
    outward = axes[int(np.argmax(axes[:, 0] * tx + axes[:, 1] * ty))]
    edge = T_place_cube[:3, 3] + half * outward - half * R[:, 2]
    tilt, along = nx * tx + ny * ty, edge[0] * tx + edge[1] * ty
    aside, roll = ASIDE, UPRIGHT_TILT
    if rest.kind == "leaning":
        wall = pocket[0] / 2.0 + slope * edge[2]
        contacts = (along - wall) / WALL, (tilt - LEAN[0]) / LEAN[1]
    else:
        aside, roll = WEDGED_ASIDE, WEDGED_TILT
        on_rim = -edge[2] / max(pocket[0] / 2.0 + along, depth)  # slope of a bottom that touches the rim
        contacts = (along - EDGE[0]) / EDGE[1], (tilt - np.sin(np.arctan(on_rim))) / RIM
    return np.array(
        [
            *contacts,
            (x * ty - y * tx) / aside,
            (edge[2] + depth) / SEAT,
            (nx * ty - ny * tx) / roll,
            yaw / POCKET_YAW,
        ]
    )


def log_scale(rest: Rest, size: float, pocket: tuple[float, float] | None) -> float:
    """Logarithm of the product of a rest's standard deviations: the prior's volume, for comparisons of rests."""
    anywhere = 2.0 * np.log(ANYWHERE)
    any_yaw = np.log(np.pi / 2.0 / np.sqrt(2.0 * np.pi))
    if rest.kind == "free":
        return float(anywhere + np.log(FREE_HEIGHT) + 2.0 * np.log(FREE_TILT) + any_yaw)
    if rest.kind == "flat" or pocket is None:
        return float(anywhere + np.log(CONTACT) + 2.0 * np.log(FLAT_TILT) + any_yaw)
    if rest.kind == "upright":
        return float(2.0 * np.log(ASIDE) + np.log(LIFT[1]) + 2.0 * np.log(UPRIGHT_TILT) + np.log(POCKET_YAW))
    if rest.kind == "leaning":
        return float(np.log(WALL * LEAN[1] * ASIDE * SEAT * UPRIGHT_TILT * POCKET_YAW))
    return float(np.log(EDGE[1] * RIM * WEDGED_ASIDE * SEAT * WEDGED_TILT * POCKET_YAW))


def possible(rest: Rest, T_place_cube: Array, size: float, pocket: tuple[float, float] | None) -> bool:
    """Whether a cube can rest like that at a pose: limits that the priors, which have no ends, do not know.

    A flat cube must not be able to drop into the pocket or tip into it; one in the pocket is aligned with it.
    """
    if pocket is None:
        return True
    if rest.kind == "flat":
        return _is_carried(T_place_cube, size, pocket[0])
    x, y, z = T_place_cube[:3, 3]
    nx, ny = T_place_cube[:2, 2]
    if abs(_yaw(T_place_cube)) > MOST_POCKET_YAW:
        return False
    if rest.kind == "upright":
        lift = z - size / 2.0 + seat_depth(size, pocket)
        play = (pocket[0] - size) / 2.0 + SLACK
        return bool(
            max(abs(x), abs(y)) < play and np.hypot(nx, ny) < LEAST_LEAN and -LIFT[1] < lift < MOST_LIFT
        )
    least, most = (LEAST_WEDGED, MOST_WEDGED) if rest.kind == "wedged" else (LEAST_LEAN, MOST_LEAN)
    return bool(least <= nx * rest.towards[0] + ny * rest.towards[1] <= most)


def _is_carried(T_place_cube: Array, size: float, mouth: float) -> bool:
    """Whether the plate around a mouth carries a flat cube: its centre is over the hull of what rests on the plate."""
    along = np.linspace(-size / 2.0, size / 2.0, 41)
    base = np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2)
    t = T_place_cube[:2, 3]
    points = base @ T_place_cube[:2, :2].T + t
    carried = points[(np.abs(points) >= mouth / 2.0).any(axis=1)]
    if len(carried) < 3:
        return False
    angles = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return bool(((carried - t) @ directions.T).max(axis=0).min() > -SLACK)


def _yaw(T_place_cube: Array) -> float:
    """Yaw of a cube, modulo 90 degrees, from -45 to 45, rad."""
    yaw = float(np.arctan2(T_place_cube[1, 0] - T_place_cube[0, 1], T_place_cube[0, 0] + T_place_cube[1, 1]))
    return (yaw + np.pi / 4.0) % (np.pi / 2.0) - np.pi / 4.0
