"""Functions of all readers of recorded images: target points, image points, repeated images, numeric failures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from scipy.spatial import KDTree

from arm.errors import CalibrationRefused
from arm.former import former_names
from arm.io.node import Node
from arm.io.rules import numbers
from arm.se3 import Array

SAME_READING, SAME_POINT = 1e-6, 1e-3  # rad and px: closer than any arm and noise repeat
_UNSEEN = -1e6  # px
_LONGEST = 10.0  # m, of the parts of an arm and its targets; in mm even small ones are longer
_SMALLEST = 4.0  # px between points of a target that can be found in an image
_ON_A_LINE = 1e-3  # smallest ratio of a target's width to its length


def metres(node: Node, shape: int | tuple[int | None, ...] | None) -> Array:
    """Read lengths in m of an arm or a target; a length in mm is told.

    Args:
        node: a list of them.
        shape: see `arm.io.rules.numbers`.

    Raises:
        InputError: not numbers of this shape, or longer than any arm.
    """
    found = node.read(numbers(shape))
    if np.abs(found).max() > _LONGEST:
        raise node.error(f"must be within {_LONGEST:g} m", "are these mm?")
    return found


def target_points(node: Node, fewest: int, called: str) -> Array:
    """Read the points of a target, (n, 3) m.

    Args:
        node: list of the points.
        fewest: smallest number of points.
        called: name of the points in the file.

    Raises:
        InputError: too few points, or all on one line, which does not determine a pose; or they are in mm.
    """
    points = metres(node, (None, 3))
    _require_spread(node, points, fewest, called)
    return points


def _require_spread(node: Node, points: Array, fewest: int, called: str, only: str = "") -> None:
    if len(points) < fewest:
        raise node.error(f"must have at least {fewest} {called}{only}")
    if on_a_line(points, _ON_A_LINE):
        raise node.error(f"must have {called} that do not all lie on one line")


def on_a_line(points: Array, thinnest: float) -> bool:
    """Whether the ratio of width to length of points (n, 2 or 3) is `thinnest` at most."""
    length, width = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[:2]
    return not width > thinnest * length


def seen_points(node: Node, count: int, fewest: int, called: str) -> Array:
    """Read the points of one image, (count, 2) px, NaN where one was not detected (null).

    Args:
        node: list of the points.
        count: number of the target's points.
        fewest: smallest number of detected points.
        called: name of the points in the file.

    Raises:
        InputError: not `count` points, too few detected ones, or all of these on one line.
    """
    pixels = node.read(numbers((count, 2), gaps=True)).copy()
    pixels[np.isnan(pixels).any(axis=1)] = np.nan
    seen = pixels[np.isfinite(pixels[:, 0])]
    _require_spread(node, seen, fewest, called, " that are not null")
    if (wide := float(np.ptp(seen, axis=0).max())) < _SMALLEST:
        rule = f"must be {_SMALLEST:g} px or more apart, and all {called} are within {wide:.2g} px"
        raise node.error(rule, "are they fractions of the image's size?")
    return pixels


def refuse_repeats(images: Sequence[Node], readings: Array, pixels: Array) -> None:
    """Refuse repeated images, whose noise does not average out.

    The same readings alone are not a repeat, because an arm may rest for two images. Neither are the same points alone,
    because the second image may be wrong; the fit rejects such images.

    Args:
        images: nodes in the file.
        readings: of each, (n, joints).
        pixels: of each, (n, m, 2), NaN where a point was not detected.

    Raises:
        InputError: an image has the readings and the points of an earlier one.
    """
    points = np.nan_to_num(pixels.reshape(len(pixels), -1), nan=_UNSEEN)
    contents = np.column_stack([readings / SAME_READING, points / SAME_POINT])
    repeats = KDTree(contents).query_pairs(1.0, p=np.inf)
    if repeats:
        first, again = min(map(sorted, repeats), key=lambda pair: pair[1])
        raise images[again].error(
            f"repeats {images[first].key}: joints and points are the same; remove one of them"
        )


@contextmanager
def plausible_numbers() -> Iterator[None]:
    """Let a fit overflow on implausible numbers, and refuse them if it fails.

    Raises:
        CalibrationRefused: a matrix could not be factored.
    """
    try:
        with np.errstate(all="ignore"):
            yield
    except np.linalg.LinAlgError as error:
        raise CalibrationRefused(
            f"the recording's numbers fit no arm and camera ({error}): are lengths in m, angles in the unit named by "
            "their key, and image points in px?",
            reason="numbers",
        ) from error


former_names(__name__, __name__, numbers_of_this_world="plausible_numbers")
