"""What a user can get wrong, at the command line: one line, the right exit code, no traceback, nothing moved."""

from __future__ import annotations

import json
import os
import pty
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from arm.errors import ExecutionStopped, ImpossibleError
from arm.files import data_file
from arm.se3 import transform
from cell.connection import Connection
from cell.taskfile import read_task
from cell.worldfile import board_placement
from whole_run import run_whole

pytestmark = pytest.mark.xdist_group("refusals")


def _change(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def _a465(
    *arguments: object, optimised: bool = False, code: int = 0, cwd: Path | None = None
) -> tuple[str, str]:
    flags = ["-O"] if optimised else []
    command = [sys.executable, *flags, "-c", "import cell.cli; cell.cli.main()", *map(str, arguments)]
    ran = subprocess.run(command, capture_output=True, text=True, check=False, cwd=cwd, timeout=120)
    assert ran.returncode == code, f"exit {ran.returncode}: {ran.stdout}{ran.stderr}"
    assert "Traceback" not in ran.stderr
    return ran.stdout, ran.stderr


def _refused(*arguments: object, code: int, cwd: Path) -> str:
    for optimised in (False, True):
        _, told = _a465(*arguments, code=code, cwd=cwd, optimised=optimised)
    lines = [line for line in told.splitlines() if line.startswith("a465:")]
    assert len(lines) == 1, told
    return lines[0]


@pytest.mark.parametrize(
    ("file", "old", "new", "words"),
    [
        ("cell.toml", 'unit = "crs93"', 'unit = "crs39"', ("cell.toml", "unit", "crs39", "crs93, crs97")),
        (
            "cell.toml",
            "positions_plate_01-02.csv",
            "missing.csv",
            ("cell.toml", "boards.files", "missing.csv"),
        ),
        (
            "boards/positions_plate_01-02.csv",
            "80,60",
            "80,sixty",
            ("positions_plate_01-02.csv", "line 3", "80,sixty"),
        ),
        ("task2.toml", "[3, 4]", "[3, 40]", ("task2.toml", "to_board", "[3, 40]", "[3, 4]")),
    ],
)
def test_wrong_files_end_with_2(scenes: Path, file: str, old: str, new: str, words: tuple[str, ...]) -> None:
    _change(scenes / file, old, new)
    told = _refused("run", scenes / "task2.toml", code=2, cwd=scenes)
    assert all(word in told for word in words), told


def test_a_marker_that_no_board_file_has_ends_with_2(scenes: Path) -> None:
    _change(scenes / "cell.toml", '  "boards/positions_plate_05-06.csv",\n', "")
    _change(scenes / "task2.world.toml", "positions_plate_03-04.csv", "positions_plate_05-06.csv")
    told = _refused("look", scenes / "task2.toml", code=2, cwd=scenes)
    assert "marker" in told
    assert "5" in told


def test_photographs_of_another_size_end_with_2(scenes: Path) -> None:
    folder = scenes / "photographs"
    _a465("render", scenes / "task2.toml", "-o", folder, "--count", 5)
    for file in folder.iterdir():
        cv2.imwrite(str(file), cv2.resize(cv2.imread(str(file)), (1280, 800)))
    told = _refused("look", scenes / "task2.toml", "--images", folder, code=2, cwd=scenes)
    assert "1280" in told
    assert "1920" in told


@pytest.fixture
def silent_port() -> Iterator[str]:
    """A serial line with nobody at the other end."""
    master, slave = pty.openpty()
    yield os.ttyname(slave)
    os.close(master)
    os.close(slave)


def test_ports_that_are_not_a_mars_end_with_2(scenes: Path, silent_port: str) -> None:
    folder = scenes / "photographs"
    _a465("render", scenes / "task2.toml", "-o", folder, "--count", 10)
    for port in (scenes / "nothing", scenes / "task2.toml", silent_port):
        told = _refused("run", scenes / "task2.toml", "--port", port, "--images", folder, code=2, cwd=scenes)
        assert str(port) in told or "MARS" in told


def test_photographs_of_the_cell_give_the_same_look_as_the_cell(scenes: Path) -> None:
    _a465("render", scenes / "task2.toml", "-o", scenes / "photographs", "--count", 5)
    seen = [
        json.loads(_a465("look", scenes / "task2.toml", *extra, "--json")[0])["scenes"][0]["boards"]
        for extra in ((), ("--images", scenes / "photographs"))
    ]
    for direct, photographed in zip(*seen, strict=True):
        assert direct["T_base_board"] == photographed["T_base_board"]
        assert [h["state"] for h in direct["holes"]] == [h["state"] for h in photographed["holes"]]


def test_optimised_python_makes_the_same_plan(scenes: Path) -> None:
    _a465("look", scenes / "task2.toml", "-o", scenes / "look.json")
    for name, optimised in (("plain", False), ("optimised", True)):
        out = scenes / f"{name}.json"
        _a465("plan", scenes / "task2.toml", "--look", scenes / "look.json", "-o", out, optimised=optimised)
    assert (scenes / "plain.json").read_bytes() == (scenes / "optimised.json").read_bytes()


def test_a_plan_for_another_camera_arm_or_limits_is_refused(scenes: Path) -> None:
    _a465("look", scenes / "task2.toml", "-o", scenes / "look.json")
    _a465("plan", scenes / "task2.toml", "--look", scenes / "look.json", "-o", scenes / "plan.json")
    _a465("check", scenes / "plan.json", scenes / "task2.toml")
    for file, old, new, word in (
        ("cameras/lab.toml", "1072.72375", "1071.72375", "calibration"),
        ("cell.toml", 'unit = "crs93"', 'unit = "crs97"', "unit"),
        ("cell.toml", "# acceleration_registers = [51,", "acceleration_registers = [50,", "limits"),
    ):
        before = (scenes / file).read_text()
        _change(scenes / file, old, new)
        told = _refused("execute", scenes / "plan.json", scenes / "task2.toml", code=3, cwd=scenes)
        assert word in told
        (scenes / file).write_text(before)


def _planned(scenes: Path) -> Path:
    plan = scenes / "plan.json"
    _a465("look", scenes / "task2.toml", "-o", scenes / "look.json")
    _a465("plan", scenes / "task2.toml", "--look", scenes / "look.json", "-o", plan)
    return plan


def test_a_cell_that_got_another_wall_refuses_the_plan(scenes: Path) -> None:
    plan = _planned(scenes)
    wall = '\n[[walls]]\nname = "new"\ncentre_mm = [360, -340, 160]\nsize_mm = [40, 40, 40]\n'
    (scenes / "cell.toml").write_text((scenes / "cell.toml").read_text() + wall)
    for verb in ("check", "execute"):
        told = _refused(verb, plan, scenes / "task2.toml", code=3, cwd=scenes)
        assert "not for the cell of now: cell.toml: walls[new] is new; plan again" in told
    # an old plan can still be looked at
    out, warned = _a465("preview", plan, scenes / "task2.toml", "-o", scenes / "old.html", "--json")
    assert "WARNING: the plan is not for the cell of now: cell.toml: walls[new] is new" in warned
    assert json.loads(out)["warning"].startswith("the plan is not for the cell of now")
    assert (scenes / "old.html").stat().st_size > 100_000
    value = json.loads(plan.read_text())  # even if somebody makes the file say that it is for this cell
    value["provenance"]["task"] = read_task(scenes / "task2.toml").digest
    plan.write_text(json.dumps(value))
    told = _refused("check", plan, scenes / "task2.toml", code=3, cwd=scenes)
    assert "scene is not that of the cell of now: new" in told


def _without_walls(value: dict[str, Any]) -> None:
    value["scene"]["bodies"] = [b for b in value["scene"]["bodies"] if b["kind"] not in ("table", "wall")]


def _tiny(value: dict[str, Any]) -> None:
    for body in value["scene"]["bodies"]:
        body["shape"] = {"sphere": 1e-3}


def _all_may_touch(value: dict[str, Any]) -> None:
    names = [b["name"] for b in value["scene"]["bodies"]]
    value["scene"]["allowed"] = [sorted((c["name"], n)) for c in value["scene"]["cubes"] for n in names]


def _swapped_cubes(value: dict[str, Any]) -> None:
    for step in value["steps"]:
        if step.get("cube") in (0, 1):
            step["cube"] = 1 - step["cube"]


def _straight_jerks(value: dict[str, Any]) -> None:
    move = next(s for s in value["steps"] if s["step"] == "move" and s["role"] == "transit")
    move["segments"] = [
        [s[0], [sum(column) for column in zip(*s[1:], strict=True)]] for s in move["segments"]
    ]


def _no_cubes(value: dict[str, Any]) -> None:
    value["task"] = {}


def _no_clearance(value: dict[str, Any]) -> None:
    for step in value["steps"]:
        if step["step"] == "move":
            step["clearance"] = 0.0
            step["clearances"] = [0.0] * len(step["segments"])


def _shut_jaws(value: dict[str, Any]) -> None:
    for step in value["steps"]:
        if step["step"] == "gripper" and step["action"] == "open":
            step["fraction_closed"] = 0.9


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (_without_walls, "camera post"),
        (_tiny, "plate 01-02"),
        (_all_may_touch, "contact of"),
        (_swapped_cubes, "out of order"),
        (_straight_jerks, "jump of velocity"),
        (_no_cubes, "task.cubes"),
        (_no_clearance, "asked for"),
        (_shut_jaws, "says open but closes"),
    ],
    ids=lambda v: v.__name__.strip("_") if callable(v) else "",
)
def test_a_plan_file_that_was_tampered_with_is_refused(
    scenes: Path, change: Callable[[dict[str, Any]], None], words: str
) -> None:
    plan = _planned(scenes)
    value = json.loads(plan.read_text())
    change(value)
    plan.write_text(json.dumps(value))
    _, told = _a465("check", plan, scenes / "task2.toml", code=3, cwd=scenes)
    assert words in told


