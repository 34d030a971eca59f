"""A plan's steps between the moments at which the jaws act: what is executed at a time, cube by cube."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from arm.plan_file import GripperStep, LookStep, Move, Plan, Step


@dataclass(frozen=True)
class Visit:
    """The steps of one cube.

    Attributes:
        fetch: the moves to it, and the jaws closing.
        carry: the moves with it, and the jaws opening.
        leave: the moves away from where it was let go; one motion with the next cube's, unless the arm looks first.
        looks: whether the arm looks then.
    """

    fetch: tuple[Step, ...]
    carry: tuple[Step, ...]
    leave: tuple[Step, ...]
    looks: bool

    @property
    def approach(self) -> Move:
        """The move that brings the jaws to the cube."""
        return next(s for s in reversed(self.fetch) if isinstance(s, Move))


def visits(plan: Plan) -> tuple[Visit, ...]:
    """The visits of a plan that has the shape of `plan.pick_place.grammar.require_shape`, a cube each."""
    found = []
    for cube in range(len(plan.task["cubes"])):
        indices = [i for i, s in enumerate(plan.steps) if getattr(s, "cube", None) == cube]
        steps = [plan.steps[i] for i in indices]
        close, release = (1 + _gripping(steps, action) for action in ("close", "open"))
        after = indices[-1] + 1
        looks = after < len(plan.steps) and isinstance(plan.steps[after], LookStep)
        found.append(Visit(tuple(steps[:close]), tuple(steps[close:release]), tuple(steps[release:]), looks))
    return tuple(found)


def _gripping(steps: Sequence[Step], action: str) -> int:
    return next(i for i, s in enumerate(steps) if isinstance(s, GripperStep) and s.action == action)
