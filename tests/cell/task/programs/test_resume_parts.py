"""A stopped program with parts goes on with those that are in the jaws and were put down, or says what to do."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.plan_file import GripperStep, Move, Pause, Plan, read_plan
from cell.program.planning import plan_of_program, program_options
from cell.program.program_file import ProgramTask, read_program
from cell.task.plan_matches import replayed, scene_of_now
from plan.program.rest import handled_before, place_on, rest_of_plan
from plan.program.setting import Setting
from plan.verify import placed_cubes
from programs.lasting import Lasting
from programs.pallets import pallet
from vision.observation import Observation

pytestmark = pytest.mark.xdist_group("resume parts")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[ProgramTask, Plan]:
    task = read_program(pallet(tmp_path_factory.mktemp("pallet"), ("[1, 2, 2]", "[1, 2, 1]")))
    return task, plan_of_program(task, Observation(), 1.0)


def _rest(task: ProgramTask, plan: Plan, index: int, share: float) -> Plan:
    """The rest of a plan that was stopped in a step, after a share of it if it is a move."""
    unit, step = task.cell.unit, plan.steps[index]
    before = [move for move in plan.steps[:index] if isinstance(move, Move)]
    q = unit.positions(before[-1].path.end if before else plan.start)
    if isinstance(step, Move):
        q = unit.positions(step.path.at(np.array([share * step.path.duration_s])))[0]
    options = program_options(task, plan.speed)
    setting = Setting(scene_of_now(task, plan), task.cell.unit, task.cell.limits, options)
    return rest_of_plan(plan, setting, place_on(plan, unit, q, index), q)


def _index(plan: Plan, name: str) -> int:
    return [step.name for step in plan.steps].index(name)


def _require_same_end(task: ProgramTask, plan: Plan, rest: Plan) -> None:
    """The rest is certified again for the present cell, and every part ends where the whole plan has it."""
    replayed(task, rest)
    ends = [placed_cubes(one, scene_of_now(task, one), task.cell.unit) for one in (plan, rest)]
    assert ends[0].keys() == ends[1].keys()
    for name, T in ends[0].items():
        np.testing.assert_allclose(ends[1][name], T, atol=5e-5)


@pytest.mark.parametrize(
    ("name", "handled", "held"),
    [
        ("lift off take (2)", 3, "part 2"),
        ("retract from put", 2, None),
        ("open at put", 1, "part 1"),
        ("take", 0, None),
    ],
)
def test_the_rest_has_the_parts_where_they_are(
    made: tuple[ProgramTask, Plan], name: str, handled: int, held: str | None
) -> None:
    task, plan = made
    rest = _rest(task, plan, _index(plan, name), 0.4)
    assert rest.task["parts_before"] == handled
    first = next(step for step in rest.steps if isinstance(step, Pause))
    assert first.attached == (held or ("part 1" if handled == 0 else "part 2"))
    last = next(step for step in rest.steps if isinstance(step, GripperStep))
    assert last.action == ("close" if name in ("lift off take (2)", "take") else "open")
    assert rest.scene["supplies"] == ([["part 1", "part 2"]] if handled < 2 else [["part 2"]])
    scene_of_now(task, rest)  # accepts it


@pytest.mark.slow
@pytest.mark.parametrize("again", [False, True])
def test_wherever_it_was_stopped_once_or_twice_the_parts_end_where_they_should(
    made: tuple[ProgramTask, Plan], again: bool
) -> None:
    task, plan = made
    for index in range(int(again), len(plan.steps) - 1, 2):
        rest = _rest(task, plan, index, 0.5)
        if again:
            later = next(i for i, s in enumerate(rest.steps) if isinstance(s, Move))
            count = handled_before(rest, later)
            rest = _rest(task, rest, later, 0.3)
            assert rest.task["parts_before"] == count
        _require_same_end(task, plan, rest)


def test_a_rest_that_forgets_the_part_in_the_jaws_or_has_it_elsewhere_is_refused(
    made: tuple[ProgramTask, Plan],
) -> None:
    task, plan = made
    rest = _rest(task, plan, _index(plan, "to put (2)"), 0.5)
    forgotten = tuple(step for step in rest.steps if not (isinstance(step, Pause) and step.attached))
    with pytest.raises(
        ImpossibleError, match=r"holds part 2, but the steps before it leave nothing|part 2 in the jaws"
    ):
        replayed(task, _edited(rest, steps=forgotten))
    for name, where in (("part 2", "in the jaws"), ("part 1", "at 'put'")):
        cubes = [dict(cube) for cube in rest.scene["cubes"]]
        number = [cube["name"] for cube in cubes].index(name)
        T = np.array(cubes[number]["T_base_body"])
        T[2, 3] += 0.002
        cubes[number]["T_base_body"] = T.tolist()
        scene = {**rest.scene, "cubes": cubes}
        with pytest.raises(
            ImpossibleError, match=f"it has {name} 2.0 mm and 0.00 deg from where that is {where}"
        ):
            scene_of_now(task, _edited(rest, scene=scene))


def _edited(plan: Plan, **values: object) -> Plan:
    return Plan(**{**vars(plan), **values})  # type: ignore[arg-type]


@pytest.fixture
def lasting(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, made: tuple[ProgramTask, Plan]
) -> Iterator[Lasting]:
    found = Lasting(tmp_path, monkeypatch, *made)
    with found.emulator:
        yield found


@pytest.mark.slow
def test_stopped_with_parts_in_the_jaws_and_on_the_pallet_the_arm_goes_on(
    lasting: Lasting, capsys: pytest.CaptureFixture[str]
) -> None:
    at = lasting
    plan = at.stopped(at.first, "to put", 0.4)
    plan = at.stopped(lambda: at.resumed(plan, "second"), "retract from put", 0.5)
    plan = at.stopped(lambda: at.resumed(plan, "third"), "approach put (2)", 0.5)
    at.resumed(plan, "fourth")
    said = capsys.readouterr().out
    for name in ("to put", "retract from put", "approach put (2)"):
        assert f"it goes on in {name!r}" in said
    assert at.emulator.violations == ()
    np.testing.assert_allclose(at.task.cell.unit.positions(at.emulator.counts()), at.task.q_end, atol=1e-3)
    befores = [read_plan(file).task.get("parts_before", 0) for file in sorted(at.folder.glob("*/plan.json"))]
    assert sorted(befores) == [0, 1, 2, 3]


@pytest.mark.slow
def test_without_its_report_or_beside_its_path_nothing_moves(
    lasting: Lasting, monkeypatch: pytest.MonkeyPatch
) -> None:
    at = lasting
    plan = at.stopped(at.first, "to put (2)", 0.5)
    before = at.emulator.counts()
    with monkeypatch.context() as beside:
        beside.setattr("cell.task.programs.resume.NEAR", -1.0)
        with pytest.raises(
            ImpossibleError, match=r"1 were put down, one is in the jaws; take them out by hand"
        ):
            at.resumed(plan, "second")
    (plan.parent / "report.json").unlink()
    with pytest.raises(
        ImpossibleError, match="does not say in which step it was stopped, so what was put down is unknown"
    ):
        at.resumed(plan, "third")
    np.testing.assert_array_equal(at.emulator.counts(), before)