def test_a_plan_is_not_executed_where_a_hole_holds_a_cube_by_now(scenes: Path) -> None:
    plan = _planned(scenes)
    _change(scenes / "task2.world.toml", "cubes = []", "cubes = [1]")
    _, told = _a465("execute", plan, scenes / "task2.toml", "--time-scale", 30, code=3, cwd=scenes)
    assert "hole 03-04/1 looks cube, the plan has it empty" in told


def test_a_plan_whose_certificate_was_tampered_with_is_refused(scenes: Path) -> None:
    _a465("look", scenes / "task2.toml", "-o", scenes / "look.json")
    _a465("plan", scenes / "task2.toml", "--look", scenes / "look.json", "-o", scenes / "plan.json")
    plan = json.loads((scenes / "plan.json").read_text())
    move = next(s for s in plan["steps"] if s["step"] == "move" and s["role"] == "transit")
    move["clearance"] += 0.01
    move["clearances"] = [c + 0.01 for c in move["clearances"]]
    (scenes / "plan.json").write_text(json.dumps(plan))
    told = _refused("check", scenes / "plan.json", scenes / "task2.toml", code=3, cwd=scenes)
    assert move["name"] in told


def test_a_hole_out_of_reach_ends_with_3_before_anything_moves(scenes: Path, tmp_path: Path) -> None:
    world = scenes / "task2.world.toml"
    _change(world, "centre_mm = [460, 110, 40]", "centre_mm = [460, 110, 80]")
    _change(world, "tilt_deg = 7", "tilt_deg = 25")
    _change(world, "lean_azimuth_deg = 265", "lean_azimuth_deg = 180")
    run = run_whole(scenes / "task2.toml", tmp_path / "run")
    assert isinstance(run.error, ImpossibleError)
    assert "hole 01-02/4: best branch" in str(run.error)
    assert "joint J3 goes" in str(run.error)
    assert run.error.data["holes"][0]["excess_deg"] > 1.0
    assert run.record is not None
    assert len(run.record.time_ms) == 0
    assert all(line.split(":")[0] in ("", "ECHO", "STAMP", "VER?") for _, line in run.sent)


