"""The shape of a plan: which orders of steps may be executed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import pytest

from arm.controller.segments import CountPath, Segment
from arm.errors import ImpossibleError
from arm.plan_file import GripperStep, LookStep, Move, Pause, Plan, Step
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


def _changed(name: str, **changes: object) -> Callable[[list[Step]], list[Step]]:
    return lambda steps: [replace(s, **changes) if s.name == name else s for s in steps]  # type: ignore[arg-type]


def _followed(after: str, step: Step) -> Callable[[list[Step]], list[Step]]:
    return lambda steps: [s for old in steps for s in ([old, step] if old.name == after else [old])]


def _first(steps: list[Step], name: str) -> Step:
    return next(s for s in steps if s.name == name)


FIRST, SECOND, LAST = "cube 01-02/3", "cube 01-02/1", "cube 01-02/4"
OPENS = GripperStep("open again", "open", None, 0.0, 1.0)


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
        (lambda s: [*s, LookStep("look"), replace(s[-1], cube=2)], "after the look that ends it"),
        (_followed(f"{FIRST}: open", Pause("there", 0.5)), "'there' serves no cube"),
        (_followed(f"{FIRST}: close", OPENS), "'open again' serves no cube"),
        (lambda s: [*s, replace(OPENS, action="close", fraction_closed=0.9)], "'open again' serves no cube"),
        (
            _changed("open the gripper", action="close", fraction_closed=0.9),
            "'open the gripper' serves no cube",
        ),
        (_changed("open the gripper", fraction_closed=0.4), "says open but closes by 0.4"),
        (_changed(f"{SECOND}: close", fraction_closed=0.0), "says close but closes by 0"),
        (_changed(f"{SECOND}: open", fraction_closed=0.9), "says open but closes by 0.9"),
        (lambda s: [*s[:10], *s[8:9], *s[10:]], "serves cube 0 out of order"),  # after the next one has begun
        (_changed(f"{SECOND}: transit", held=FIRST), f"holds {FIRST}, not {SECOND}"),
        (lambda s: s[: -s[::-1].index(_first(s, f"{LAST}: retract"))], "cube 3 lacks its transit"),
    ],
)
def test_other_orders_are_refused(change: Callable[[list[Step]], list[Step]], message: str) -> None:
    plan = _plan(ORDER, (False, False, True), (False, False, False))
    changed = Plan(plan.task, plan.unit, plan.speed, (1,) * 6, (1,) * 6, tuple(change(list(plan.steps))), {})
    with pytest.raises(ImpossibleError, match=message):
        require_grammar(changed)


def test_a_plan_without_cubes_opens_and_closes_as_it_says() -> None:
    closes = replace(OPENS, name="close", action="close", fraction_closed=0.9)
    steps = (LookStep("look"), OPENS, closes, Pause("here", 0.5))
    plan = Plan({"cubes": []}, "crs93", 0.5, (1,) * 6, (1,) * 6, steps, {})
    require_grammar(plan)
    for wrong in (replace(OPENS, fraction_closed=0.3), replace(closes, fraction_closed=0.0)):
        with pytest.raises(ImpossibleError, match=f"says {wrong.action} but closes by"):
            require_grammar(replace(plan, steps=(*steps, wrong)))


def test_the_way_home_comes_before_the_look() -> None:
    plan = _plan(ORDER, (True, True, True), (False, False, False))
    steps = _with_look("cube 01-02/3: home")(list(plan.steps))
    at = next(i for i, s in enumerate(steps) if s.name == "cube 01-02/3: home")
    steps[at], steps[at + 1] = steps[at + 1], steps[at]
    changed = Plan(plan.task, plan.unit, plan.speed, (1,) * 6, (1,) * 6, tuple(steps), {})
    with pytest.raises(ImpossibleError, match="serves cube 0 after the look that ends it"):
        require_grammar(changed)


def _looking(cube: int, *names: str) -> Plan:
    """A plan with second looks at a cube, each on the way into the place of a cube in `names`."""
    plan = _plan(ORDER, (True, True, True), (True, True, True))
    steps: list[Step] = []
    for step in plan.steps:
        steps.append(step)
        if step.name in [f"{name}: approach" for name in names] and getattr(step, "held", None):
            steps += [LookStep("second look", cube), replace(step, name="the last part")]
    return replace(plan, steps=tuple(steps))


def test_a_second_look_divides_the_approach_to_a_place() -> None:
    require_grammar(_looking(0, "cube 01-02/3"))


@pytest.mark.parametrize(
    ("plan", "why"),
    [
        (_looking(1, "cube 01-02/3"), "out of order"),  # it serves another cube
        (_looking(0, "cube 01-02/1"), "out of order"),
        (replace(_looking(0, "cube 01-02/3"), steps=tuple(
            s for s in _looking(0, "cube 01-02/3").steps if s.name != "the last part")), "out of order"),
        (replace(_looking(0, "cube 01-02/3"), steps=tuple(
            s for s in _looking(0, "cube 01-02/3").steps if s.name != "second look")), "out of order"),
    ],
)  # fmt: skip
def test_a_second_look_elsewhere_is_refused(plan: Plan, why: str) -> None:
    with pytest.raises(ImpossibleError, match=why):
        require_grammar(plan)
