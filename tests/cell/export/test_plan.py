"""A plan in other forms: what would be sent, between the points as well as at them, on one clock with the jaws."""

from __future__ import annotations

import csv
import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from scipy.interpolate import CubicHermiteSpline

from arm.controller.segments import CountPath, Segment
from arm.controller.unit import Unit, load_unit
from arm.errors import InputError
from arm.io.storage import data_file
from arm.plan_file import GripperStep, LookStep, Move, Plan, read_plan, write_plan
from cell.console import Console
from cell.export.export import ExportOptions, export_file
from cell.export.plan import sampled, timed_steps, trajectory_of
from cell.export.scene import surroundings_of_plan
from cell.export.urdf import describe
from cell.files.pose_list import read_pose_list
from cell.files.task import read_place
from cell.task.pose_list_planning import place_of_cell, plan_pose_list
from typed.command_line import a465

CELL = data_file("scenes/cell.toml")
LIST = {
    "entries": [
        {"q_deg": [-30, -20, -90, 0, -60, 10], "jaws": 0.4, "dwell_s": 0.25},
        {"q_deg": [0, -10, -90, 0, -70, 0]},
        {"jaws": "open"},
    ]
}


@pytest.fixture(scope="module")
def unit() -> Unit:
    return load_unit("crs93")


@pytest.fixture(scope="module")
def plan_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("plan")
    (folder / "list.json").write_text(json.dumps(LIST))
    task = read_place(CELL)
    plan = plan_pose_list(place_of_cell(task, None, 1.0), read_pose_list(folder / "list.json"), back=True)
    write_plan(folder / "plan.toml", plan)  # what it is, is told by its content
    return folder / "plan.toml"


@pytest.fixture(scope="module")
def plan(plan_file: Path) -> Plan:
    return read_plan(plan_file)


def export(file: Path, console: Console | None = None, **asked: Any) -> dict[str, Any]:
    return export_file(file, ExportOptions(**asked), console or Console(as_json=True))


