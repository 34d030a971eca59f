"""The arm's shape is assumed: its links are padded by default, everything says so, and less padding wants a name."""

from __future__ import annotations

import shutil
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from arm.errors import InputError
from arm.io.storage import data_file
from arm.robot.gripper import HAND
from arm.robot.tool import padded
from cell.config.cell_file import read_cell
from cell.doctor.cell import check_cell
from cell.doctor.finding import NOTE, OK
from cell.files.task import read_task
from cell.task.open_run import OpenRun
from plan.collision.world import World
from typed.command_line import a465, replace_in

COMPARED = 'arm_compared = "2026-11-20, who did it"\n'


@pytest.fixture
def scenes(tmp_path: Path) -> Path:
    return Path(shutil.copytree(data_file("scenes"), tmp_path / "scenes"))


def _with(scenes: Path, lines: str) -> Path:
    cell = scenes / "cell.toml"
    cell.write_text(lines + cell.read_text())
    return cell


def test_links_are_padded_by_default_and_the_gripper_is_not(scenes: Path) -> None:
    cell = read_cell(scenes / "cell.toml")
    for robot in (cell.robot(), cell.robot_holding()):
        assert {b.name: b.padding for b in robot.bodies} == {
            b.name: 0.0 if b.name in HAND else 0.010 for b in robot.bodies
        }
    bare, world = (World(robot, cell.fixed) for robot in (cell.nominal_robot(), cell.robot()))
    every = np.arange(len(bare.pairs))
    off = bare.pair_distances(cell.q_start, every) - world.pair_distances(cell.q_start, every)
    for index, less in enumerate(off):
        links = set(bare.pair_names(index)) - set(HAND) - {b.name for b in cell.fixed}
        assert less == pytest.approx(0.010 * len(links), abs=1e-12)


def test_less_padding_wants_somebody_who_compared(scenes: Path) -> None:
    cell = _with(scenes, "arm_padding_mm = 9.9\n")
    with pytest.raises(
        InputError, match=r"arm_padding_mm = 9.9: must be at least 10 mm until .*arm_compared"
    ):
        read_cell(cell)
    replace_in(cell, "arm_padding_mm = 9.9\n", 'arm_padding_mm = 9.9\narm_compared = " "\n')
    with pytest.raises(InputError, match="until the arm's assumed bodies are compared"):
        read_cell(cell)
    replace_in(cell, 'arm_compared = " "\n', 'arm_compared = "date, name"\n')
    with pytest.raises(InputError, match=r"arm_compared = 'date, name': must be the date and the name"):
        read_cell(cell)
    replace_in(cell, 'arm_compared = "date, name"\n', COMPARED)
    assert read_cell(cell).arm_padding == pytest.approx(0.0099)
    replace_in(cell, "arm_padding_mm = 9.9\n", "arm_padding_mm = 0\n")
    assert all(b.padding == 0.0 for b in read_cell(cell).robot().bodies)


def test_more_padding_needs_nobody(scenes: Path) -> None:
    cell = read_cell(_with(scenes, "arm_padding_mm = 25\n"))
    assert max(b.padding for b in cell.robot().bodies) == 0.025
    assert cell.robot().digest != read_cell(data_file("scenes/cell.toml")).robot().digest


def test_doctor_says_whose_word_it_is(scenes: Path) -> None:
    def row() -> tuple[str, str]:
        findings, _ = check_cell(scenes / "cell.toml")
        finding = next(f for f in findings if f.check == "arm's shape")
        return finding.verdict, finding.found

    assert row() == (
        NOTE,
        "the arm's bodies are assumed, nobody has compared them with the arm; "
        "its links are padded by 10 mm, the gripper is not",
    )
    _with(scenes, "arm_padding_mm = 3\n" + COMPARED)
    verdict, found = row()
    assert verdict == OK
    assert "compared with the arm (2026-11-20, who did it); its links are padded by 3 mm" in found


def test_check_and_plan_follow_the_padding(scenes: Path) -> None:
    q = "--q=-60,-40,-80,0,-60,0"
    before, _ = a465("check", scenes / "cell.toml", q)
    _with(scenes, "arm_padding_mm = 30\n")
    after, _ = a465("check", scenes / "cell.toml", q)
    assert before != after
    cell = read_cell(scenes / "cell.toml")
    assert "30 mm" in cell.arm_shape()


def test_paddings_add_up_and_are_checked() -> None:
    robot = read_cell(data_file("scenes/cell.toml")).robot()
    more = padded(robot, 0.001, but=("base",))
    assert {b.name: b.padding for b in more.bodies}["base"] == pytest.approx(0.010)
    assert {b.name: b.padding for b in more.bodies}["palm"] == pytest.approx(0.001)
    assert padded(robot, 0.0) is robot
    with pytest.raises(InputError, match=r"padding = -0\.001 m: must be from 0 to 0.5"):
        padded(robot, -0.001)
    assert replace(robot, bodies=more.bodies).digest == robot.digest


@pytest.mark.parametrize("compared", [False, True])
def test_a_runs_report_says_whose_word_the_arms_shape_is(scenes: Path, compared: bool) -> None:
    if compared:
        _with(scenes, COMPARED)
    task = read_task(scenes / "task2.toml")
    run: Any = SimpleNamespace(
        task=task,
        kept=[],
        rows=[],
        speed=0.5,
        control=SimpleNamespace(ceiling=1.0),
        connection=SimpleNamespace(
            time_scale=1.0, simulated=None, mars=SimpleNamespace(link=SimpleNamespace(url="/dev/mars"))
        ),
        remarks=[],
        second_looks=[],
        budgets={},
        began=datetime.now().astimezone(),
        folder=scenes,
    )
    told = OpenRun.to_json(run)["arm_shape"]
    assert told == task.cell.arm_shape()
    assert ("2026-11-20, who did it" in told) is compared
    assert ("nobody has compared them" in told) is not compared
    assert "padded by 10 mm" in told
