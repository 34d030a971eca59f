"""A plan that does not handle the parts as its program does is refused, and so is one that does not know of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.plan_file import GripperStep, Move, Pause, Plan, Step, read_plan, write_plan
from cell.program.planning import plan_of_program, program_parts
from cell.program.program_file import ProgramTask, read_program
from cell.task.plan_matches import replayed, scene_of_now
from programs.pallets import pallet, samples_of_parts
from vision.observation import Observation

Edit = Callable[[tuple[Step, ...]], tuple[Step, ...]]
TWO = ("[1, 2, 2]", "[1, 2, 1]")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[ProgramTask, Plan]:
    task = read_program(pallet(tmp_path_factory.mktemp("pallet"), TWO))
    return task, plan_of_program(task, Observation(), 1.0)


def test_a_plan_of_the_program_is_accepted_from_its_file(
    made: tuple[ProgramTask, Plan], tmp_path: Path
) -> None:
    task, plan = made
    write_plan(tmp_path / "plan.json", plan)
    moves = replayed(task, read_plan(tmp_path / "plan.json"))
    assert [of.move.name for of in moves] == [move.name for move in plan.moves]


def _where(steps: tuple[Step, ...], name: str) -> int:
    return next(i for i, step in enumerate(steps) if step.name == name and not isinstance(step, GripperStep))


def _with(name: str, **values: object) -> Edit:
    def edit(steps: tuple[Step, ...]) -> tuple[Step, ...]:
        at = _where(steps, name)
        return (*steps[:at], replace(steps[at], **values), *steps[at + 1 :])  # type: ignore[arg-type]

    return edit


def _without(*names: str) -> Edit:
    return lambda steps: tuple(step for step in steps if step.name not in names)


def _jaws(name: str, action: str) -> Edit:
    closed = float(action == "close")
    return lambda steps: tuple(
        replace(s, action=action, fraction_closed=closed)
        if isinstance(s, GripperStep) and s.name == name
        else s
        for s in steps
    )


def _unheld(steps: tuple[Step, ...]) -> tuple[Step, ...]:
    """The same steps, with nothing in the jaws ever."""
    return tuple(
        replace(s, held=None, allowed_collisions=(), allowed_pairs=())
        if isinstance(s, Move)
        else replace(s, attached=None, detached=None)
        if isinstance(s, Pause)
        else s
        for s in steps
    )


def _early(steps: tuple[Step, ...]) -> tuple[Step, ...]:
    """Steps that take the part before the line to it: the jaws close in the air."""
    at = _where(steps, "approach take")
    close, take = steps[at + 1 : at + 3]
    assert isinstance(steps[at], Move)
    return (*steps[:at], close, take, replace(steps[at], held="part 1"), *steps[at + 3 :])


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (_unheld, "it does not take part 1 at 'take'"),
        (_with("take (2)", attached="part 3"), "it says|'take \\(2\\)' is where part 2 must be taken|holds part 2"),
        (_with("put", detached="part 2"), "'put' is where part 1 must be put down"),
        (_with("put", detached=None), "'approach put' lets touch finger_l and part 1, which must not there"),
        (_with("to put (2)", allowed_collisions=("part 1",)), "lets touch part 1 and part 2, which must not there"),
        (_with("to put (2)", allowed_collisions=("table",)), "'to put \\(2\\)' lets touch part 2 and table"),
        (_with("approach put (2)", allowed_collisions=("part 1", "table")), "lets touch part 1 and part 2"),
        (_with("approach put (2)", allowed_pairs=(("finger_l", "part 1"),)), "lets touch finger_l and part 1"),
        (_with("approach put (2)", role="transit"), "lets touch finger_l and part 2, which must not there"),
        (_without("close at take"), "'approach take' lets touch finger_l and part 1, which must not there"),
        (_jaws("close at take", "open"), "the jaws do not close at 'take'"),
        (_jaws("open at put (2)", "close"), "the jaws do not open at 'put \\(2\\)'"),
        (_early, "the tool is 60.0 mm and 0.00 deg from where 'take' is"),
    ],
)  # fmt: skip
def test_an_edited_plan_is_refused(made: tuple[ProgramTask, Plan], edit: Edit, message: str) -> None:
    task, plan = made
    with pytest.raises(ImpossibleError, match=message):
        replayed(task, replace(plan, steps=edit(plan.steps)))


def test_a_plan_that_claims_parts_handled_before_it_is_refused(made: tuple[ProgramTask, Plan]) -> None:
    task, plan = made
    claimed = replace(plan, task={**plan.task, "parts_before": 2})
    with pytest.raises(ImpossibleError, match="it states 2 parts taken or put down before its first move"):
        scene_of_now(task, claimed)


def test_a_part_elsewhere_in_the_plans_scene_is_refused(made: tuple[ProgramTask, Plan]) -> None:
    task, plan = made
    cubes = [{**cube, "T_base_body": np.array(cube["T_base_body"]).tolist()} for cube in plan.scene["cubes"]]
    cubes[1]["T_base_body"][0][3] += 0.001
    with pytest.raises(ImpossibleError, match="not that of the present cell: part 2;"):
        scene_of_now(task, replace(plan, scene={**plan.scene, "cubes": cubes}))
    with pytest.raises(ImpossibleError, match="the order of the parts"):
        scene_of_now(task, replace(plan, scene={**plan.scene, "supplies": [["part 1"], ["part 2"]]}))


def test_a_plan_that_sweeps_a_part_through_one_put_before_is_refused(tmp_path: Path) -> None:
    put = 'approach_mm = 60\nretract_mm = 60\njaws = "open"'
    low = [
        (put, put.replace("60", "6", 1)),
        ('retract_mm = 60\njaws = "close"', 'retract_mm = 8\njaws = "close"'),
    ]
    far = [('free = "rz"\n', ""), ("grid.step_mm = [70, 52, 36]", "grid.step_mm = [70, -70, 36]")]
    knowing = read_program(pallet(tmp_path, TWO, *low, *far))
    plan = plan_of_program(knowing, Observation(), 1.0)
    replayed(knowing, plan)
    # the same program for which boxes are air
    (tmp_path / "blind").mkdir()
    without = [('part = "take"\n', ""), ('part = "put"\n', ""), ("part.box_mm = [44, 44, 36]\n", "")]
    task = read_program(pallet(tmp_path / "blind", TWO, *low, *far, *without))
    blind = plan_of_program(task, Observation(), 1.0)
    forged = replace(plan, steps=tuple(_with_parts(blind.steps, program_parts(knowing, Observation()))))
    with pytest.raises(
        ImpossibleError, match=r"(part 2|finger_.|palm) comes within .* mm of part 1"
    ) as caught:
        replayed(knowing, forged)
    assert caught.value.data["distance_m"] < 0.005


def _with_parts(steps: tuple[Step, ...], parts: object) -> list[Step]:
    """Steps of a plan without parts, as if they handled those of `parts`."""
    found, held, done = list[Step](), None, 0
    for step in steps:
        one = parts.handled[min(done, len(parts.handled) - 1)]  # type: ignore[attr-defined]
        match step:
            case Pause():
                held = None if one.put else one.part
                step = replace(step, attached=held, detached=one.part if one.put else None)
                done += 1
            case Move(role="approach" | "retract"):
                of = one if step.role == "approach" else parts.handled[done - 1]  # type: ignore[attr-defined]
                fingers = tuple((f, of.part) for f in ("finger_l", "finger_r") if held is None)
                below = tuple(n for pair in of.touch for n in pair if n != of.part and "finger" not in n)
                step = replace(
                    step, held=held, allowed_pairs=fingers, allowed_collisions=below if held else ()
                )
            case Move():
                step = replace(step, held=held)
        if isinstance(step, Move):  # state no more than is required
            step = replace(step, clearance=0.005, clearances=(0.005,) * len(step.path.segments))
        found.append(step)
    return found


@pytest.mark.slow
def test_on_the_way_no_part_is_near_anything_by_fine_samples_of_the_geometry(tmp_path: Path) -> None:
    task = read_program(pallet(tmp_path))
    plan = plan_of_program(task, Observation(), 1.0)
    least = samples_of_parts(task, plan)
    assert least["transit"] > 0.005
    assert least["line"] > 0.005
