"""Error budgets drawn over their board: 95 % ellipses of the cubes' offsets, and the room that they have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm.board import Board
from arm.se3 import apply
from cell.accuracy.insertion import PocketFit, percent
from cell.accuracy.placement import PlacementBudget
from vision.camera.model import Camera, Image
from vision.drawing import Pen
from vision.observation import Observation

MAGNIFIED = 10.0  # offsets and room, relative to the plate
INK, FAINT = (0, 120, 255), (200, 200, 200)  # BGR, in photographs
SPREAD = float(np.sqrt(5.991))  # standard deviations to the ellipse that holds 95 % in two dimensions


@dataclass(frozen=True)
class HoleMark:
    """A hole with the offset of the cube that is put into it, in mm of the board's frame and degrees.

    Attributes:
        x, y: centre of the hole.
        room: half width of the square in which a cube that is not rotated enters, magnified.
        long, short, angle: half axes of the 95 % ellipse, magnified, and the direction of the longer one.
        label, title: the insertion probability, and what the mark is.
    """

    x: float
    y: float
    room: float
    long: float
    short: float
    angle: float
    label: str
    title: str


@dataclass(frozen=True)
class BudgetPicture:
    """A board from above, y up: its name, its plate (x, y, width, height) mm, and the marks of its holes."""

    board: str
    plate: tuple[float, float, float, float]
    marks: tuple[HoleMark, ...]


def budget_picture(board: Board, budgets: Sequence[PlacementBudget], fit: PocketFit) -> BudgetPicture:
    """Return the picture of the budgets of placements on one board."""
    size = 1e3 * np.array(board.plate.size[:2])
    x, y = 1e3 * np.array(board.plate.centre) - size / 2.0
    marks = tuple(_mark(board, b, fit) for b in budgets if b.target.rpartition("/")[0] == board.name)
    return BudgetPicture(board.name, (float(x), float(y), float(size[0]), float(size[1])), marks)


def budget_pictures(
    boards: Sequence[Board], budgets: Sequence[PlacementBudget], fit: PocketFit
) -> list[BudgetPicture]:
    """Return a picture of each board that a cube is put into."""
    pictures = (budget_picture(board, budgets, fit) for board in boards)
    return [picture for picture in pictures if picture.marks]


def drawn_over(
    picture: Image, camera: Camera, seen: Observation, budgets: Sequence[PlacementBudget], fit: PocketFit
) -> Image:
    """Draw the same ellipses, squares and probabilities over the holes in a photograph, and return it.

    Args:
        picture: BGR (h, w, 3), drawn on in place.
        camera: that took it.
        seen: with the poses of the boards.
        budgets: of the placements.
        fit: sizes of cube and pocket.
    """
    pen, holes = Pen(picture), {hole.name: hole for pose in seen.poses for hole in pose.holes}
    circle = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    square = (
        MAGNIFIED
        * (fit.mouth - fit.cube)
        / 2.0
        * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    )
    for budget in budgets:
        values, vectors = np.linalg.eigh(budget.covariance[:2, :2])
        axes = MAGNIFIED * SPREAD * vectors * np.sqrt(np.maximum(values, 0.0))
        ellipse = np.column_stack([np.cos(circle), np.sin(circle)]) @ axes.T
        T_base_hole = holes[budget.target].T_base_hole
        for points, colour in ((square, FAINT), (ellipse, INK)):
            pen.outline(camera.project_base(apply(T_base_hole, np.pad(points, ((0, 0), (0, 1))))), colour)
        below = camera.project_base(apply(T_base_hole, [0.0, -0.8 * fit.mouth, 0.0]))
        pen.text(f"{percent(budget.insertion)} %", below, INK)
    return picture


def _mark(board: Board, budget: PlacementBudget, fit: PocketFit) -> HoleMark:
    x, y = 1e3 * board.holes[int(budget.target.rpartition("/")[2]) - 1][:2]
    values, vectors = np.linalg.eigh(budget.covariance[:2, :2])
    short, long = 1e3 * MAGNIFIED * SPREAD * np.sqrt(np.maximum(values, 0.0))
    return HoleMark(
        x=float(x),
        y=float(y),
        room=1e3 * MAGNIFIED * (fit.mouth - fit.cube) / 2.0,
        long=float(long),
        short=float(short),
        angle=float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1]))),
        label=f"{percent(budget.insertion)} %",
        title=f"{budget.cube} to {budget.target}: RMS offset {1e3 * budget.sideways:.2f} mm",
    )