def test_a_board_that_moves_on_the_way_makes_the_rest_be_planned_anew(tmp_path: Path) -> None:
    def meddle(connection: Connection) -> None:
        simulated, grab, looks = connection.simulated, connection.frames.grab, [0]
        assert simulated is not None

        def pushed(count: int) -> list[np.ndarray]:
            looks[0] += 1
            if looks[0] == 3:  # between the first cube and the look after it, board and cube are pushed
                push = transform(t=(0.006, 0.004, 0.0))
                source, target = simulated.world.boards
                target = replace(target, T_base_board=push @ target.T_base_board)
                simulated.world = replace(simulated.world, boards=(source, target))
                moved = next(i for i, c in enumerate(simulated._cubes) if c.name == simulated.events[-1].cube)
                simulated._cubes[moved] = replace(
                    simulated._cubes[moved], T_base_cube=push @ simulated._cubes[moved].T_base_cube
                )
            return grab(count)

        connection.frames.grab = pushed  # type: ignore[method-assign]

    run = run_whole(data_file("scenes/task2.toml"), tmp_path, meddle=meddle)
    assert run.error is None, run.said
    assert any("board 03-04 moved by 7.2 mm" in remark for remark in run.report["remarks"])
    assert len(run.report["plans_sha256"]) == 2
    assert [c["placed"] for c in run.report["cubes"]] == [True] * 4
    assert max(c["error_mm"] for c in run.report["cubes"]) <= 1.0


