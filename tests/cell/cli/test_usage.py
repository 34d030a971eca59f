"""A command line that no command takes is answered with where its words belong."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from typed.command_line import a465


@pytest.mark.parametrize(
    ("typed", "help"),
    [
        ("home c.toml --port mars", "(port is an argument and has no option: a465 home CELL [PORT])"),
        ("move c.toml mars --by 0 0 50", "(the values of a list are joined by commas: --by=0,0,50)"),
        ("move c.toml mars --by=0 0 50", "(the values of a list are joined by commas: --by=0,0,50)"),
        ("run t.toml --resume", "No such option: --resume (--resume belongs to execute); see"),
        ("doctor --images x", "No such option: --images (it is --camera here); see"),
        ("new-cell hall crs93", "(a unit is given by --unit crs93)"),
        ("--json plan t.toml", "(--json stands after the command: a465 plan ... --json)"),
        ("plan t.toml --speed 0,3", "'0,3' is not a number (the decimal sign is a point: 0.3)"),
        ("plan t.toml -speed=0.3", "(it is --speed)"),
        ("check t.toml -q 0,0,0", "(it is --q)"),
        ("Check t.toml", "(it is check, in small letters)"),
        ("plan --task t.toml", "(task is an argument and has no option: a465 plan FILE POSES)"),
        ("execute --plan p.json", "(plan is an argument and has no option: a465 execute PLAN TASK)"),
        ("look a.toml poses.json r.json", "(one file belongs here: did the shell replace a * by several?)"),
        (
            "gripper c.toml /dev/null open",
            "c.toml: is a file; the action comes first, then the cell, then the port",
        ),
        ("reset", "No such command 'reset'; see a465 --help"),  # release, which is alike, may drop the arm
        ("run t.toml --speed 30s", "(give the number alone, such as 30; the help states its unit)"),
        ("calibrate camera x --world y", "No such option: --world (Possible options: "),
        ("home --cell c.toml mars", "(cell is an argument and has no option: a465 home CELL [PORT])"),
        ("status --port mars", "(port is an argument and has no option: a465 status [PORT] [CELL])"),
        (
            "gripper open c.toml --width 4",
            "width is an argument and has no option: a465 gripper open|close|WIDTH",
        ),
        (
            "gripper -5 c.toml",
            "No such option: -5 (a word that begins with - is taken for an option; gripper",
        ),
        ("run t.toml /dev/null", "(the port is given by --port /dev/null); see"),
        ("execute p.json socket://h:1 t.toml", "(the port is given by --port socket://h:1); see"),
        ("execute p.json /dev/null t.toml", "(the port is given by --port /dev/null); see"),
        ("run t.toml --port /dev/null x.toml", "extra argument(s) (x.toml); see"),
        ("snap c.toml /dev/null -o seen", "(snap opens no port); see"),
        ("move c.toml mars poses.json --name a", "(a list is given by --list poses.json); see"),
        ("release mars --yes", "No such option: --yes (it is --supported here); see"),
        (
            "run t.toml --dry-run",
            "No such option: --dry-run (without --port the simulated cell is used); see",
        ),
        ("emulate --cell c.toml", "No such option: --cell (it is --task here); see"),
        ("emulate --speed 2", "No such option: --speed (it is --time-scale here); see"),
        ("calibrate intrinsics photos", "(it is a465 calibrate camera IMAGES); see"),
        ("calibrate nao r.json", "(it is a465 calibrate kinematic DATA); see"),
        ("calibrate r.json", "(what is calibrated comes first: a465 calibrate hand-eye r.json); see"),
        ("calibrate photos", "(what is calibrated comes first: a465 calibrate camera photos); see"),
        ("look photos t.toml", "(a folder of images is given by --images photos); see"),
        ("look a.toml b.toml", "look: Got unexpected extra argument(s) (b.toml); see a465 look"),
    ],
)
def test_words_are_told_where_they_belong(
    typed: str, help: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("poses.json").write_text('{"entries": []}')
    Path("r.json").write_text('{"poses": [], "dh": {}, "camera": {}, "target": {}}')
    Path("photos").mkdir()
    assert help in a465(*typed.split(), code=2)[1]


@pytest.mark.parametrize(
    ("typed", "where"),
    [
        (["plan", "task2.toml", "--look", ""], "--look is empty"),
        (["plan", "task2.toml", "--look="], "--look is empty"),
        (["plan", "", "poses.json"], "the argument after plan is empty"),
        ([""], "the argument after a465 is empty"),
    ],
)
def test_an_argument_of_an_unset_variable_is_no_path(typed: list[str], where: str) -> None:
    told = a465(*typed, code=2)[1]
    assert told == f"a465: wrong input: {where}; is a variable of the shell not set?\n"


def test_what_the_system_refuses_is_one_line(scenes: Path, tmp_path: Path) -> None:
    told = a465("view", scenes / "cell.toml", "-o", f"{'x' * 300}.html", code=2, cwd=tmp_path)[1]
    assert told == f"a465: wrong input: {'x' * 300}.html: File name too long\n"


def test_names_that_the_terminal_cannot_show_are_escaped(scenes: Path, tmp_path: Path) -> None:
    named = scenes.rename(tmp_path / "große")
    typed = [sys.executable, "-m", "a465", "check", named / "cell.toml", "--q=0,10,-80,0,-60,0"]
    ascii = os.environ | {"PYTHONIOENCODING": "ascii"}
    said = subprocess.run(typed, env=ascii, capture_output=True, text=True, timeout=60, check=True).stdout
    assert said.endswith("gro\\xdfe/cell.toml: free\n")


def test_a_cell_file_that_is_no_argument_is_told_its_option(scenes: Path) -> None:
    cell = str(scenes / "cell.toml")
    assert f"(a cell is given by --cell {cell}); see" in a465("doctor", cell, code=2)[1]


def test_json_takes_no_file(scenes: Path) -> None:
    told = a465("plan", str(scenes / "task2.toml"), "--json", "plan.json", code=2)[1]
    assert "plan.json: cannot be read: No such file" in told
    assert told.endswith("; --json takes no file: its object goes to standard output\n")


def test_a_path_with_a_space_that_the_shell_split_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("my cell").mkdir()
    Path("my cell/task.toml").write_text("")
    told = a465("look", "my", "cell/task.toml", code=2)[1]
    assert told == "a465: wrong input: a path with a space needs quotes: 'my cell/task.toml'\n"
    assert "needs quotes" not in a465("look", "my", "cell/tusk.toml", code=2)[1]


def test_an_option_that_a_command_does_not_need_is_told() -> None:
    assert (
        "(run looks itself; a look that is there is planned by" in a465("run", "t", "--look", "l", code=2)[1]
    )
    assert "(a look is made in a world: a465 look TASK" in a465("plan", "t", "--world", "w", code=2)[1]
