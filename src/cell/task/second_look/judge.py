"""Judge a second look: does the cube still enter its pocket as planned, where the target is now?

If both looks at the target agree, their mean is more certain than either. If they do not, the board has moved between
them, and only the second one counts. Then the probability that the cube enters is that of the error budget for this
pose: with the distance between the planned release and the pocket as it is now, and without it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.special import chdtri

from arm.numerics.products import mul
from arm.plan_file import Plan
from arm.poses import BoardPose
from arm.se3 import Array, frozen, inverse, rotation, rotation_vector, transform
from cell.accuracy.error_model import ErrorModel
from cell.accuracy.insertion import insertion_probability, percent
from cell.accuracy.measures import averaged, noisier_by
from cell.accuracy.placement import Transfer, gripper_positions, hole_of, placement_error
from cell.accuracy.plan_budgets import plan_budgets, pocket_fit
from cell.config.cell import Cell
from cell.files.board_shift import BoardShift, board_shift
from cell.scene.displaced import BESIDE
from vision.observation import Observation

CHANCE = 1e-3  # that looks at a board that has not moved differ so much that it counts as moved
UNEVEN = 2e-3  # m along the plate's normal by which a release may be off: its funnel is that much deeper


@dataclass(frozen=True, eq=False)
class Judgement:
    """What a second look says of a placement.

    Attributes:
        pose: of the target board, as far as both looks tell.
        shift: of the board from where the plan has it.
        moved: whether that is more than two looks at a board at rest differ by.
        planned: probability that the cube enters, released as planned; None in a cell whose errors are unknown.
        corrected: the same, released where the pocket is now.
        enters: whether the cube may be released as planned.
        worth: whether the last part may be planned again for where the pocket is now.
    """

    pose: BoardPose
    shift: BoardShift
    moved: bool
    planned: float | None
    corrected: float | None
    enters: bool
    worth: bool

    def words(self) -> str:
        """What was found, in words."""
        name = self.pose.board.name
        found = f"board {name} {'has moved by' if self.moved else 'is off by'} {self.shift}"
        if self.planned is None or self.corrected is None:
            return found
        return (
            f"{found}: the cube enters with {percent(self.planned)} % as planned, with {percent(self.corrected)} % "
            "where the pocket is now"
        )


def second_look_helps(cell: Cell, seen: Observation, plan: Plan) -> frozenset[str]:
    """Return the cubes that are not certain to enter by one look; none if a second look at their targets would not do.

    Args:
        cell: with a calibration.
        seen: look that the plan was made from.
        plan: of a task of this cell.
    """
    least, budgets = cell.least_insertion, plan_budgets(cell, seen, plan)
    uncertain = [budget for budget in budgets if budget.insertion < least]
    targets = {budget.target.rpartition("/")[0] for budget in uncertain}
    share = noisier_by(cell.photographs) / 2.0
    boards = tuple(averaged(b, share) if b.name in targets else b for b in seen.boards)
    then = plan_budgets(cell, replace(seen, boards=boards), plan)
    helps = all(budget.insertion >= least for budget in then)
    return frozenset(budget.cube for budget in uncertain) if helps else frozenset()


def judge(
    cell: Cell, plan: Plan, number: int, before: Observation, after: BoardPose, planned: BoardPose
) -> Judgement:
    """Judge a second look.

    Args:
        cell, plan: of the placement.
        number: of the cube in the plan.
        before: look that the plan was made from.
        after: pose of the target board by the second look.
        planned: its pose by `before`.
    """
    moved = _moved(planned, after)
    pose = after if moved else mean_pose(planned, after)
    size = cell.cube_size
    shift = board_shift(pose.board, size, planned.T_base_board, pose.T_base_board)
    near = shift.farthest <= cell.second_look_height
    if not ErrorModel.available(cell):
        return Judgement(pose, shift, moved, None, None, not shift.beyond(cell), near)
    model = ErrorModel.of(cell)
    of = partial(_probability, cell, model, plan, number, before, pose)
    hole = int(plan.task["cubes"][number]["to"].rpartition("/")[2]) - 1
    now, then = (mul(p.T_base_board, p.board.T_board_hole(hole)) for p in (pose, planned))
    off = _twist(mul(inverse(now), then))
    as_planned, corrected = of(off), of(None)
    least = cell.least_insertion
    enters = as_planned >= least and abs(float(off[2])) <= UNEVEN
    return Judgement(pose, shift, moved, as_planned, corrected, enters, corrected >= least and near)


def mean_pose(one: BoardPose, other: BoardPose) -> BoardPose:
    """The mean of two looks at a board at rest, weighted by what is drawn anew in each; they share the rest."""
    if one.repeatability is None or other.repeatability is None:
        return other
    first, second = np.linalg.pinv(one.repeatability), np.linalg.pinv(other.repeatability)
    repeatability = np.linalg.pinv(first + second)
    twist = mul(repeatability, mul(second, _difference(one, other)))
    covariance = one.covariance - one.repeatability + repeatability
    T = mul(one.T_base_board, transform(rotation(twist[3:]), twist[:3]))
    return replace(
        one, T_base_board=frozen(T), covariance=frozen(covariance), repeatability=frozen(repeatability)
    )


def _moved(one: BoardPose, other: BoardPose) -> bool:
    """Whether the poses differ by more than two looks at a board at rest do."""
    both = [p.covariance if p.repeatability is None else p.repeatability for p in (one, other)]
    twist = _difference(one, other)
    squared = float(twist @ np.linalg.pinv(both[0] + both[1]) @ twist)
    return squared > float(chdtri(len(twist), CHANCE))


def _difference(one: BoardPose, other: BoardPose) -> Array:
    """Twist (6,) in the board's frame from one pose to the other."""
    return _twist(mul(inverse(one.T_base_board), other.T_base_board))


def _twist(T: Array) -> Array:
    """Twist (6,) of a small motion, translation first."""
    return np.concatenate([T[:3, 3], rotation_vector(T[:3, :3])])


def _probability(
    cell: Cell,
    model: ErrorModel,
    plan: Plan,
    number: int,
    before: Observation,
    pose: BoardPose,
    off: Array | None,
) -> float:
    """Probability that a cube enters its pocket, released `off` (6,) in the hole's frame.

    A cube that was taken from beside a hole was located relative to that board, like the hole.
    """
    cube, at = plan.task["cubes"][number], gripper_positions(cell, plan)
    then = {p.board.name: model.board(p) for p in before.poses}
    source = hole_of(then, cube["from"].removeprefix(BESIDE))
    target = hole_of({pose.board.name: model.board(pose)}, cube["to"])
    if source is None or target is None:
        return 0.0
    transfer = Transfer(cube["cube"], source, target, at[number, "close"], at[number, "open"])
    covariance = placement_error(model, transfer).covariance
    return insertion_probability(covariance, pocket_fit(cell), off)
