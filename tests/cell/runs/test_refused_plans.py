"""Plans that are not for the present cell, or that somebody changed: refused at the command line, with the reason."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from arm.io.storage import sha256
from cell.files.task import read_task
from typed.command_line import a465, refused, replace_in

pytestmark = pytest.mark.xdist_group("refused_plans")


@pytest.fixture
def scenes(planned_scenes: Path, tmp_path: Path) -> Path:
    """A copy of the planned scenes that a test may change."""
    return Path(shutil.copytree(planned_scenes, tmp_path / "scenes"))


@pytest.mark.slow
def test_a_plan_for_another_camera_arm_or_limits_is_refused(scenes: Path) -> None:
    a465("check", scenes / "plan.json", scenes / "task2.toml")
    for file, old, new, word in (
        ("cameras/lab.toml", "1072.72375", "1071.72375", "calibration"),
        ("cell.toml", 'unit = "crs93"', 'unit = "crs97"', "unit"),
        ("cell.toml", "# acceleration_registers = [51,", "acceleration_registers = [50,", "limits"),
    ):
        before = (scenes / file).read_text()
        replace_in(scenes / file, old, new)
        told = refused("execute", scenes / "plan.json", scenes / "task2.toml", code=3, cwd=scenes)
        assert word in told
        (scenes / file).write_text(before)


@pytest.mark.slow
def test_a_cell_that_got_another_wall_refuses_the_plan(scenes: Path) -> None:
    plan = scenes / "plan.json"
    wall = '\n[[walls]]\nname = "new"\ncentre_mm = [360, -340, 160]\nsize_mm = [40, 40, 40]\n'
    (scenes / "cell.toml").write_text((scenes / "cell.toml").read_text() + wall)
    for verb in ("check", "execute"):
        told = refused(verb, plan, scenes / "task2.toml", code=3, cwd=scenes)
        assert "not for the present cell: cell.toml: walls[new] is new; plan again" in told
    # an old plan can still be looked at
    out, warned = a465("preview", plan, scenes / "task2.toml", "-o", scenes / "old.html", "--json")
    assert "WARNING: the plan is not for the present cell: cell.toml: walls[new] is new" in warned
    assert json.loads(out)["warning"].startswith("the plan is not for the present cell")
    assert (scenes / "old.html").stat().st_size > 100_000
    value = json.loads(plan.read_text())  # even if somebody makes the file say that it is for this cell
    now = read_task(scenes / "task2.toml")
    value["provenance"]["task"] = now.digest
    value["provenance"]["inputs"]["cell"] = dict(now.cell.inputs)
    plan.write_text(json.dumps(value))
    told = refused("check", plan, scenes / "task2.toml", code=3, cwd=scenes)
    assert "scene is not that of the present cell: new" in told


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


def _half_open_jaws(value: dict[str, Any]) -> None:
    """Moves with empty jaws are certified with jaws that are wide open."""
    assert value["steps"][0]["action"] == "open"
    value["steps"][0]["fraction_closed"] = 0.3


def _from_an_empty_hole(value: dict[str, Any]) -> None:
    cubes = value["task"]["cubes"]
    free = {f"01-02/{k}" for k in range(1, 5)} - {cubes[0]["from"]}
    cubes[0]["from"] = min(free)


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
        (_no_clearance, "mm are required"),
        (_shut_jaws, "says open but closes"),
        (_half_open_jaws, "says open but closes"),
        (_from_an_empty_hole, "where there is another cube"),
    ],
    ids=lambda v: v.__name__.strip("_") if callable(v) else "",
)
def test_a_plan_file_that_was_tampered_with_is_refused(
    scenes: Path, change: Callable[[dict[str, Any]], None], words: str
) -> None:
    plan = scenes / "plan.json"
    value = json.loads(plan.read_text())
    change(value)
    value["provenance"]["scene"] = sha256(value["scene"])  # whoever does this mends the hash too
    plan.write_text(json.dumps(value))
    _, told = a465("check", plan, scenes / "task2.toml", code=3, cwd=scenes)
    assert words in told


@pytest.mark.slow
def test_a_plan_is_not_executed_where_a_hole_holds_a_cube_by_now(scenes: Path) -> None:
    plan = scenes / "plan.json"
    replace_in(scenes / "task2.world.toml", "cubes = []", "cubes = [1]")
    _, told = a465("execute", plan, scenes / "task2.toml", "--time-scale", 30, code=3, cwd=scenes)
    assert "hole 03-04/1 looks cube, planned was empty" in told


@pytest.mark.slow
def test_a_plan_whose_certificate_was_tampered_with_is_refused(scenes: Path) -> None:
    plan = json.loads((scenes / "plan.json").read_text())
    move = next(s for s in plan["steps"] if s["step"] == "move" and s["role"] == "transit")
    move["clearance"] += 0.01
    move["clearances"] = [c + 0.01 for c in move["clearances"]]
    (scenes / "plan.json").write_text(json.dumps(plan))
    told = refused("check", scenes / "plan.json", scenes / "task2.toml", code=3, cwd=scenes)
    assert move["name"] in told
