"""The grammar of plans that may be executed: every cube is picked, carried and placed in order, and nothing else.

The order of the file is the order of execution, so that what is executed is what was certified. Cubes come in the order
of ``task.cubes``; an optional look ends the steps of a cube. A second look may divide the approach to its place. A plan
without cubes may only move, dwell, look, and open and close the jaws.
"""

from __future__ import annotations

from arm.errors import ImpossibleError
from arm.plan_file import GripperStep, LookStep, Move, Pause, Plan, Step

# Steps of one cube. A transit is missing if its ends coincide; the move home is missing before another cube.
_ORDER = (
    *("transit", "approach", "close", "retract", "transit"),
    *("approach", "look", "approach", "open", "retract", "home"),
)
_OPTIONAL = ("transit", "home")
_LOOK = 6  # index in `_ORDER` of a second look; without it, one approach leads to the place


def require_grammar(plan: Plan) -> None:
    """Refuse a plan whose steps do not match its cubes, in order.

    Raises:
        ImpossibleError: naming the step.
    """
    cubes = plan.task.get("cubes")
    if not isinstance(cubes, list) or not all(_named(entry) for entry in cubes):
        raise _refused("task.cubes must list cube, from and to")
    groups: list[list[Step]] = [[] for _ in cubes]
    at, over = -1, False
    for number, step in enumerate(plan.steps):
        if isinstance(step, Pause):
            if cubes:
                raise _refused(f"step {step.name!r} serves no cube")
            continue
        if isinstance(step, LookStep) and step.cube is None:
            if cubes and not (groups[at] and _ended(groups[at])):
                raise _refused(f"step {step.name!r} looks before a cube is set down and left")
            over = True
            continue
        if step.cube is None:
            if number == 0 and isinstance(step, GripperStep) and step.action == "open":
                _require_action(step)  # the next moves are certified with open jaws
                continue
            if not cubes:
                _require_action(step)
                continue
            raise _refused(f"step {step.name!r} serves no cube")
        if step.cube not in (at, at + 1) or step.cube >= len(cubes):
            raise _refused(f"step {step.name!r} serves cube {step.cube} out of order")
        if over and step.cube == at:
            raise _refused(f"step {step.name!r} serves cube {step.cube} after the look that ends it")
        at, over = step.cube, False
        groups[at].append(step)
    for index, group in enumerate(groups):
        _require_group(index, group, str(cubes[index]["cube"]))


def _named(entry: object) -> bool:
    return isinstance(entry, dict) and all(isinstance(entry.get(key), str) for key in ("cube", "from", "to"))


def _ended(group: list[Step]) -> bool:
    """Return whether the cube was released and the arm has moved away since."""
    last = group[-1]
    return isinstance(last, Move) and any(isinstance(s, GripperStep) and s.action == "open" for s in group)


def _require_group(index: int, group: list[Step], cube: str) -> None:
    looks = any(isinstance(step, LookStep) for step in group)
    wanted = [*_ORDER] if looks else [*_ORDER[:_LOOK], *_ORDER[_LOOK + 2 :]]
    for step in group:
        found = (
            step.role if isinstance(step, Move) else step.action if isinstance(step, GripperStep) else "look"
        )
        while wanted and wanted[0] != found and wanted[0] in _OPTIONAL:
            wanted.pop(0)
        if not wanted or wanted.pop(0) != found:
            raise _refused(f"step {step.name!r} is out of order for cube {index + 1}")
        _require_action(step)
        if isinstance(step, Move) and step.held not in (None, cube):
            raise _refused(f"step {step.name!r} holds {step.held}, not {cube}")
    if any(role not in _OPTIONAL for role in wanted):
        raise _refused(f"cube {index + 1} lacks its {wanted[0]}")


def _require_action(step: Step) -> None:
    if isinstance(step, GripperStep) and (step.fraction_closed > 0.0) != (step.action == "close"):
        raise _refused(f"step {step.name!r} says {step.action} but closes by {step.fraction_closed:g}")


def _refused(why: str) -> ImpossibleError:
    return ImpossibleError(f"the plan cannot be executed: {why}; make the plan again", why=why)