def truth(plan: Plan, unit: Unit, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Joints and what the jaws were told, step by step; of a time between two steps, of the later one."""
    q, jaws = np.full((len(times), 6), np.nan), np.zeros(len(times))
    now, closed, at = 0.0, 0.0, unit.positions(plan.start)
    for step in plan.steps:
        if isinstance(step, Move):
            rows = times >= now - 1e-9
            q[rows] = unit.positions(step.path.at(times[rows] - now))
            jaws[rows] = closed
            now, at = now + step.path.duration_s, unit.positions(step.path.end)
        elif isinstance(step, GripperStep):
            closed = step.fraction_closed
            rows = times >= now - 1e-9
            q[rows], jaws[rows] = at, closed
            now += step.settle_s
    return q, jaws


def seconds(value: dict[str, int]) -> float:
    return value["sec"] + 1e-9 * value["nanosec"]


def test_csv_has_even_rows_and_the_ends_of_segments(
    plan_file: Path, plan: Plan, unit: Unit, tmp_path: Path
) -> None:
    told = export(plan_file, output=tmp_path / "plan.csv", period=0.05)
    with (tmp_path / "plan.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert told["samples"] == len(rows)
    assert list(rows[0]) == [
        "time_s",
        *(f"J{n}_rad" for n in range(1, 7)),
        *(f"J{n}_rad_s" for n in range(1, 7)),
        "jaws_fraction_closed",
        "step",
    ]
    times = np.array([float(r["time_s"]) for r in rows])
    assert np.all(np.diff(times) > 0.0)
    duration = plan.duration_s + 2 * 1.0  # the cell's settle_s
    assert times[-1] == pytest.approx(duration)
    grid = np.arange(0.0, duration, 0.05)
    assert np.all(np.abs(times[np.searchsorted(times, grid - 1e-9)] - grid) < 1e-6)
    q = np.array([[float(r[f"J{n}_rad"]) for n in range(1, 7)] for r in rows])
    wanted, jaws = truth(plan, unit, times)
    assert np.abs(q - wanted).max() < 1e-9
    assert [float(r["jaws_fraction_closed"]) for r in rows] == pytest.approx(jaws)
    assert {0.0, 0.4} == set(jaws)
    ends = [
        end
        for part in timed_steps(plan, unit)
        if part.path is not None
        for end in part.begin_s + np.cumsum([s.duration_ms for s in part.path.segments]) / 1e3
    ]
    assert np.all(np.abs(times[np.searchsorted(times, np.array(ends) - 1e-6)] - ends) < 1e-6)
    steps = [r["step"] for r in rows]
    assert list(dict.fromkeys(steps)) == [s.name for s in plan.steps]
    assert "rest at configuration 1" in steps


def test_velocities_are_the_slopes_of_the_positions(plan: Plan, unit: Unit) -> None:
    fine = sampled(plan, unit, 0.001)
    slope = np.diff(fine.q, axis=0) / np.diff(fine.time_s)[:, None]
    middle = (fine.velocity[1:] + fine.velocity[:-1]) / 2.0
    jerk_free = 2e-3 * unit.limits().acceleration  # what a step of velocity at a join may make
    assert np.all(np.abs(slope - middle) < jerk_free + 1e-4)
    assert np.abs(fine.velocity[:, 0]).max() > 0.3
    assert np.all(np.abs(fine.velocity) <= unit.velocity(plan.speed_registers) + 1e-9)
    still = [i for i, name in enumerate(fine.step) if name.startswith(("rest", "close", "open"))]
    assert len(still) > 2000
    assert np.abs(fine.velocity[still]).max() == 0.0


def test_the_trajectory_is_the_plan_between_its_points_too(
    plan_file: Path, plan: Plan, unit: Unit, tmp_path: Path
) -> None:
    told = export(plan_file, form="trajectory", output=tmp_path / "t.json")
    value = json.loads((tmp_path / "t.json").read_text())
    assert set(value) == {"header", "joint_names", "points", "gripper_events"}
    assert value["joint_names"] == [f"J{n}" for n in range(1, 7)]
    points = value["points"]
    assert told["points"] == len(points)
    assert set(points[0]) == {"positions", "velocities", "accelerations", "effort", "time_from_start"}
    times = np.array([seconds(p["time_from_start"]) for p in points])
    assert times[0] == 0.0
    assert np.all(np.diff(times) > 0.0)
    spline = CubicHermiteSpline(times, [p["positions"] for p in points], [p["velocities"] for p in points])
    every = np.linspace(0.0, times[-1] - 1e-6, 4000)
    off = np.abs(spline(every) - truth(plan, unit, every)[0]) * np.abs(unit.counts_per_rad)
    assert off.max() < 1.0  # counts
    events = value["gripper_events"]
    assert [(e["name"], e["fraction_closed"], e["settle_s"]) for e in events] == [
        ("close at configuration 1", 0.4, 1.0),
        ("open at configuration 2", 0.0, 1.0),
    ]
    first = next(s for s in plan.steps if isinstance(s, Move)).path.duration_s
    assert seconds(events[0]["time_from_start"]) == pytest.approx(first)


def test_a_straight_segment_leaves_the_velocities_out(plan: Plan, unit: Unit) -> None:
    straight = CountPath(plan.start, (Segment(500, ((100, 0, 0, 0, 0, 0),)),))
    first = replace(next(plan.moves), path=straight)
    made = trajectory_of(replace(plan, steps=(first,)), unit)
    assert [p["velocities"] for p in made["points"]] == [[], []]
    jump = sampled(replace(plan, steps=(first,)), unit, 0.1)
    assert jump.velocity[:, 0] == pytest.approx(200.0 / unit.counts_per_rad[0])


def test_mcap_has_the_logs_topics_and_schemas(
    plan_file: Path, plan: Plan, unit: Unit, tmp_path: Path
) -> None:
    told = export(plan_file, form="mcap", output=tmp_path / "a.mcap", period=0.1)
    export(plan_file, form="mcap", output=tmp_path / "b.mcap", period=0.1)
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()
    found: dict[str, list[tuple[int, dict[str, Any]]]] = {}
    with (tmp_path / "a.mcap").open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            assert schema is not None
            value = json.loads(message.data)
            assert set(value) == set(json.loads(schema.data)["properties"])
            found.setdefault(channel.topic, []).append((message.log_time, value))
    assert {topic: len(m) for topic, m in found.items()} == told["messages"]
    samples = sampled(plan, unit, 0.1)
    assert [m["position"] for _, m in found["/joint_states"]] == pytest.approx(samples.q, abs=1e-9)
    assert [t for t, _ in found["/joint_states"]] == pytest.approx(1e9 * samples.time_s, abs=1e3)
    assert [m["fraction_closed"] for _, m in found["/jaws"]] == pytest.approx(samples.jaws)
    assert len(found["/planned"]) == len(plan.motions)
    parts = timed_steps(plan, unit)
    for (time_ns, message), motion in zip(found["/planned"], plan.motions, strict=True):
        assert time_ns == pytest.approx(1e9 * parts[motion.first].begin_s, abs=1e3)
        assert message["points"][-1]["positions"] == pytest.approx(unit.positions(motion.path.end))
        lasts = seconds(message["points"][-1]["time_from_start"])
        assert lasts == pytest.approx(motion.path.duration_s)
    assert [m["data"] for _, m in found["/events"]] == [
        {"name": s.name, "step": "move" if isinstance(s, Move) else "gripper"} for s in plan.steps
    ]


def test_looks_take_no_time_and_held_cubes_are_no_matter(
    make_preview_case: Callable[[int], Any],
) -> None:
    case = make_preview_case(1)
    parts = timed_steps(case.plan, case.unit)
    assert any(isinstance(s, LookStep) for s in case.plan.steps)
    assert [p.step.name for p in parts] == [s.name for s in case.plan.steps]
    made = sampled(case.plan, case.unit, 0.1)
    assert made.time_s[-1] == pytest.approx(case.plan.duration_s + 3 * 1.0)
    wanted, jaws = truth(case.plan, case.unit, made.time_s)
    assert np.abs(made.q - wanted).max() < 1e-9
    assert made.jaws == pytest.approx(jaws)


def test_the_scene_of_a_plan_is_its_own(plan_file: Path, plan: Plan, tmp_path: Path) -> None:
    told = export(plan_file, form="urdf", output=tmp_path / "out")
    assert set(told["links"]) == {b["name"] for b in plan.scene["bodies"]} == {"table", "camera post"}
    there = surroundings_of_plan(plan_file, plan, None)
    cell = read_place(CELL).cell
    assert there.robot.digest == cell.robot().digest
    assert there.states["q_start"] == pytest.approx(cell.q_start, abs=1e-4)
    assert there.limits.velocity == pytest.approx(cell.limits.velocity)
    moved = replace(plan, scene={**plan.scene, "bodies": plan.scene["bodies"][:1]})
    assert set(describe(surroundings_of_plan(plan_file, moved, None)).links) == {"table"}
    with pytest.raises(InputError, match="must be a new or an empty folder"):
        export(plan_file, form="urdf", output=tmp_path / "out")


def test_counts_of_another_arm_are_refused_until_its_cell_is_given(
    plan_file: Path, plan: Plan, tmp_path: Path
) -> None:
    other = tmp_path / "other.json"
    write_plan(other, replace(plan, provenance={**plan.provenance, "unit": "f" * 64}))
    for form in ("csv", "urdf"):
        with pytest.raises(InputError, match=r"provenance.unit = 'ffffffffffff': .*give --cell FILE"):
            export(other, form=form, output=tmp_path / "never")
        with pytest.raises(InputError, match=r"provenance.unit.* of cell.toml"):
            export(other, form=form, output=tmp_path / "never", cell=CELL)
    calibrated = read_place(CELL).cell.unit.calibrated(np.full(6, 0.01))
    write_plan(other, replace(plan, provenance={**plan.provenance, "unit": calibrated.digest}))
    with pytest.raises(InputError, match="counts would give other angles"):
        export(other, output=tmp_path / "never")
    changed = {"unit": calibrated.digest, "calibration_id": "hand-eye-1"}
    write_plan(other, replace(plan, provenance={**plan.provenance, **changed}))
    with pytest.raises(
        InputError, match=r"other.json: is of a calibrated arm \(hand-eye-1\), .*give --cell FILE"
    ):
        export(other, output=tmp_path / "never")
    write_plan(other, replace(plan, unit="crs97"))
    with pytest.raises(InputError, match=r"unit = 'crs97': must be that of the cell, crs93"):
        export(other, output=tmp_path / "never", cell=CELL)
    write_plan(other, replace(plan, provenance={**plan.provenance, "inputs": {}}))
    with pytest.raises(InputError, match="does not describe the arm's tool"):
        export(other, form="urdf", output=tmp_path / "never")
    assert not (tmp_path / "never").exists()
    told = export(other, form="urdf", output=tmp_path / "with its cell", cell=CELL)
    assert told["format"] == "urdf"
    write_plan(other, replace(plan, scene={**plan.scene, "robot_open": "0" * 64}))
    with pytest.raises(InputError, match="does not match this arm"):
        export(other, form="urdf", output=tmp_path / "never")


def test_only_a_table_of_samples_is_replaced_by_one(plan_file: Path, tmp_path: Path) -> None:
    board, samples = tmp_path / "board.csv", tmp_path / "samples.csv"
    shutil.copy(data_file("scenes/boards/positions_plate_01-02.csv"), board)
    before = board.read_bytes()
    with pytest.raises(InputError, match=r"board\.csv: is a board file, and something else would replace it"):
        export(plan_file, form="csv", output=board)
    assert board.read_bytes() == before
    for period in (0.5, 0.2):
        export(plan_file, form="csv", output=samples, period=period)
    with pytest.raises(InputError, match=r"samples\.csv: is a table of samples"):
        export(plan_file, form="trajectory", output=samples)


def test_what_does_not_go_with_a_plan_is_refused(plan_file: Path, tmp_path: Path) -> None:
    for asked, rule in (
        ({"form": "xml"}, "--format xml: must be one of csv, trajectory, mcap, urdf, as .* is a plan"),
        ({"planned": True}, "--planned does not go with a plan"),
        ({"unit": "crs93"}, "--unit does not go with"),
        ({"look": CELL}, "--look does not go with"),
        ({"period": 0.0}, "--period 0: must be from 0.001 to 10 s"),
        ({"period": float("nan")}, "--period nan: must be from"),
        ({"form": "trajectory", "period": 0.1}, "--period does not go with --format trajectory"),
        ({"form": "urdf", "period": 0.1}, "--period does not go with --format urdf"),
        ({"output": plan_file}, "is read by this command"),
    ):
        with pytest.raises(InputError, match=rule):
            export(plan_file, **{"output": tmp_path / "never", **asked})
    assert not (tmp_path / "never").exists()
    _, told = a465("export", plan_file, "--format", "csv", "--period", "1e9", code=2)
    assert "--period 1e+09" in told
