"""The error budget of a placement: where a cube that is taken from one hole is when the jaws open over another.

The cube is taken where it is, the jaws centre it between their fingers and align it with them, and the arm carries it
to where the target is thought to be. Errors that are the same at both holes cancel in part: along the fingers, the
cube is as far off in the jaws as the arm was from the cube.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from arm.numerics.products import mul
from arm.plan_file import GripperStep, Move, Plan
from arm.poses import adjoint
from arm.se3 import Array, inverse
from cell.accuracy.error_model import BoardError, ErrorModel
from cell.accuracy.insertion import PocketFit, insertion_probability
from cell.accuracy.linear_error import LinearError
from cell.config.cell import Cell

GRIP_PROJECTION = np.diag([1.0, 0.0, 1.0, 0.0, 1.0, 0.0])
"""What jaws that move along the tool's y axis leave of a cube's twist in the tool's frame."""


@dataclass(frozen=True, eq=False)
class Source:
    """What one source contributes.

    Attributes:
        sideways: standard deviation if it erred alone: root of the summed variances in the plate's plane, m.
        part: its part of that variance, with half of its correlations; all parts add up to 1. Negative if it cancels
            others.
    """

    sideways: float
    share: float


@dataclass(frozen=True, eq=False)
class PlacementBudget:
    """Predicted error of a cube in its target hole, at the plate's top.

    Attributes:
        cube, source, target: names of the cube and of its holes.
        covariance: of its twist in the target hole's frame, (6, 6).
        sources: the one with the largest share first.
        insertion: probability that it enters its pocket.
    """

    cube: str
    source: str
    target: str
    covariance: Array
    sources: Mapping[str, Source]
    insertion: float

    @property
    def sideways(self) -> float:
        """RMS offset from the hole's axis: root of the summed variances in the plate's plane, m."""
        return _sideways(self.covariance)

    @property
    def height(self) -> float:
        """Standard deviation along the plate's normal, m."""
        return float(np.sqrt(self.covariance[2, 2]))

    @property
    def tilt(self) -> float:
        """Root of the summed variances about the axes in the plate's plane, rad."""
        return float(np.sqrt(np.trace(self.covariance[3:5, 3:5])))


@dataclass(frozen=True, eq=False)
class Transfer:
    """A cube's way: holes and the joint positions at which the jaws close and open.

    Attributes:
        cube: its name.
        source, target: board and index of the hole.
        q_grip, q_release: (6,) rad.
    """

    cube: str
    source: tuple[BoardError, int]
    target: tuple[BoardError, int]
    q_grip: Array
    q_release: Array


def placement_budget(model: ErrorModel, transfer: Transfer, fit: PocketFit) -> PlacementBudget:
    """Predict the error of one placement."""
    error = placement_error(model, transfer)
    covariance = error.covariance
    total = _sideways(covariance) ** 2
    found = {
        name: Source(_sideways(alone), float(np.trace(part[:2, :2])) / total)
        for name, (alone, part) in error.by_source().items()
    }
    ordered = dict(sorted(found.items(), key=lambda item: -item[1].share))
    source, target = (
        f"{board.pose.board.name}/{index + 1}" for board, index in (transfer.source, transfer.target)
    )
    return PlacementBudget(
        transfer.cube, source, target, covariance, ordered, insertion_probability(covariance, fit)
    )


def placement_error(model: ErrorModel, transfer: Transfer) -> LinearError:
    """Error of the released cube in the target hole's frame."""
    target, put_into = transfer.target
    T_base_target = mul(target.pose.T_base_board, target.pose.board.T_board_hole(put_into))
    held = grip_error(model, *transfer.source, transfer.q_grip)
    T_base_release = model.T_base_tool(transfer.q_release)
    released = model.tool_error(transfer.q_release) + held.transformed(adjoint(T_base_release))
    return (released - target.hole(put_into)).transformed(adjoint(inverse(T_base_target)))


def grip_error(model: ErrorModel, source: BoardError, taken_from: int, q_grip: Array) -> LinearError:
    """Error in the tool's frame of a cube that the jaws have closed on at joint positions q_grip (6,) rad."""
    apart = source.hole(taken_from) - model.tool_error(q_grip)
    return apart.transformed(GRIP_PROJECTION @ adjoint(inverse(model.T_base_tool(q_grip))))


def _sideways(covariance: Array) -> float:
    return float(np.sqrt(np.trace(covariance[:2, :2])))


def gripper_positions(cell: Cell, plan: Plan) -> dict[tuple[int, str], Array]:
    """Joint positions at which the jaws close on a cube and open, by its number and "close" or "open"."""
    found: dict[tuple[int, str], Array] = {}
    counts = plan.start
    for step in plan.steps:
        if isinstance(step, Move):
            counts = step.path.end
        elif isinstance(step, GripperStep) and step.cube is not None:
            found[step.cube, step.action] = cell.unit.positions(counts)
    return found


def hole_of(boards: Mapping[str, BoardError], name: str) -> tuple[BoardError, int] | None:
    """The board and index of a hole such as ``01-02/3``; None if it is no hole of a detected board."""
    board, _, number = name.rpartition("/")
    return (boards[board], int(number) - 1) if board in boards else None
