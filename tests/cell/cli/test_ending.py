"""A run ends with a code of its own if a cube is left; an error ends in one line, and as an object with --json."""

from __future__ import annotations

import json
import sys

import pytest
import typer

from arm.errors import ImpossibleError
from cell.cli.ending import fail, finish
from cell.console import Console


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
