"""What a user can get wrong, at the command line: one line, the right exit code, no traceback, nothing moved."""

from __future__ import annotations

import json
import os
import pty
import shutil
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import cv2
import pytest

from arm.errors import ImpossibleError, InputError
from arm.io.storage import data_file
from cell.commands.run import execute_plan
from cell.console import Console
from cell.session.connection import WhichCell
from tasks.small import small_scenes
from tasks.whole_run import run_whole
from typed.command_line import a465, refused, replace_in

pytestmark = pytest.mark.xdist_group("refusals")


@pytest.mark.parametrize("verb", ["check", "preview", "execute"])
def test_a_plan_and_its_task_in_the_wrong_order_are_told_which_is_which(
    scenes: Path, tmp_path: Path, verb: str
) -> None:
    plan, task = tmp_path / "plan.json", scenes / "task2.toml"
    plan.write_text('{"format": "a465-plan/3"}')
    for first in (task, scenes / "cell.toml"):
        _, told = a465(verb, first, plan, code=2, cwd=tmp_path, optimised=verb == "check" and first == task)
        assert f"are swapped: the plan comes first, then its task; give a465 {verb} {plan} {first}" in told
        assert sum(line.startswith("a465:") for line in told.splitlines()) == 1, told
    assert "swapped" not in a465(verb, plan, task, code=2, cwd=tmp_path)[1]


@pytest.mark.slow
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
    replace_in(scenes / file, old, new)
    told = refused("run", scenes / "task2.toml", code=2, cwd=scenes)
    assert all(word in told for word in words), told


@pytest.mark.slow
def test_a_marker_that_no_board_file_has_ends_with_2(scenes: Path) -> None:
    replace_in(scenes / "cell.toml", '  "boards/positions_plate_05-06.csv",\n', "")
    replace_in(scenes / "task2.world.toml", "positions_plate_03-04.csv", "positions_plate_05-06.csv")
    told = refused("look", scenes / "task2.toml", code=2, cwd=scenes)
    assert "marker" in told
    assert "5" in told


@pytest.mark.slow
def test_photographs_of_another_size_end_with_2(scenes: Path) -> None:
    folder = scenes / "photographs"
    a465("render", scenes / "task2.toml", "-o", folder, "--count", 5)
    for file in folder.iterdir():
        cv2.imwrite(str(file), cv2.resize(cv2.imread(str(file)), (1280, 800)))
    told = refused("look", scenes / "task2.toml", "--images", folder, code=2, cwd=scenes)
    assert "1280" in told
    assert "1920" in told


@pytest.fixture
def silent_port() -> Iterator[str]:
    """A serial line with nobody at the other end."""
    master, slave = pty.openpty()
    yield os.ttyname(slave)
    os.close(master)
    os.close(slave)


@pytest.mark.slow
def test_ports_that_are_not_a_mars_end_with_2(scenes: Path, silent_port: str) -> None:
    folder = scenes / "photographs"
    a465("render", scenes / "task2.toml", "-o", folder, "--count", 5)
    for port in (scenes / "nothing", scenes / "task2.toml", silent_port):
        run = ("run", scenes / "task2.toml", "--port", port, "--images", folder)
        _, told = a465(*run, code=2, cwd=scenes, optimised=port == scenes / "nothing")
        assert str(port) in told or "MARS" in told


@pytest.mark.slow
def test_photographs_of_the_cell_give_the_same_look_as_the_cell(tmp_path: Path) -> None:
    scenes = small_scenes(tmp_path)
    a465("render", scenes / "task2.toml", "-o", scenes / "photographs", "--count", 2)
    seen = [
        json.loads(a465("look", scenes / "task2.toml", *extra, "--json")[0])["scenes"][0]["boards"]
        for extra in ((), ("--images", scenes / "photographs"))
    ]
    for direct, photographed in zip(*seen, strict=True):
        assert direct["T_base_board"] == photographed["T_base_board"]
        assert [h["state"] for h in direct["holes"]] == [h["state"] for h in photographed["holes"]]


@pytest.mark.slow
def test_optimised_python_makes_the_same_plan(scenes: Path) -> None:
    a465("look", scenes / "task2.toml", "-o", scenes / "look.json")
    for name, optimised in (("plain", False), ("optimised", True)):
        out = scenes / f"{name}.json"
        a465("plan", scenes / "task2.toml", "--look", scenes / "look.json", "-o", out, optimised=optimised)
    assert (scenes / "plain.json").read_bytes() == (scenes / "optimised.json").read_bytes()


