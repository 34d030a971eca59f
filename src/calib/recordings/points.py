"""What the readers of recorded images share: the points seen in an image, and that no image counts twice."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from scipy.spatial import KDTree

from arm.errors import CalibrationRefused
from arm.io.json_reader import JsonNode
from arm.se3 import Array

SAME_READING, SAME_POINT = 1e-6, 1e-3  # rad and px: no arm and no noise come back so near
_UNSEEN = -1e6  # px
_ON_A_LINE = 1e-3  # width of a target in its lengths


def target_points(node: JsonNode, fewest: int, called: str) -> Array:
    """Points of a target, (n, 3) m.

    Args:
        node: list of the points.
        fewest: that a target must have.
        called: what the file calls them.

    Raises:
        InputError: they are fewer, or lie on one line, from which no pose can be told.
    """
    points = node.numbers(None, 3)
    if len(points) < fewest:
        raise node.error(f"must be {fewest} {called} at least")
    if _on_a_line(points):
        raise node.error(f"must be {called} that do not all lie on one line")
    return points


def _on_a_line(points: Array) -> bool:
    length, width = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[:2]
    return not width > _ON_A_LINE * length


def seen_points(node: JsonNode, count: int, fewest: int, called: str) -> Array:
    """Points of one image, (count, 2) px, NaN where one was not seen (null).

    Args:
        node: list of the points.
        count: of the target's points.
        fewest: that must be seen.
        called: what the file calls them.

    Raises:
        InputError: they are not `count` points, too few were seen, or all of them on one line.
    """
    pixels = node.numbers(count, 2, gaps=True).copy()
    pixels[np.isnan(pixels).any(axis=1)] = np.nan
    seen = np.isfinite(pixels[:, 0])
    if seen.sum() < fewest:
        raise node.error(f"must hold {fewest} {called} at least that are not null")
    if _on_a_line(pixels[seen]):
        raise node.error(f"must hold {called} that do not all lie on one line")
    return pixels


def refuse_repeats(images: Sequence[JsonNode], readings: Array, pixels: Array) -> None:
    """See that no image is there twice: its noise would be taken for the average of two.

    The same readings alone are no repeat, for an arm may stand still for two images; nor are the same points alone,
    for they may be a wrong image's, which the fit leaves out.

    Args:
        images: as they stand in the file.
        readings: of each, (n, joints).
        pixels: of each, (n, m, 2), NaN where a point was not seen.

    Raises:
        InputError: an image has both the readings and the points of one before it.
    """
    points = np.nan_to_num(pixels.reshape(len(pixels), -1), nan=_UNSEEN)
    contents = np.column_stack([readings / SAME_READING, points / SAME_POINT])
    repeats = KDTree(contents).query_pairs(1.0, p=np.inf)
    if repeats:
        first, again = min(map(sorted, repeats), key=lambda pair: pair[1])
        raise images[again].error(
            f"repeats {images[first].key}, joints and points alike; leave one of them out"
        )


@contextmanager
def numbers_of_this_world() -> Iterator[None]:
    """A fit may overflow on numbers that no arm has; where that leads nowhere, they are refused.

    Raises:
        CalibrationRefused: a matrix could not be factored.
    """
    try:
        with np.errstate(all="ignore"):
            yield
    except np.linalg.LinAlgError as error:
        raise CalibrationRefused(
            f"the recording's numbers fit no arm and camera ({error}): are lengths in m, angles in the unit that their "
            "key names, and images in px?",
            reason="numbers",
        ) from error
