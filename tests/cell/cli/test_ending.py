"""A run ends with a code of its own if a cube is left; an error ends in one line, and as an object with --json."""

from __future__ import annotations

import json
import sys

import pytest
import typer

from arm.errors import ImpossibleError
from cell.cli.ending import fail, finish
from cell.console import Console
from typed.command_line import a465


def test_a_run_that_leaves_cubes_names_them_and_exits_with_its_code(
    capsys: pytest.CaptureFixture[str],
) -> None:
    cubes = [{"from": f"01-02/{hole}", "placed": hole > 2} for hole in (1, 2, 3)]
    with pytest.raises((SystemExit, typer.Exit)) as ended:
        finish(Console(), {"cubes": cubes})
    assert getattr(ended.value, "exit_code", getattr(ended.value, "code", None)) == 4
    assert "not placed: 01-02/1, 01-02/2; the arm is at q_start" in capsys.readouterr().err
    finish(Console(), {"cubes": cubes[2:]})


@pytest.mark.parametrize("as_json", [False, True])
def test_an_error_is_one_line_and_an_object_if_asked_for(
    as_json: bool, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["a465", "plan", *(["--json"] if as_json else [])])
    with pytest.raises(SystemExit) as ended:
        fail(ImpossibleError("no way", pair=["palm", "post"]))
    assert ended.value.code == 3
    said = capsys.readouterr()
    assert said.err == "a465: refused: no way\n"
    if not as_json:
        assert said.out == ""
        return
    body = json.loads(said.out)["error"]
    assert (body["kind"], body["exit_code"], body["pair"]) == ("ImpossibleError", 3, ["palm", "post"])


@pytest.mark.parametrize(
    ("typed", "words", "help"),
    [
        ("plann scenes/task2.toml", ("plann", "Did you mean 'plan'?"), "a465"),
        ("--verbose plan", ("No such option: --verbose", "--version"), "a465"),
        ("plan --speeed 0.5 t.toml", ("plan: No such option: --speeed", "--speed)"), "a465 plan"),
        ("plan t.toml --look", ("plan: Option '--look' requires an argument",), "a465 plan"),
        ("plan", ("plan: Missing argument 'FILE'",), "a465 plan"),
        ("run t.toml --cell mujco", ("run: ", "'--cell'", "'mujco'", "'ideal', 'mujoco'"), "a465 run"),
        ("run t.toml --speed fast", ("run: ", "'--speed'", "'fast'"), "a465 run"),
        ("view c.toml --q 0 10 -80 0", ("view: ", "-8", "joined by commas: --q=0,10,-80"), "a465 view"),
        ("calibrate camra", ("calibrate: ", "'camra'. Did you mean 'camera'?"), "a465 calibrate"),
        ("calibrate camera p --work-mm 4", ("calibrate camera: ", "requires 2"), "a465 calibrate camera"),
    ],
)
def test_a_wrong_option_or_command_is_one_line(typed: str, words: tuple[str, ...], help: str) -> None:
    said, told = a465(*typed.split(), code=2)
    assert told.startswith("a465: wrong input: ")
    assert told.endswith(f"; see {help} --help\n")
    assert told.count("\n") == 1
    assert all(word in told for word in words), told
    assert said == ""


def test_a_group_without_a_command_prints_its_help() -> None:
    assert "Commands:" in a465("calibrate", code=2)[1]