@pytest.mark.slow
def test_a_hole_out_of_reach_ends_with_3_before_anything_moves(scenes: Path, tmp_path: Path) -> None:
    world = scenes / "task2.world.toml"
    replace_in(world, "centre_mm = [460, 110, 40]", "centre_mm = [460, 110, 80]")
    replace_in(world, "tilt_deg = 7", "tilt_deg = 25")
    replace_in(world, "lean_azimuth_deg = 265", "lean_azimuth_deg = 180")
    run = run_whole(scenes / "task2.toml", tmp_path / "run")
    assert isinstance(run.error, ImpossibleError)
    assert "hole 01-02/4: best branch" in str(run.error)
    assert "joint J3 goes" in str(run.error)
    assert run.error.data["holes"][0]["excess_deg"] > 1.0
    assert run.record is not None
    assert len(run.record.time_ms) == 0
    assert all(line.split(":")[0] in ("", "ECHO", "STAMP", "VER?") for _, line in run.sent)


@pytest.mark.parametrize(
    ("verb", "read", "words"),
    [
        ("plan", "drawing.svg", "is read by this command, so it is not overwritten"),
        ("plan", "cell.toml", "is a cell file, and something else would replace it"),
        ("view", "tools/pen.toml", "is a tool file, and something else would replace it"),
    ],
)
def test_a_file_that_the_program_names_is_not_overwritten(
    tmp_path: Path, verb: str, read: str, words: str
) -> None:
    pen = Path(shutil.copytree(data_file("scenes"), tmp_path / "scenes")) / "pen"
    before = (pen / read).read_bytes()
    _, told = a465(verb, pen / "drawing.toml", "-o", pen / read, code=2, cwd=tmp_path)
    assert f"{read}: {words}" in told
    assert (pen / read).read_bytes() == before


@pytest.mark.parametrize(
    ("typed", "words"),
    [
        (("home", "/dev/mars"), "home CELL /dev/mars"),
        (("park", "/dev/mars"), "park CELL /dev/mars"),
        (("jog", "socket://127.0.0.1:9"), "jog CELL socket://127.0.0.1:9"),
        (("move", "/dev/mars", "--q=0,0,0,0,0,0"), "move CELL /dev/mars"),
        (("gripper", "open", "/dev/mars"), "gripper ACTION CELL /dev/mars"),
        (("teach", "poses.json", "/dev/mars"), "teach LIST CELL /dev/mars"),
        (("home", "/etc/../dev/null"), "home CELL /etc/../dev/null"),
    ],
)
def test_a_port_without_the_cell_is_told(typed: tuple[str, ...], words: str) -> None:
    _, told = a465(*typed, code=2)
    port = words.rpartition(" ")[2]
    assert f"{port}: is a port; the cell or task file is missing before it: a465 {words}\n" in told


@pytest.mark.parametrize("verb", ["home", "park", "jog"])
def test_a_cell_and_a_port_in_the_wrong_order_are_told(verb: str) -> None:
    _, told = a465(verb, "mars", "scenes/cell.toml", code=2)
    assert (
        "scenes/cell.toml: a file is where the port belongs; the cell or task file comes before the port"
        in told
    )


