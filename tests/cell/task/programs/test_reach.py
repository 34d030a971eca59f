"""Reach of a program: every station of its paths, and why the arm cannot be there."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.io.storage import data_file
from arm.se3 import transform
from cell.program.program_file import ProgramTask, read_program
from cell.program.steps import PoseStep
from cell.task.programs.reach import StationReach, program_reach, require_reach
from plan.kinematics.nearest import AskedPose
from programs.program_files import PROGRAM as PATH_AND_POSE
from programs.program_files import program
from typed.command_line import a465
from vision.observation import Observation

PROGRAM = data_file("scenes/hoop/b.toml")


@cache
def _task() -> ProgramTask:
    return read_program(PROGRAM)


def test_all_stations_of_a_path_that_is_planned_are_in_reach() -> None:
    stations = program_reach(_task(), Observation(), 0.5)
    require_reach(stations)
    places = np.array([s.place for s in stations])
    assert {s.step for s in stations} == {"wire B"}
    assert np.diff(places).max() < 0.0081
    assert all(s.solutions > 0 and s.reason() == "" for s in stations)
    first, last = (np.array(s.position) for s in (stations[0], stations[-1]))
    np.testing.assert_allclose(first, np.array([0.460 + 0.070, 0.0, 0.033 + 0.240]), atol=1e-6)
    np.testing.assert_allclose(last, np.array([0.460, 0.0, 0.033 + 0.0275]), atol=3e-4)


@pytest.mark.slow
def test_a_station_out_of_reach_or_too_near_is_named_with_its_cause() -> None:
    far = replace(_task(), T_on_work=transform(t=(0.72, 0.0, 0.033)))
    stations = program_reach(far, Observation(), 0.5)
    blocked = next(s for s in stations if not s.free)
    with pytest.raises(ImpossibleError, match=f"'wire B' at {1e3 * blocked.place:.0f} mm: ") as told:
        require_reach(stations)
    assert blocked.reason() in str(told.value)
    beyond = replace(_task(), T_on_work=transform(t=(1.5, 0.0, 0.033)))
    with pytest.raises(ImpossibleError, match="out of reach, with all that is free there"):
        require_reach(program_reach(beyond, Observation(), 0.5))
    wide = replace(_task(), clearance=0.024)  # no ring has so much room
    with pytest.raises(ImpossibleError, match=r"ring \d and bar . are .* mm too near"):
        require_reach(program_reach(wide, Observation(), 0.5))


def test_the_command_takes_programs_as_it_takes_tasks(tmp_path: Path) -> None:
    file = program(tmp_path, PATH_AND_POSE.replace("backwards = true", "backwards = true\nback = true"))
    said, _ = a465("reach", file, "--json")
    stations = json.loads(said)["stations"]
    assert {s["step"] for s in stations} == {"wire", "above"}
    assert stations[0]["place_mm"] == 0.0
    _, told = a465("reach", file.with_name("task2.toml"), code=2)
    assert "no jaws" in told or "--look is missing" in told


@pytest.mark.slow
def test_a_path_begins_and_ends_where_a_transit_may() -> None:
    """The pen may touch the table on the path, but not on the way to it: 10 mm are more than the strokes lift."""
    task = read_program(data_file("scenes/pen/drawing.toml"))
    require_reach(program_reach(task, Observation(), 0.5))
    high = program_reach(replace(task, clearance=0.01), Observation(), 0.5)
    blocked = [s for s in high if not s.free]
    assert {s.step for s in blocked} == {s.step for s in high}
    assert all(set(s.pair) == {"pen", "table"} for s in blocked)
    assert len(blocked) == 2 * len({s.step for s in high})


@pytest.mark.slow
def test_poses_are_reached_with_what_was_taken_and_put_down_before() -> None:
    """Both ends of the lines of every step; the boxes stand where the program has put them."""
    task = read_program(data_file("scenes/pallet.toml"))
    stations = program_reach(task, Observation(), 0.5)
    require_reach(stations)
    assert len({s.step for s in stations}) == 64
    assert [(s.step, round(s.place, 6)) for s in stations[:4]] == [
        ("take", -0.06), ("take", 0.0), ("put", -0.06), ("put", 0.0)
    ]  # fmt: skip
    last = stations[-1]
    np.testing.assert_allclose(
        last.position, (0.370 + 3 * 0.070, -0.180 + 3 * 0.052, 0.018 + 0.036), atol=1e-9
    )
    assert all(s.solutions > 0 for s in stations)
    number, put = next(
        (i, s) for i, s in enumerate(task.steps) if isinstance(s, PoseStep) and s.name == "put"
    )
    low = np.array(put.T_work_tool)
    low[16:, 2, 3] -= 0.026  # the second layer would be put into the first
    steps = (*task.steps[:number], replace(put, T_work_tool=low), *task.steps[number + 1 :])
    with pytest.raises(
        ImpossibleError, match=r"'put \(17\)': where part 17 is put down, it is 26.0 mm inside"
    ):
        require_reach(program_reach(replace(task, steps=steps), Observation(), 0.5))


def test_a_pose_out_of_reach_is_named() -> None:
    task = read_program(data_file("scenes/pallet.toml"))
    far = replace(task, T_on_work=transform(t=(0.62, -0.18, 0.0)))
    with pytest.raises(
        ImpossibleError, match=r"'put.*' at -60 mm: out of reach, with all that is free there"
    ):
        require_reach(program_reach(far, Observation(), 0.5))


def test_the_ends_of_lines_and_what_is_in_the_jaws_count() -> None:
    task = read_program(data_file("scenes/pallet.toml"))
    nearest = {name for s in program_reach(task, Observation(), 0.5) for name in s.pair}
    assert sum(name.startswith("part") for name in nearest) > 1  # one alone stands there at the start
    long = tuple(replace(s, approach=1.0) if isinstance(s, PoseStep) else s for s in task.steps)
    with pytest.raises(ImpossibleError, match=r"'take' at -1000 mm: out of reach"):
        require_reach(program_reach(replace(task, steps=long), Observation(), 0.5))


def test_a_refusal_names_three_of_many() -> None:
    pose = AskedPose(transform())
    some = tuple(StationReach(f"take {n}", 0.0, pose, 0, 0.005) for n in range(32))
    with pytest.raises(ImpossibleError, match=r"'take 2' at 0 mm: [^;]*; and 29 more; move the workpiece"):
        require_reach(some)
