"""The steps of a plan grouped by cube and by gripper action, as they are executed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from arm.plan_file import GripperStep, LookStep, Move, Plan, Step


@dataclass(frozen=True)
class CubeCycle:
    """The steps of one cube.

    Attributes:
        fetch: the moves to it, and the closing of the jaws.
        carry: the moves with it, and the opening of the jaws.
        leave: the moves away from its target; one motion with the next cube's fetch, unless a look comes first.
        looks: whether a look follows.
    """

    fetch: tuple[Step, ...]
    carry: tuple[Step, ...]
    leave: tuple[Step, ...]
    looks: bool

    @property
    def approach(self) -> Move:
        """The last move to the cube."""
        return next(s for s in reversed(self.fetch) if isinstance(s, Move))


def cube_cycles(plan: Plan) -> tuple[CubeCycle, ...]:
    """Group the steps of a plan that satisfies `plan.program.grammar.require_grammar` by cube."""
    found = []
    for cube in range(len(plan.task["cubes"])):
        indices = [i for i, s in enumerate(plan.steps) if getattr(s, "cube", None) == cube]
        steps = [plan.steps[i] for i in indices]
        close, release = (1 + _gripping(steps, action) for action in ("close", "open"))
        after = indices[-1] + 1
        looks = after < len(plan.steps) and isinstance(plan.steps[after], LookStep)
        found.append(
            CubeCycle(tuple(steps[:close]), tuple(steps[close:release]), tuple(steps[release:]), looks)
        )
    return tuple(found)


def _gripping(steps: Sequence[Step], action: str) -> int:
    return next(i for i, s in enumerate(steps) if isinstance(s, GripperStep) and s.action == action)