def test_a_file_of_another_kind_is_told_as_that_with_what_belongs_there(tmp_path: Path) -> None:
    (tmp_path / "look.json").write_text('{"boards": {}}')
    scenes = data_file("scenes")
    cell, task, lens = (scenes / name for name in ("cell.toml", "task2.toml", "cameras/lab.toml"))
    for typed, words in (
        (("plan", tmp_path / "look.json"), "is JSON, such as a look or a plan, and a TOML file belongs here"),
        (
            ("run", cell),
            "is a cell file, and a task or a program file belongs here (a task file names it: cell =",
        ),
        (
            ("plan", scenes / "pen/drawing.toml", tmp_path / "look.json"),
            f"is a program file, which has its steps itself: leave out {tmp_path / 'look.json'}, or give a cell file",
        ),
        (("reach", cell, "--look", task), "is a cell file, and a task file belongs here"),
        (("plan", task, "--look", cell), "is a cell file, and a look belongs here"),
        (("execute", task), "is a task file, and a plan belongs here"),
        (("look", lens), "is a camera file, and a task, a program, a cell or an arm file belongs here"),
        (("look", task, "--world", cell), "is a cell file, and a world file belongs here"),
        (
            ("look", cell),
            f"is a cell file, and worlds stand beside task files; give a task file ({scenes / 'task1'}",
        ),
        (("emulate", "--fault", task), "is a task file, and a file of faults belongs here"),
        (("calibrate", "target", cell), "is a cell file, and a target file belongs here"),
        (
            ("gripper", cell, "mars", "open"),
            f"the action comes first, then the cell: a465 gripper open {cell} mars",
        ),
        (("gripper", cell, "45"), f"a465 gripper 45 {cell}"),
        (("gripper", cell, "mars"), f"a465 gripper open|close|WIDTH {cell} mars"),
        (("gripper", cell, "open"), f"the action comes first, then the cell: a465 gripper open {cell}"),
        (("calibrate", "following", task), "is a task file, and the log of a run belongs here"),
        (("teach", cell, "poses.json"), "the list comes first, then the cell or task file"),
    ):
        _, told = a465(*typed, code=2, cwd=tmp_path)
        assert words in told, told
        assert told.count("\n") == 1, told
    assert [file.name for file in tmp_path.iterdir()] == ["look.json"]


def test_what_is_wrong_at_once_is_told_before_slow_work(tmp_path: Path) -> None:
    task = data_file("scenes/task2.toml")
    (tmp_path / "file").touch()
    for typed, words in (
        (("render", task, "-o", tmp_path / "file"), "file: is a file; give a folder for the images"),
        (("render", task, "-o", tmp_path / "new", "--seed=-1"), "--seed -1: must be 0 or more"),
        (
            ("park", task, "/dev/mars-not-there", "--unseen", "--look", task),
            "is a task file, and a look belongs here",
        ),
        (("home", data_file("scenes/cell.toml"), "/dev/mars-not-there", "--free"), "is not there"),
    ):
        assert words in a465(*typed, code=2, cwd=tmp_path)[1]
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == ["file"]


def test_a_time_scale_is_told_before_a_plan_is_verified(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cell.commands.run._plan_to_send", lambda _: SimpleNamespace(speed=0.5))
    monkeypatch.setattr("cell.commands.run.replayed", lambda *_: pytest.fail("the plan was verified first"))
    where = WhichCell(time_scale=1000.0)
    with pytest.raises(InputError, match="--time-scale 1000: must be from"):
        execute_plan(Path("plan.json"), data_file("scenes/task2.toml"), Console(True), where)


def test_a_picture_is_not_written_under_the_name_of_another_kind(tmp_path: Path) -> None:
    task = data_file("scenes/task2.toml")
    _, told = a465("look", task, "-o", tmp_path / "a.png", "--picture", tmp_path / "look.json", code=2)
    assert "look.json: must end in .png" in told
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("task2.toml --images none", "none: no such folder of images"),
        ("task2.toml --images shots --camera video:0", "--camera"),
        ("task2.toml --images shots --time-scale 2", "--time-scale 2 is for the simulated cell"),
        ("task2.toml --images shots --speed 0.9", "--speed 0.9: must be from 0.01 to 0.5"),
        ("task2.toml --images shots", "port none: is not there"),
        ("task1.toml --images shots", "port none: is not there"),
    ],
)
def test_what_is_wrong_is_told_before_a_person_is_asked(
    planned_scenes: Path, monkeypatch: pytest.MonkeyPatch, options: str, words: str
) -> None:
    monkeypatch.chdir(planned_scenes)
    Path("shots").mkdir(exist_ok=True)
    _, told = a465("execute", "plan.json", *options.split(), "--port", "none", code=2)
    assert words in told
    assert "terminal" not in told


def test_a_plan_of_another_task_is_told_before_a_person_is_asked(
    planned_scenes: Path, silent_port: str
) -> None:
    (planned_scenes / "shots").mkdir(exist_ok=True)
    port = ("--port", silent_port, "--images", "shots")
    told = a465("execute", "plan.json", "task1.toml", *port, code=3, cwd=planned_scenes)[1]
    assert "the plan is for task task2" in told
    told = a465("execute", "plan.json", "task2.toml", *port, code=2, cwd=planned_scenes)[1]
    assert "no terminal to confirm plan.json: give --yes CODE" in told
