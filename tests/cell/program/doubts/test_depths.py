"""A path that goes deep into what it may touch is told; presses and pens that only touch are not."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from arm.io.storage import data_file
from arm.numerics.products import mul
from arm.se3 import transform
from cell.program.doubts.depths import buried, depths
from cell.program.program_file import read_program
from typed.command_line import a465, replace_in


@pytest.mark.parametrize("name", ["polish/pass.toml", "pen/drawing.toml", "hoop/b.toml"])
def test_the_programs_of_the_scenes_are_not_deep(name: str) -> None:
    task = read_program(data_file(f"scenes/{name}"))
    assert list(depths(task, task.T_on_work)) == []


def test_a_workpiece_deep_in_the_table_is_told(tmp_path: Path) -> None:
    file = Path(shutil.copytree(data_file("scenes"), tmp_path / "scenes")) / "polish/pass.toml"
    task = read_program(file)
    assert list(buried(task, task.T_on_work)) == []
    found = list(buried(task, mul(transform(t=(0.0, 0.0, -0.05)), task.T_on_work)))
    assert [words.partition(" mm deep")[0] for words in found] == [
        "pass.toml: block of the workpiece is 58.9",
        "pass.toml: clamp of the workpiece is 53.7",
    ]


@pytest.mark.parametrize(("z", "deep"), [("0", "10.0"), ("7", "3.0"), ("8.5", "")])
def test_a_ball_deep_in_its_block_is_told(tmp_path: Path, z: str, deep: str) -> None:
    """Its radius is 10 mm, and corner_mm is where its centre is."""
    file = Path(shutil.copytree(data_file("scenes"), tmp_path / "scenes")) / "polish/pass.toml"
    replace_in(file, "corner_mm = [10, 6, 9.5]", f"corner_mm = [10, 6, {z}]")
    task = read_program(file)
    found = list(depths(task, task.T_on_work))
    assert len(found) == bool(deep)
    if deep:
        assert found[0].startswith("pass.toml: steps[0]: on path 'pass', ")
        assert found[0].endswith(f" mm from its start, ball is {deep} mm deep in block, which touch allows")


def test_a_pen_deep_in_the_table_is_told_before_it_is_planned(tmp_path: Path) -> None:
    file = Path(shutil.copytree(data_file("scenes"), tmp_path / "scenes")) / "pen/drawing.toml"
    replace_in(file, "origin_mm = [380, 105, 1]", "origin_mm = [760, 105, -11]")
    said, _ = a465("plan", file, "--no-advice", "-o", tmp_path / "p.json", code=3)
    assert said.startswith("NOTE: drawing.toml: steps[0]: on path 'drawing, stroke ")
    assert said.count("NOTE") == 1
    assert "mm from its start, pen is 10.0 mm deep in table, which touch allows\n" in said


@pytest.mark.parametrize(("z", "told"), [("10", ""), ("95", "85")])
def test_a_path_that_never_comes_near_what_it_may_touch_is_told(tmp_path: Path, z: str, told: str) -> None:
    file = Path(shutil.copytree(data_file("scenes"), tmp_path / "scenes")) / "polish/pass.toml"
    replace_in(file, "corner_mm = [10, 6, 9.5]", f"corner_mm = [10, 6, {z}]")
    task = read_program(file)
    found = list(depths(task, task.T_on_work))
    assert len(found) == bool(told)
    if told:
        assert found[0].startswith(
            f"pass.toml: steps[0].touch: ball stays {told} mm from block, which it may"
        )
