"""Programs are planned step by step, stated in their plans, checked, shown, executed; a refusal names the step."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.io.storage import data_file
from arm.plan_file import Move, Pause, Plan, read_plan
from arm.se3 import inverse
from cell.program.outline import through
from cell.program.path_step import PathStep
from cell.program.planning import plan_of_program, program_scene
from cell.program.program_file import ProgramTask, read_program
from cell.task.plan_matches import replayed, require_match
from plan.advice.changes import Request
from plan.advice.search import advise
from programs.program_files import PROGRAM, program
from typed.command_line import a465, replace_in
from vision.observation import Observation

OPEN = (
    PROGRAM.replace('line_of = "wire.toml"\nbackwards = true\n', "")
    .replace(
        "extend_mm = [60, -30]",
        "points_mm = [[0, -150, 260], [0, -150, 60], [40, -150, 60]]\ndeviation_mm = 5",
    )
    .replace('axis = "along"', "axis = [0, 0, 1]\nback = true")
    .replace('touch = [["ring", "bar"]]\n', "")
)
"""A path beside the wire: the ring of these tests is a full disc, which no wire fits into."""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[ProgramTask, Plan]:
    task = read_program(program(tmp_path_factory.mktemp("program"), OPEN))
    return task, plan_of_program(task, Observation(), 1.0)


def test_every_step_is_in_the_plan_in_order(made: tuple[ProgramTask, Plan]) -> None:
    task, plan = made
    names = [step.name for step in plan.steps]
    assert names == ["to above", "above", "to wire", "along wire", "back along wire", "to joints 3"]
    pause = plan.steps[1]
    assert isinstance(pause, Pause)
    assert pause.dwell_s == 0.5
    assert min(move.clearance for move in plan.moves) >= 0.006
    end = task.cell.unit.positions(list(plan.moves)[-1].path.end)
    np.testing.assert_allclose(end, task.q_end, atol=2e-5)


def test_the_tool_stays_on_the_path_within_what_is_free(made: tuple[ProgramTask, Plan]) -> None:
    task, plan = made
    path = task.steps[2]
    assert isinstance(path, PathStep)
    robot, unit = task.cell.robot(), task.cell.unit
    for name in ("along wire", "back along wire"):
        move = next(m for m in plan.moves if m.name == name)
        assert isinstance(move, Move)
        times = np.linspace(0.0, move.path.duration_s, 200)
        poses = [robot.T_base_tool(q) for q in unit.positions(move.path.at(times))]
        in_work = [inverse(task.T_on_work) @ T for T in poses]
        points = np.array([T[:3, 3] for T in in_work])
        off = np.min([piece.distances(points) for piece in path.outline.pieces], axis=0)
        assert off.max() < 1e-4
        tilt = np.degrees(np.arccos([np.clip(T[2, 2], -1, 1) for T in in_work]))
        assert tilt.max() < 30.1
    ends = points[[0, -1]]
    # a path is left at speed, at a whole millisecond
    np.testing.assert_allclose(ends, path.outline.at([path.outline.length, 0.0]), atol=5e-4)


@pytest.mark.parametrize(
    ("turn_deg", "deviation_mm"), [(30, 0.2), (30, 1.0), (90, 0.3), (90, 1.0), (150, 0.2)]
)
def test_a_rounded_corner_is_passed_without_rest_within_the_deviation(
    turn_deg: float, deviation_mm: float, tmp_path: Path
) -> None:
    """At every millisecond of what is sent, against the sharp corner that the file states."""
    turn = np.radians(turn_deg)
    corner = [0.0, -150.0, 160.0]
    end = [40.0 * np.sin(turn), -150.0, 160.0 - 40.0 * np.cos(turn)]
    points = [[0.0, -150.0, 200.0], corner, np.round(end, 6).tolist()]
    text = OPEN.replace("[[0, -150, 260], [0, -150, 60], [40, -150, 60]]", str(points))
    text = text.replace("deviation_mm = 5", f"deviation_mm = {deviation_mm}").replace("back = true", "")
    task = read_program(program(tmp_path, text))
    plan = plan_of_program(task, Observation(), 1.0)
    robot, unit, T_work_base = task.cell.robot(), task.cell.unit, inverse(task.T_on_work)
    path = next(m for m in plan.moves if m.name == "along wire").path
    times = np.arange(0.0, path.duration_s, 1e-3)
    tip = 1e3 * np.array(
        [(T_work_base @ robot.T_base_tool(q))[:3, 3] for q in unit.positions(path.at(times))]
    )
    off = np.min([piece.distances(tip) for piece in through(points).pieces], axis=0)
    from_corner = np.linalg.norm(tip - corner, axis=1)
    assert off.max() <= deviation_mm
    assert from_corner.min() <= deviation_mm
    speed = np.linalg.norm(np.diff(tip, axis=0), axis=1) / 1e-3
    radius = (deviation_mm - 0.107) / (1.0 / np.cos(0.5 * turn) - 1.0)
    assert speed[np.argmin(from_corner) - 1] > 0.5 * np.sqrt(250.0 * radius)  # mm/s, at 0.25 m/s^2 across


def test_the_bodies_of_the_work_are_obstacles(made: tuple[ProgramTask, Plan]) -> None:
    task, plan = made
    scene = program_scene(task, Observation())
    names = {body.name for body in scene.bodies}
    assert {"bar", "block", "table"} <= names
    assert {body["name"] for body in plan.scene["bodies"]} == names
    assert scene.allowed == frozenset()


def test_a_plan_is_for_its_program_alone(made: tuple[ProgramTask, Plan], tmp_path: Path) -> None:
    task, plan = made
    assert len(replayed(task, plan)) == len(list(plan.moves))
    moved = read_program(program(tmp_path, OPEN.replace("origin_mm = [460", "origin_mm = [461")))
    with pytest.raises(
        ImpossibleError, match=r"program.toml: work.origin_mm \[460, 0, 33\], now \[461, 0, 33\]"
    ):
        require_match(moved, plan)
    with pytest.raises(ImpossibleError, match="scene is not that of the present cell: bar"):
        replayed(replace(task, T_on_work=moved.T_on_work), plan)


@pytest.mark.slow
def test_the_same_program_gives_the_same_plan(made: tuple[ProgramTask, Plan]) -> None:
    task, plan = made
    assert plan_of_program(task, Observation(), 1.0).sha256 == plan.sha256


@pytest.mark.slow
def test_a_refusal_names_the_step(tmp_path: Path) -> None:
    far = OPEN.replace("at_mm = [0, 0, 300]", "at_mm = [-900, 0, 300]")
    task = read_program(program(tmp_path / "far", far))
    with pytest.raises(ImpossibleError, match=r"program.toml: steps\[0\]: target 'above' .*out of reach"):
        plan_of_program(task, Observation(), 1.0)
    metres = read_program(program(tmp_path / "metres", far.replace("[460, 0, 33]", "[0.46, 0, 0.033]")))
    told = (
        r"; work.origin_mm = \[0.46, 0, 0.033\] is less than 2 mm from that of the base: is it in metres\?$"
    )
    with pytest.raises(ImpossibleError, match=rf"steps\[1\]: .*{told}"):
        plan_of_program(metres, Observation(), 1.0)
    through = read_program(program(tmp_path / "through"))
    with pytest.raises(ImpossibleError, match=r"steps\[1\]: .*'wire'"):
        plan_of_program(replace(through, steps=tuple(_solid(s) for s in through.steps)), Observation(), 1.0)


def _solid(step: object) -> object:
    return replace(step, touch=frozenset()) if isinstance(step, PathStep) else step


@pytest.mark.slow
def test_a_tool_that_points_the_wrong_way_is_advised_to_be_turned(tmp_path: Path) -> None:
    file = Path(shutil.copytree(data_file("scenes"), tmp_path / "scenes")) / "pen/drawing.toml"
    replace_in(file, "axis = [0, 0, -1]", "axis = [0, 0, 1]")
    asked: list[tuple[Request, ImpossibleError]] = []
    with pytest.raises(ImpossibleError, match="is out of reach"):
        plan_of_program(read_program(file), Observation(), 1.0, lambda *one: asked.append(one))
    ((request, error),) = asked
    (advice,) = advise(request, error, budget=1)
    assert advice.text.startswith(
        "give drawing the opposite axis (the tool's z axis the other way round) (checked: all goals can then be planned"
    )
    strokes = [goal.name for goal in request.goals if goal.by == "path"]
    assert len(strokes) > 1
    assert advice.change.to_json() == {"change": "turn tool", "what": "drawing", "paths": sorted(strokes)}
    pairs = zip(request.goals, advice.change.apply(request).goals, strict=True)
    for before, after in pairs:
        if before.name in strokes:
            np.testing.assert_array_equal(after.T_base_tool[..., :3, 2], -before.T_base_tool[..., :3, 2])
            np.testing.assert_array_equal(after.T_base_tool[..., :3, 3], before.T_base_tool[..., :3, 3])
        else:
            assert after is before


def test_repeats_and_grids_visit_all_places_in_order(tmp_path: Path) -> None:
    text = OPEN[: OPEN.index('[[steps]]\nname = "wire"')]
    text = text.replace("dwell_s = 0.5", "grid.count = [2, 2, 1]\ngrid.step_mm = [30, 40, 0]")
    task = read_program(program(tmp_path, text))
    plan = plan_of_program(task, Observation(), 1.0)
    reached = [r for r in plan.task["reached"] if r["name"].startswith("above")]
    assert [r["name"] for r in reached] == ["above", "above (2)", "above (3)", "above (4)"]
    at = [(inverse(task.T_on_work) @ task.cell.robot().T_base_tool(np.array(r["q"])))[:3, 3] for r in reached]
    places = [[0, 0, 0.3], [0.03, 0, 0.3], [0, 0.04, 0.3], [0.03, 0.04, 0.3]]
    np.testing.assert_allclose(at, places, atol=1e-4)


@pytest.mark.slow
def test_commands_take_program_files_as_they_take_tasks(tmp_path: Path) -> None:
    file, plan = program(tmp_path, OPEN), tmp_path / "plan.json"
    said, _ = a465("plan", file, "-o", plan, "--speed", "1", "--json")
    told = json.loads(said)
    assert told["title"] == "a test"
    assert told["min_clearance_mm"] >= 6.0
    assert read_plan(plan).sha256 == told["plan_sha256"]
    a465("check", plan, file)
    a465("preview", plan, file, "-o", tmp_path / "page.html")
    assert '"bar"' in (tmp_path / "page.html").read_text()
    a465("export", plan, "--format", "urdf", "-o", tmp_path / "alone")
    a465("export", file, "-o", tmp_path / "file")
    assert "bar" in (tmp_path / "file/cell.urdf").read_text()
    _, told_wrong = a465("check", file, plan, code=2)
    assert "are swapped" in told_wrong or "plan" in told_wrong


@pytest.mark.slow
def test_a_program_is_executed_in_the_simulated_cell_without_a_command_to_jaws(tmp_path: Path) -> None:
    file, plan = program(tmp_path, OPEN), tmp_path / "plan.json"
    file.with_name("cell.world.toml").write_text("boards = []\n")  # for all programs of the cell
    a465("plan", file, "-o", plan, "--speed", "1")
    said, _ = a465("execute", plan, file, "--json", "--time-scale", "100", cwd=tmp_path)
    report = json.loads(said)
    assert (report["kind"], report["plan_sha256"]) == ("program", read_plan(plan).sha256)
    folder = tmp_path / report["folder"]
    axis = read_program(file).cell.unit.gripper.axis
    wire = [json.loads(line) for line in (folder / "wire.jsonl").read_text().splitlines()]
    sent = {entry["data"] for entry in wire if entry["kind"] == "sent"}
    assert any(line.startswith("COORDMV") for line in sent)
    assert not any(line.startswith((f"G{axis}:", f"RELEASE{axis}:", f"ANAXSETUP{axis}:")) for line in sent)
    a465("report", folder)


def test_a_look_is_asked_for_where_it_is_needed(tmp_path: Path) -> None:
    file = program(tmp_path, OPEN)
    _, told = a465("plan", file.with_name("task2.toml"), code=2)
    assert "has no jaws" in told or "--look is missing: boards have to be seen" in told
    replace_in(file, "[work]", "[work]\nboard = [1, 2]")
    _, told = a465("plan", file, code=2)
    assert "--look is missing: the workpiece of" in told
    with pytest.raises(ImpossibleError, match="board 01-02, on which the workpiece is, was not found"):
        program_scene(read_program(file), Observation())
    _, told = a465("reach", file, code=2)
    assert "--look is missing: the workpiece of" in told
