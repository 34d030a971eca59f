"""The shape of a plan: which orders of steps may be executed."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import pytest

from arm.controller.segments import CountPath, Segment
from arm.errors import ImpossibleError
from arm.plan_file import GripperStep, LookStep, Move, Plan, Step
from plan.program.grammar import require_grammar

PATH = CountPath((0,) * 6, (Segment(100, ((0,) * 6,)),))


def _cube(index: int, name: str, home: bool, look: bool) -> list[Step]:
    def move(role: str, held: bool = False) -> Move:
        return Move(f"{name}: {role}", role, index, PATH, name if held else None, 0.05, 0.01, ("a", "b"))

    return [
        move("transit"),
        move("approach"),
        GripperStep(f"{name}: close", "close", index, 0.9, 1.0),
        move("retract", held=True),
        move("transit", held=True),
        move("approach", held=True),
        GripperStep(f"{name}: open", "open", index, 0.0, 1.0),
        move("retract"),
        *([move("home")] if home else []),
        *([LookStep(f"look after {name}")] if look else []),
    ]


def _plan(holes: Sequence[tuple[int, int]], home: Sequence[bool], look: Sequence[bool]) -> Plan:
    cubes = [{"cube": f"cube 01-02/{a}", "from": f"01-02/{a}", "to": f"03-04/{b}"} for a, b in holes]
    steps: list[Step] = [GripperStep("open the gripper", "open", None, 0.0, 1.0)]
    for index, cube in enumerate(cubes):
        steps += _cube(index, cube["cube"], home[index], look[index])
    return Plan({"cubes": cubes}, "crs93", 0.5, (1,) * 6, (1,) * 6, tuple(steps), {})


ORDER = ((3, 1), (1, 4), (4, 2))


@pytest.mark.parametrize(
    ("home", "look"),
    [
        ((False, False, True), (False, False, False)),
        ((True, True, True), (True, True, True)),
        ((False, True, True), (False, True, False)),  # every second cube
        ((False, False, False), (False, False, False)),
    ],
)
def test_cubes_in_any_order_of_holes_with_or_without_looks(
    home: tuple[bool, ...], look: tuple[bool, ...]
) -> None:
    require_grammar(_plan(ORDER, home, look))


def _without(name: str) -> Callable[[list[Step]], list[Step]]:
    return lambda steps: [s for s in steps if s.name != name]


def _with_look(after: str) -> Callable[[list[Step]], list[Step]]:
    def change(steps: list[Step]) -> list[Step]:
        at = next(i for i, s in enumerate(steps) if s.name == after)
        return [*steps[: at + 1], LookStep("look"), *steps[at + 1 :]]

    return change


FIRST = "cube 01-02/3"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_without(f"{FIRST}: open"), "out of order for cube 1"),
        (_without(f"{FIRST}: close"), "out of order for cube 1"),
        (_with_look(f"{FIRST}: close"), "looks before a cube is set down"),
        (_with_look(f"{FIRST}: open"), "looks before a cube is set down"),
        (_with_look("open the gripper"), "looks before a cube is set down"),
        (
            _with_look(f"{FIRST}: retract"),
            "looks before a cube is set down",
        ),  # the lift-off has that name too
        (lambda s: [*s[:1], *s[9:], *s[1:9]], "serves cube 1 out of order"),
        (lambda s: [*s, LookStep("look"), s[8]], "after the look that ends it|out of order"),
    ],
)
def test_other_orders_are_refused(change: Callable[[list[Step]], list[Step]], message: str) -> None:
    plan = _plan(ORDER, (False, False, True), (False, False, False))
    changed = Plan(plan.task, plan.unit, plan.speed, (1,) * 6, (1,) * 6, tuple(change(list(plan.steps))), {})
    with pytest.raises(ImpossibleError, match=message):
        require_grammar(changed)


def test_the_way_home_comes_before_the_look() -> None:
    plan = _plan(ORDER, (True, True, True), (False, False, False))
    steps = _with_look("cube 01-02/3: home")(list(plan.steps))
    at = next(i for i, s in enumerate(steps) if s.name == "cube 01-02/3: home")
    steps[at], steps[at + 1] = steps[at + 1], steps[at]
    changed = Plan(plan.task, plan.unit, plan.speed, (1,) * 6, (1,) * 6, tuple(steps), {})
    with pytest.raises(ImpossibleError, match="serves cube 0 after the look that ends it"):
        require_grammar(changed)
