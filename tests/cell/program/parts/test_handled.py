"""Parts of a program: bodies with names and an order, what they may touch, and which places are refused."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm.errors import FileInputError, ImpossibleError
from arm.plan_file import Plan
from arm.robot.shapes import Body, Box
from arm.se3 import inverse, rot_x, transform
from cell.preview.clearance import sample_clearance
from cell.preview.content import page_content
from cell.program.parts.handled import Part, Parts, parts_of, standing_on
from cell.program.planning import plan_of_program, program_parts, program_scene
from cell.program.program_file import ProgramTask, read_program
from programs.pallets import pallet
from typed.command_line import a465, refused
from vision.observation import Observation

TABLE = Body("table", Box((2.0, 2.0, 0.1)), transform(t=(0.5, 0.0, -0.05)), "table")
FINGERS = {"finger_l", "finger_r"}


@pytest.fixture(scope="module")
def task(tmp_path_factory: pytest.TempPathFactory) -> ProgramTask:
    return read_program(pallet(tmp_path_factory.mktemp("pallet")))


@pytest.fixture(scope="module")
def plan(task: ProgramTask) -> Plan:
    return plan_of_program(task, Observation(), 1.0)


def _parts(task: ProgramTask) -> Parts:
    return standing_on(parts_of(task.part, task.steps, task.repeat, task.T_on_work), [TABLE], 0.005)


def test_parts_are_numbered_as_they_are_taken_and_those_of_one_place_come_in_order(task: ProgramTask) -> None:
    parts = _parts(task)
    names = [f"part {k}" for k in range(1, 5)]
    assert [(one.part, one.put) for one in parts.handled] == [
        (n, put) for n in names for put in (False, True)
    ]
    assert parts.supplies == (tuple(names),)
    assert [body.name for body in parts.bodies] == names
    for body in parts.bodies:
        np.testing.assert_allclose(body.T_base_body[:3, 3], (0.48, 0.17, 0.018), atol=1e-12)
    places = [one.T_base_part[:3, 3] for one in parts.handled if one.put]
    expected = [(0.42, -0.06 + 0.052 * j, 0.018 + 0.036 * k) for k in range(2) for j in range(2)]
    np.testing.assert_allclose(places, expected, atol=1e-12)


def test_a_part_may_touch_the_fingers_and_what_it_stands_on_but_no_neighbour(task: ProgramTask) -> None:
    parts = _parts(task)
    for one, below in zip(parts.handled, ["table"] * 5 + ["part 1", "table", "part 2"], strict=True):
        assert one.touch == {frozenset((one.part, name)) for name in {*FINGERS, below}}
    assert parts.touch == program_parts(task, Observation()).touch
    scene = program_scene(task, Observation())
    assert scene.allowed >= parts.touch
    assert scene.supplies == parts.supplies


def test_a_square_part_is_gripped_at_quarter_turns_and_another_at_half_turns(task: ProgramTask) -> None:
    square = Part("part", (0.04, 0.04, 0.03), (0.01, 0.0, -0.005))
    for part, count in ((square, 4), (replace(square, size=(0.05, 0.04, 0.03)), 2)):
        (taken, put, *_) = parts_of(part, task.steps, task.repeat, task.T_on_work).handled
        corners = np.array([[x, y, z, 2.0] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2.0
        corners[:, :3] *= part.size
        assert len(taken.T_base_tool) == len(put.T_base_tool) == count
        for at in taken.T_base_tool:
            for down in put.T_base_tool:  # whatever the grasp, the box stands in the same place
                T = down @ inverse(at) @ taken.T_base_part
                there, nominal = (corners @ pose.T for pose in (T, put.T_base_part))
                off = np.linalg.norm(there[:, None] - nominal, axis=2)
                assert off.min(axis=1).max() < 1e-12
        turns = [np.degrees(np.arccos((np.trace(T[:3, :3].T @ taken.T_base_tool[0, :3, :3]) - 1) / 2))
                 for T in taken.T_base_tool]  # fmt: skip
        np.testing.assert_allclose(sorted(turns), {4: [0, 90, 90, 180], 2: [0, 180]}[count], atol=1e-5)


def test_without_freedom_there_is_one_grasp(task: ProgramTask) -> None:
    steps = tuple(replace(step, free="") if hasattr(step, "free") else step for step in task.steps)
    for one in parts_of(task.part, steps, task.repeat, task.T_on_work).handled:
        assert len(one.T_base_tool) == 1


def test_parts_that_wait_in_a_grid_are_all_there_and_stand_on_each_other(tmp_path: Path) -> None:
    grid = "grid.count = [1, 2, 2]\ngrid.step_mm = [70, 52, 36]\n"
    row = "grid.count = [4, 1, 1]\ngrid.step_mm = [-60, 0, 0]\n"
    stack = "at_mm = [60, 230, 54]\ngrid.count = [1, 2, 2]\ngrid.step_mm = [0, 52, -36]"
    parts = _parts(read_program(pallet(tmp_path, (grid, row), ("at_mm = [60, 230, 18]", stack))))
    assert parts.supplies == tuple((f"part {k}",) for k in range(1, 5))
    taken = [one for one in parts.handled if not one.put]
    for one, below in zip(taken, ["part 3", "part 4", "table", "table"], strict=True):
        assert one.touch == {frozenset((one.part, name)) for name in {*FINGERS, below}}


def test_a_tilted_work_is_lifted_along_its_own_normal(task: ProgramTask) -> None:
    T = transform(rot_x(0.4), (0.5, 0.0, 0.3))
    slope = Body("slope", Box((1.0, 1.0, 0.02)), T @ transform(t=(0.0, 0.0, -0.01)), "work")
    parts = standing_on(parts_of(task.part, task.steps, task.repeat, T), [slope, TABLE], 0.005)
    assert frozenset(("part 1", "slope")) in parts.handled[0].touch
    assert frozenset(("part 3", "part 1")) in parts.handled[5].touch


@pytest.mark.parametrize(
    ("old", "new", "pair", "message"),
    [
        ("52, 36]", "47, 36]", ["part 2", "part 1"], "put down, it is 3.0 mm from part 1 .required: 5 mm"),
        ("52, 36]", "40, 36]", ["part 2", "part 1"], "put down, it is 4.0 mm inside part 1 .required: 5 mm"),
        ("52, 36]", "52, 30]", ["part 3", "part 1"], "put down, it is 6.0 mm inside part 1; raise the step"),
        ("at_mm = [0, 0, 18]", "at_mm = [0, 0, 58]", None, "put down, it stands on nothing within 1 mm"),
        ("at_mm = [60, 230, 18]", "at_mm = [60, 230, 12]", ["part 1", "table"], "is taken, it is 6.0 mm inside table"),
        ("at_mm = [60, 230, 18]", "at_mm = [0, 100, 18]", ["part 2", "part 3"], "put down, it is 4.0 mm from part 3"),
    ],
)  # fmt: skip
def test_a_place_without_room_is_refused_with_its_pair_and_step(
    tmp_path: Path, old: str, new: str, pair: list[str] | None, message: str
) -> None:
    task = read_program(pallet(tmp_path, (old, new)))
    with pytest.raises(ImpossibleError, match=rf"pallet.toml: steps\[[01]\]: .* {message}") as caught:
        plan_of_program(task, Observation(), 1.0)
    assert caught.value.data.get("pair") == pair
    first, *second = caught.value.data["bodies"]
    assert [first["name"], *(body["name"] for body in second)] == (pair or ["part 1"])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("part.box_mm = [44, 44, 36]\n", "", r"part.box_mm: is missing"),
        ("[44, 44, 36]", "[44, 44, 36]\npart.name = 'cube'", r"part.name = 'cube': is how names of bodies begin"),
        ("[44, 44, 36]", "[30, 60, 36]", r"part.box_mm .* is 60 mm along the tool's y axis, between jaws that open 60"),
        ('"close"', "0.2", r"steps\[0\].jaws = 0.2: leaves the jaws 48 mm apart, and the part is 44 mm wide"),
        ('part = "put"\n', "", r"steps\[1\].jaws = 'open': would let go of the part"),
        ('part = "put"\n', 'part = "take"\njaws = "close"\n', None),
        ('part = "take"\n', "", r"steps\[1\].part = 'put': puts a part down, but holds none"),
        ('jaws = "open"\n', "", r"steps\[1\].part = 'put': needs jaws = 'open'"),
        ('jaws = "close"\n', 'jaws = "open"\n', r"steps\[0\].part = 'take': needs jaws = 'close'"),
        ('free = "rz"', 'free = "x"', r"steps\[0\].free = 'x': may only be rz"),
        ('free = "rz"', 'by = "line"', r"steps\[0\].by = 'line': must be transit"),
        ('free = "rz"', "tilt_deg = 5", r"steps\[0\].tilt_deg = 5: cannot be"),
        ('[[steps]]\nname = "put"', '[[steps]]\ndwell_s = 1\npart = "put"\n\n[[steps]]\nname = "put"',
         r"steps\[1\].part = 'put': needs at_mm"),
        ('[[steps]]\nname = "put"', "[[bodies]]\nname = 'part 7'\ncentre_mm = [0, 0, 900]\nsize_mm = [9, 9, 9]\n\n"
         '[[steps]]\nname = "put"', r"part.name: makes names such as that of the body 'part 7'"),
    ],
)  # fmt: skip
def test_keys_that_make_no_sense_are_refused(tmp_path: Path, old: str, new: str, message: str | None) -> None:
    replaced = [(old, new)]
    if message is None:
        replaced.append(('jaws = "open"\n', ""))
        message = r"steps\[1\].part = 'take': takes a part while the jaws hold one"
    with pytest.raises(FileInputError, match=message):
        read_program(pallet(tmp_path, *replaced))


def test_steps_with_parts_need_a_box_and_a_box_needs_steps(tmp_path: Path) -> None:
    without = [('part = "take"\n', ""), ('part = "put"\n', "")]
    with pytest.raises(FileInputError, match=r"part.*: is in no step"):
        read_program(pallet(tmp_path, *without))
    plain = read_program(pallet(tmp_path, *without, ("part.box_mm = [44, 44, 36]\n", "")))
    assert plain.part is None
    assert program_parts(plain, Observation()).bodies == ()
    assert "supplies" not in program_scene(plain, Observation()).to_json()


def test_a_plan_carries_its_parts_and_says_where_they_are(plan: Plan) -> None:
    assert [cube["name"] for cube in plan.scene["cubes"]] == [f"part {k}" for k in range(1, 5)]
    assert plan.scene["supplies"] == [[f"part {k}" for k in range(1, 5)]]
    held = [move.held for move in plan.moves]
    assert [held.count(f"part {k}") for k in range(1, 5)] == [3, 3, 3, 3]  # lift off, transit, approach
    assert min(move.clearance for move in plan.moves) >= 0.005


def test_a_preview_shows_each_part_from_when_it_is_there(task: ProgramTask, plan: Plan) -> None:
    robots = task.cell.robot(), task.cell.robot_holding()
    content = page_content(plan, *robots, task.cell.unit)
    steps = content["steps"]
    begins = {step["name"]: step["start"] for step in steps}
    for number, cube in enumerate(content["cubes"], start=1):
        of = "" if number == 1 else f" ({number})"
        before = "" if number == 2 else f" ({number - 1})"
        comes = 0.0 if number == 1 else begins[f"retract from put{before}"]
        starts = [comes, begins[f"lift off take{of}"], begins[f"retract from put{of}"]]
        np.testing.assert_allclose([pose["start"] for pose in cube["track"]], starts, atol=1e-5)
        assert [pose["held"] for pose in cube["track"]] == [False, True, False]
    sampled = sample_clearance(plan, *robots, task.cell.unit)
    assert min(one.distance for samples in sampled.values() for one in samples) > 0.005


def test_an_export_has_only_the_part_that_is_there_at_the_start(task: ProgramTask, tmp_path: Path) -> None:
    a465("export", task.file, "--format", "urdf", "-o", tmp_path / "urdf")
    text = next((tmp_path / "urdf").rglob("*.urdf")).read_text()
    assert "part 1" in text or "part_1" in text
    assert "part 2" not in text
    assert "part_2" not in text


def test_what_is_beside_a_part_may_not_touch_it_however_near(task: ProgramTask) -> None:
    wall = Body("wall", Box((0.01, 0.2, 0.3)), transform(t=(0.48 - 0.022 - 0.005 - 2e-4, 0.17, 0.15)), "wall")
    alone = parts_of(task.part, task.steps, task.repeat, task.T_on_work)
    taken = standing_on(alone, [TABLE, wall], 0.005).handled[0]
    assert taken.touch == {frozenset(("part 1", name)) for name in {*FINGERS, "table"}}


@pytest.mark.slow
def test_a_pallet_without_room_for_the_jaws_is_refused_and_no_part_is_advised_away(tmp_path: Path) -> None:
    file = pallet(
        tmp_path,
        ("part.box_mm = [44, 44, 36]", "part.box_mm = [44, 40, 36]"),
        (
            "grid.count = [1, 2, 2]\ngrid.step_mm = [70, 52, 36]",
            "grid.count = [2, 2, 1]\ngrid.step_mm = [70, 46, 36]",
        ),
    )
    told = refused("plan", file, "-o", tmp_path / "plan.json", code=3, cwd=tmp_path)
    assert re.search(r"steps\[1\]: no path to put .* comes within .* of part \d", told), told
    assert "take part" not in told
