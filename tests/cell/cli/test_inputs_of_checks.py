"""Mistakes with check, certify, compare, export, preview and view: each is one line with its cause, or a note."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from typed.command_line import a465, replace_in

NOD = {
    "joint_names": ["J1", "J2", "J3", "J4", "J5", "J6"],
    "points": [
        {"positions": [-1.0472, -0.6981, -1.3963, 0, q5, 0], "velocities": [0] * 6, "time_from_start": t}
        for q5, t in ((-1.0472, 0.0), (-0.8, 4.0))
    ],
}
CAGE = '\n[[walls]]\nname = "cage"\ncentre_mm = [0, 0, 500]\nsize_mm = [3000, 3000, 2000]\n'
IN_CAGE = "NOTE: cell.toml: walls[1] (cage): the arm's base is 700 mm inside it"


@pytest.fixture
def at(scenes: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The scenes as working folder, with files that are given in the wrong place."""
    monkeypatch.chdir(scenes)
    Path("nod.json").write_text(json.dumps(NOD))
    Path("empty.json").touch()
    Path("list.json").write_text("[1]")
    Path("page.html").write_text("<html></html>")
    Path("samples.csv").write_text("time_s,J1_rad\n0,0\n")
    Path("headless.jsonl").write_text('{"t":0.0,"kind":"run","task":"task2.toml"}\n')
    broken = Path("cell.toml").read_text().replace("q_start_deg", "q_start_rad")
    Path("broken.toml").write_text(broken)
    return scenes


@pytest.mark.parametrize(
    ("typed", "told"),
    [
        ("check empty.json task2.toml", "empty.json: is empty; check takes a plan or a scene file"),
        ("check list.json task2.toml", "list.json: format: must be 'a465-plan/3'"),
        ("preview page.html", "page.html: is named as a page, which a browser opens; preview takes a plan"),
        ("preview headless.jsonl", "headless.jsonl: is part of a log: its first line, of the kind open, is missing"),
        ("export headless.jsonl", "headless.jsonl: is part of a log: its first line, of the kind open, is missing"),
        ("export cell.toml -o cell.urdf", "cell.urdf: must be a folder, in which urdf writes cell.urdf and cell.srdf"),
        ("export cell.toml -o x.json", "x.json: must be a folder, in which urdf writes cell.urdf and cell.srdf"),
        ("render task2.toml -o x.html", "-o x.html: is the name of a file (.html); give that of a folder for images"),
        ("certify nod.json --scene cell.toml", "(scene is an argument and has no option: a465 certify TRAJ"),
        ("certify nod.json cell.toml --urdf a.urdf", "(an arm file names URDF and SRDF, as arm.urdf and arm.srdf; "),
        ("export list.json --csv", "(it is --format csv)"),
        ("export list.json CSV", "(it is --format csv)"),
        ("export list.json -o x.urdf", "x.urdf: is of --format urdf, which is not given; without it a table"),
        ("certify samples.csv cell.toml", "samples; a465 export --format trajectory writes what certify takes"),
        ("certify nod.json hoop/d.toml -o p.json", "hoop/d.toml is a program: give hoop/cell.toml"),
        ("compare cell.toml task2.toml", "cell.toml is a cell file, task2.toml is a task file; must be two of a kind"),
    ],
)  # fmt: skip
def test_one_line_tells_the_cause(typed: str, told: str, at: Path) -> None:
    said = a465(*typed.split(), code=2)[1]
    assert told in said
    assert sum(line.startswith("a465:") for line in said.splitlines()) == 1


def test_the_other_task_of_the_name_is_told_if_the_plan_was_made_for_it(at: Path) -> None:
    Path("other").mkdir()
    replace_in(Path("cell.toml"), "clearance_mm = 10", "clearance_mm = 12")
    Path("there.json").write_text(json.dumps({"entries": [{"q_deg": [-60, -40, -80, 0, -55, 0]}]}))
    a465("plan", "cell.toml", "there.json", "-o", "other/plan.json")
    shutil.copytree("cameras", "other/cameras")
    shutil.copytree("boards", "other/boards")
    shutil.copy("cell.toml", "other")
    replace_in(Path("cell.toml"), "clearance_mm = 12", "clearance_mm = 10")
    for verb, code in (("check", 3), ("preview", 0)):
        said = "".join(a465(verb, "other/plan.json", "cell.toml", code=code))
        assert "motion.clearance_mm 12, now 10; it was made for other/cell.toml: give that" in said
    Path("other/cell.toml").unlink()
    assert (
        "motion.clearance_mm 12, now 10; plan again"
        in a465("check", "other/plan.json", "cell.toml", code=3)[1]
    )


def test_a_page_that_is_there_is_an_output_too(at: Path) -> None:
    told = a465("preview", "list.json", "task2.toml", "page.html", code=2)[1]
    assert "(what is written is given by -o page.html)" in told


def test_a_program_on_a_board_asks_for_a_look(at: Path) -> None:
    told = a465("view", "hoop/seen.toml", "-o", "v.html", code=3)[1]
    assert "on which the workpiece is, was not found; give a look of it with --look FILE" in told


def test_a_file_with_a_mistake_is_compared_as_what_it_is(at: Path) -> None:
    said, _ = a465("compare", "cell.toml", "broken.toml")
    assert "q_start_rad" in said
    assert "2 differences" in said


@pytest.mark.parametrize(("second", "told"), [("./cell.toml", True), ("hoop/cell.toml", False)])
def test_a_file_that_is_compared_with_itself_is_told(second: str, told: bool, at: Path) -> None:
    assert ("are the same file" in a465("compare", "cell.toml", second)[0]) == told


@pytest.mark.parametrize(
    ("typed", "code"),
    [
        ("view cell.toml -o v.html", 0),
        ("check cell.toml --q 0,10,-80,0,-60,0", 0),
        ("check task2.toml --q 0,10,-80,0,-60,0", 0),
        ("export cell.toml -o described", 0),
        ("certify nod.json cell.toml", 3),
    ],
)
def test_doubts_about_a_cell_are_told_by_all_that_read_it(typed: str, code: int, at: Path) -> None:
    if code == 0:  # none as it is shipped
        assert "NOTE" not in a465(*typed.replace("described", "as_it_was").split())[0]
    file = Path("cell.toml")
    replace_in(file, file.read_text(), file.read_text() + CAGE)
    assert IN_CAGE in a465(*typed.split(), code=code)[0]
