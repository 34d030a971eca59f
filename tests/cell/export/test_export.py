"""A log in other forms: times that increase, figures that agree with the arm's own, whole files or none."""

from __future__ import annotations

import builtins
import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from scipy.interpolate import CubicHermiteSpline

from arm.controller.unit import Unit, load_unit
from arm.errors import InputError
from cell.console import Console
from cell.export.export import export_step
from cell.export.series import executed, planned, unit_of
from driver.log.read import Session, read_log
from wire.logged_session import LoggedRun

pytestmark = pytest.mark.xdist_group("logs")


@pytest.fixture(scope="module")
def unit() -> Unit:
    return load_unit("crs93")


def export(run: LoggedRun, form: str, path: Path, sent: bool = False) -> dict[str, Any]:
    return export_step(run.log, form, path, sent, None, Console(as_json=True))


def seconds(value: dict[str, int]) -> float:
    assert set(value) == {"sec", "nanosec"}
    assert 0 <= value["nanosec"] < 10**9
    return value["sec"] + 1e-9 * value["nanosec"]


def test_csv_has_a_row_a_sample_with_units_in_the_names(run: LoggedRun, unit: Unit, tmp_path: Path) -> None:
    told = export(run, "csv", tmp_path / "log.csv")
    with (tmp_path / "log.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert list(rows[0]) == [
        "time_s", "motion", "segment", *(f"J{n}_deg" for n in range(1, 7)), "jaws_fraction_closed"
    ]  # fmt: skip
    assert told["samples"] == len(rows) > 20
    assert told["before_homing"] >= 1
    times = [float(r["time_s"]) for r in rows]
    assert np.all(np.diff(times) > 0.0)
    degrees = np.array([[float(r[f"J{n}_deg"]) for n in range(1, 7)] for r in rows])
    home = np.degrees(unit.positions(run.home))
    assert np.abs(degrees - home).max(axis=1).min() < 1e-4
    assert degrees[-1] == pytest.approx(np.degrees(unit.positions(run.record.counts[-1])), abs=1e-5)
    streams = {r["motion"] for r in rows if r["segment"]}
    assert len(streams) == 2
    for motion in streams:
        numbers = [int(r["segment"]) for r in rows if r["motion"] == motion and r["segment"]]
        assert numbers == sorted(numbers)
    assert rows[0]["jaws_fraction_closed"] == ""
    assert float(rows[-1]["jaws_fraction_closed"]) == pytest.approx(
        unit.gripper.fraction_closed(420), abs=1e-3
    )


def test_the_trajectory_has_the_fields_of_ros_2_and_the_arms_own_figures(
    run: LoggedRun, session: Session, unit: Unit, tmp_path: Path
) -> None:
    told = export(run, "trajectory", tmp_path / "seen.json")
    value = json.loads((tmp_path / "seen.json").read_text())
    assert set(value) == {"header", "joint_names", "points"}
    assert value["joint_names"] == ["J1", "J2", "J3", "J4", "J5", "J6"]
    assert set(value["header"]) == {"stamp", "frame_id"}
    points = value["points"]
    assert told["points"] == len(points)
    assert set(points[0]) == {"positions", "velocities", "accelerations", "effort", "time_from_start"}
    times = [seconds(p["time_from_start"]) for p in points]
    assert times[0] == 0.0
    assert np.all(np.diff(times) > 0.0)
    seen = executed(session, unit)
    assert np.array([p["positions"] for p in points]) == pytest.approx(seen.q, abs=1e-9)
    assert np.array([p["velocities"] for p in points]) == pytest.approx(seen.velocity, abs=1e-9)
    peak = np.abs(seen.velocity).max(axis=0)
    assert np.all(peak > 0.02)
    assert np.all(peak <= 1.05 * unit.velocity(unit.speed_registers))


def test_what_was_planned_is_what_was_sent_between_the_points_too(
    run: LoggedRun, session: Session, unit: Unit, tmp_path: Path
) -> None:
    """Cubics through the points, as ROS 2's trajectory controller draws them, are the segments."""
    motions = planned(session, unit)
    cut = motions[-1]
    assert cut.velocity is not None
    spline = CubicHermiteSpline(cut.time_s, cut.q, cut.velocity)
    times = np.linspace(cut.time_s[0], cut.time_s[-1] - 1e-9, 2000)
    truth = unit.positions(run.cut.at(times - cut.time_s[0]))
    assert spline(times) == pytest.approx(truth, abs=2e-5)  # a count: velocities differ by rounding
    whole = motions[-2]
    assert whole.velocity is None  # it ends in a straight segment
    assert whole.q == pytest.approx(unit.positions(run.whole.knots()))
    export(run, "trajectory", tmp_path / "sent.json", sent=True)
    points = json.loads((tmp_path / "sent.json").read_text())["points"]
    assert len(points) == sum(len(m.time_s) for m in motions)
    assert np.all(np.diff([seconds(p["time_from_start"]) for p in points]) > 0.0)
    assert {len(p["velocities"]) for p in points} == {0}