def test_a_cube_taken_from_under_the_jaws_stops_the_run_with_the_arm_at_q_start(tmp_path: Path) -> None:
    def meddle(connection: Connection) -> None:
        simulated = connection.simulated
        assert simulated is not None
        close, count = simulated._close, [0]

        def stolen(T_base_tool: np.ndarray, target: float) -> float:
            count[0] += 1
            if count[0] == 2:  # the second cube is taken away under the closing jaws
                away = board_placement((0.2, 0.6, 0.02), 0.0, 0.0, 0.0)
                gaps = [np.linalg.norm((c.T_base_cube - T_base_tool)[:3, 3]) for c in simulated._cubes]
                between = int(np.argmin(gaps))
                simulated._cubes[between] = replace(
                    simulated._cubes[between], T_base_cube=away, where="table"
                )
            return close(T_base_tool, target)

        simulated._close = stolen  # type: ignore[method-assign]

    run = run_whole(data_file("scenes/task2.toml"), tmp_path, meddle=meddle)
    assert isinstance(run.error, ExecutionStopped)
    cubes = run.error.data["cubes"]
    assert [c["placed"] for c in cubes] == [True, False]
    assert f"the cube of {cubes[1]['from']} is gone from its hole" in str(run.error)
    assert run.record is not None
    unit = run.task.cell.unit
    assert unit.positions(run.record.counts[-1]) == pytest.approx(run.task.cell.q_start, abs=2e-5)


def test_a_cube_lost_on_the_way_and_jaws_that_stay_shut_stop_the_run(tmp_path: Path) -> None:
    def lose(connection: Connection) -> None:
        """The jaws of the unit close further in the middle of the carrying motion."""
        emulator, frames = connection.emulator, connection.mars.note
        assert emulator is not None

        def note(kind: str, **data: object) -> None:
            if kind == "step" and str(data["name"]).endswith("to 03-04/1"):
                emulator.machine.jaws._at -= 100.0
            frames(kind, **data)

        connection.mars.note = note  # type: ignore[method-assign]

    def slip(connection: Connection) -> None:
        """They are found further closed where the cube is to be let go."""
        mars = connection.mars
        read = mars.jaws
        mars.jaws = lambda: min(1.0, read() + 0.3)  # type: ignore[method-assign]

    def jam(connection: Connection) -> None:
        simulated = connection.simulated
        assert simulated is not None
        simulated._open = lambda T, target: 1.0 - simulated.jaw_opening / simulated.cell.jaw_opening  # type: ignore

    for meddle, step, words in (
        (lose, "to 03-04/1", "was lost on the way"),
        (slip, "let go", "was lost on the way"),
        (jam, "", "the jaws do not open to let go"),
    ):
        run = run_whole(data_file("scenes/task2.toml"), tmp_path / meddle.__name__, meddle=meddle)
        assert isinstance(run.error, ExecutionStopped), run.said
        assert words in str(run.error)
        assert step in run.error.data.get("step", "")
        assert ("is in the jaws" in str(run.error)) == (meddle is jam)
        report = json.loads((run.folder / "report.json").read_text())
        assert report["error"]["exit_code"] == 4


def test_jaws_that_fail_to_hold_a_cube_leave_it_and_go_on(tmp_path: Path) -> None:
    def meddle(connection: Connection) -> None:
        simulated = connection.simulated
        assert simulated is not None
        close, count = simulated._close, [0]

        def slipping(T_base_tool: np.ndarray, target: float) -> float:
            count[0] += 1
            return target if count[0] == 2 else close(T_base_tool, target)

        simulated._close = slipping  # type: ignore[method-assign]

    run = run_whole(data_file("scenes/task2.toml"), tmp_path, meddle=meddle)
    assert run.error is None, run.said
    cubes = run.report["cubes"]
    assert [c["placed"] for c in cubes] == [True, False, True, True]
    assert {c["from"] for c in cubes} == {f"01-02/{n}" for n in (1, 2, 3, 4)}
    assert any(f"{cubes[1]['from']} is not where it should be" in remark for remark in run.report["remarks"])


def test_a_cube_taken_away_before_its_turn_is_told_and_left_out(tmp_path: Path) -> None:
    taken_from: list[str] = []

    def meddle(connection: Connection) -> None:
        simulated, grab, looks = connection.simulated, connection.frames.grab, [0]
        assert simulated is not None

        def taken(count: int) -> list[np.ndarray]:
            looks[0] += 1
            if looks[0] == 3:
                gone = next(c for c in reversed(simulated._cubes) if c.name != simulated.events[-1].cube)
                simulated._cubes = [c for c in simulated._cubes if c is not gone]
                taken_from.append(f"01-02/{gone.name.split()[1]}")
            return grab(count)

        connection.frames.grab = taken  # type: ignore[method-assign]

    run = run_whole(data_file("scenes/task2.toml"), tmp_path, meddle=meddle)
    assert run.error is None, run.said
    (hole,) = taken_from
    assert {c["from"] for c in run.report["cubes"]} == {f"01-02/{n}" for n in (1, 2, 3, 4)} - {hole}
    assert any(f"hole {hole} looks empty, not cube" in remark for remark in run.report["remarks"])
