"""The NAO paper's figures 4 and 5: residuals before and after, and the board drawn back into its image."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from arm.se3 import Array
from vision.camera.model import Image
from vision.drawing import Colour, Pen

_SIDE, _LEFT, _TOP, _BELOW = 420, 70, 40, 50
_INK, _PALE = (40, 40, 40), (215, 215, 215)
_OF_LEG: Mapping[str, Colour] = {"L": (180, 110, 20), "R": (30, 60, 220)}
_BEFORE, _AFTER = (40, 40, 230), (60, 170, 30)


@dataclass(frozen=True, eq=False)
class Cloud:
    """Residuals of one picture.

    Attributes:
        title: above it.
        residuals: (n, 2) px of each leg, by its side.
    """

    title: str
    residuals: Mapping[str, Array]


def residual_figure(clouds: Sequence[Cloud]) -> Image:
    """Residuals in x and y, two pictures a row, each with its own scale, as the paper's figure 4."""
    panels = [_panel(c) for c in clouds]
    rows = [np.hstack(panels[i : i + 2]) for i in range(0, len(panels) - 1, 2)]
    return np.vstack(rows)


def board_figure(image: Image, seen: Array, before: Array, after: Array) -> Image:
    """A board in its image with vertices (24, 2) px as projected before and after a calibration, side by side."""
    pictures = []
    for words, projected, colour in (
        ("(a) before", before, _BEFORE),
        ("(b) after", after, _AFTER),
    ):
        picture = np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
        pen = Pen(picture)
        grid = projected.reshape(4, 6, 2)
        for line in (*grid, *grid.transpose(1, 0, 2)):
            for a, b in pairwise(line):
                pen.outline(np.stack([a, b]), colour)
        for vertex, found in zip(projected, seen, strict=True):
            pen.outline(np.stack([vertex, found]), (200, 120, 0))
        off = float(np.sqrt(np.mean(np.sum((projected - seen) ** 2, axis=1))))
        told = f"{words}: {off:.2f} px rms"
        cv2.putText(picture, told, (12, 26), cv2.FONT_HERSHEY_SIMPLEX, 0.6, colour, 2, cv2.LINE_AA)
        pictures.append(picture)
    return np.hstack(pictures)


def _panel(cloud: Cloud) -> Image:
    picture = np.full((_TOP + _SIDE + _BELOW, _LEFT + _SIDE + 20, 3), 255, dtype=np.uint8)
    together = np.concatenate(list(cloud.residuals.values()))
    tick = _tick(float(np.quantile(np.abs(together), 0.999)) * 1.1)
    reach = 3.0 * tick

    def place(x: float, y: float) -> tuple[int, int]:
        return (
            round(_LEFT + _SIDE * (0.5 + 0.5 * x / reach)),
            round(_TOP + _SIDE * (0.5 - 0.5 * y / reach)),
        )

    for k in range(-3, 4):
        at = k * tick
        cv2.line(picture, place(at, -reach), place(at, reach), _PALE, 1)
        cv2.line(picture, place(-reach, at), place(reach, at), _PALE, 1)
        _words(picture, f"{at:g}", (place(at, 0)[0] - 14, _TOP + _SIDE + 18))
        _words(picture, f"{at:g}", (_LEFT - 44, place(0, at)[1] + 5))
    cv2.rectangle(picture, place(-reach, reach), place(reach, -reach), _INK, 1)
    for side, residuals in cloud.residuals.items():
        for x, y in residuals:
            if max(abs(x), abs(y)) < reach:
                cv2.circle(picture, place(x, y), 1, _OF_LEG[side], -1, cv2.LINE_AA)
    std = np.nanstd(together, axis=0)
    _words(picture, f"{cloud.title}   std x {std[0]:.4g}  y {std[1]:.4g} px", (_LEFT, 24))
    _words(picture, "px   left leg: blue, right leg: red", (_LEFT, _TOP + _SIDE + 40))
    return picture


def _tick(reach: float) -> float:
    """A round third of a reach, px, not smaller."""
    third = max(reach, 1e-6) / 3.0
    power = 10.0 ** np.floor(np.log10(third))
    return float(next(m * power for m in (1.0, 2.0, 5.0, 10.0) if m * power >= third))


def _words(picture: Image, words: str, place: tuple[int, int]) -> None:
    cv2.putText(picture, words, place, cv2.FONT_HERSHEY_SIMPLEX, 0.45, _INK, 1, cv2.LINE_AA)