def test_the_executed_samples_are_near_the_plan_at_their_time(session: Session, unit: Unit) -> None:
    """The unit stretches a motion by a few percent at most, so plan and execution are never a second apart."""
    motion = planned(session, unit)[-2]
    seen = executed(session, unit)
    compared = 0
    for i, number in enumerate(seen.motion):
        if number != motion.number or seen.segment[i] < 1:
            continue
        near = np.abs(motion.time_s - seen.time_s[i]) <= 1.0
        stretch = motion.q[near]
        assert np.all(seen.q[i] >= stretch.min(axis=0) - 1e-3)
        assert np.all(seen.q[i] <= stretch.max(axis=0) + 1e-3)
        compared += 1
    assert compared >= 5


def test_mcap_reads_back_with_its_schemas(
    run: LoggedRun, session: Session, unit: Unit, tmp_path: Path
) -> None:
    told = export(run, "mcap", tmp_path / "log.mcap")
    again = export(run, "mcap", tmp_path / "again.mcap")
    assert (tmp_path / "log.mcap").read_bytes() == (tmp_path / "again.mcap").read_bytes()
    assert told["messages"] == again["messages"]
    found: dict[str, list[tuple[int, dict[str, Any]]]] = {}
    with (tmp_path / "log.mcap").open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            value = json.loads(message.data)
            assert set(value) == set(json.loads(schema.data)["properties"])
            found.setdefault(channel.topic, []).append((message.log_time, value))
    assert {topic: len(messages) for topic, messages in found.items()} == told["messages"]
    seen = executed(session, unit)
    assert len(found["/joint_states"]) == len(seen.time_s)
    for (time_ns, state), q, time_s in zip(found["/joint_states"], seen.q, seen.time_s, strict=True):
        assert state["position"] == pytest.approx(q, abs=1e-9)
        assert time_ns == pytest.approx(1e9 * time_s, abs=1e3)
        assert seconds(state["header"]["stamp"]) == pytest.approx(time_s, abs=1e-6)
    assert len(found["/planned"]) == len(planned(session, unit))
    kinds = [event["kind"] for _, event in found["/events"]]
    assert kinds.count("stop") == 2
    assert kinds.count("sent") == len(session.stops) >= 2  # STOP goes again until it has come back
    assert found["/jaws"][-1][1]["fraction_closed"] == pytest.approx(
        unit.gripper.fraction_closed(420), abs=1e-3
    )


def test_without_the_library_it_is_told_how_to_get_it(
    run: LoggedRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = builtins.__import__

    def missing(name: str, *rest: Any) -> Any:
        if name.split(".")[0] == "mcap":
            raise ImportError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", missing)
    with pytest.raises(InputError, match="make mcap"):
        export(run, "mcap", tmp_path / "log.mcap")
    assert not (tmp_path / "log.mcap").exists()


def test_the_unit_is_told_by_the_gripper_and_may_be_given(
    run: LoggedRun, session: Session, tmp_path: Path
) -> None:
    assert unit_of(session, None).name == "crs93"
    assert unit_of(session, "crs97").name == "crs97"
    bare = tmp_path / "bare.jsonl"
    bare.write_text(
        '{"t":0,"kind":"open"}\n{"t":0,"kind":"received","data":"COORDAP=1,0,0,1,2,3,4,5,6\\r\\n"}\n'
    )
    with pytest.raises(InputError, match="give --unit, one of crs93, crs97"):
        unit_of(read_log(bare), None)
    told = export_step(bare, "csv", tmp_path / "bare.csv", False, "crs97", Console(as_json=True))
    assert told["samples"] == 1
    with pytest.raises(InputError, match="has no motion with a known start"):
        export_step(bare, "trajectory", tmp_path / "no.json", True, "crs97", Console(as_json=True))
    bare.write_text('{"t":0,"kind":"open"}\n')
    with pytest.raises(InputError, match="has no position sample"):
        export_step(bare, "csv", tmp_path / "no.csv", False, "crs97", Console(as_json=True))


def test_what_cannot_be_written_leaves_what_was_there(run: LoggedRun, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is read by this command"):
        export(run, "csv", run.log)
    with pytest.raises(InputError, match="--format xml: must be one of csv, trajectory, mcap"):
        export(run, "xml", tmp_path / "x")
    with pytest.raises(InputError, match="goes with --format trajectory only"):
        export(run, "csv", tmp_path / "x", sent=True)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        export(run, "csv", tmp_path / "file" / "x.csv")
    assert read_log(run.log).damaged == 0
