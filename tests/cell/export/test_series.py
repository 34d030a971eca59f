"""What was planned and executed, as series over time."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from arm.controller.unit import Unit, load_unit
from arm.errors import InputError
from cell.console import Console
from cell.export.export import ExportOptions, export_file
from cell.export.series import executed, planned, unit_of
from driver.log.read import Session, read_log
from wire.exported import export, seconds
from wire.logged_session import LoggedRun

pytestmark = pytest.mark.xdist_group("logs")


@pytest.fixture(scope="module")
def unit() -> Unit:
    return load_unit("crs93")


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
    (index,) = (i for i, logged in enumerate(session.motions) if logged.sent_s == motion.sent_s)
    seen = executed(session, unit)
    compared = 0
    for i, number in enumerate(seen.motion):
        if number != index or seen.segment[i] < 1:
            continue
        near = np.abs(motion.time_s - seen.time_s[i]) <= 1.0
        stretch = motion.q[near]
        assert np.all(seen.q[i] >= stretch.min(axis=0) - 1e-3)
        assert np.all(seen.q[i] <= stretch.max(axis=0) + 1e-3)
        compared += 1
    assert compared >= 5


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
    console = Console(as_json=True)
    told = export_file(bare, ExportOptions("csv", tmp_path / "bare.csv", unit="crs97"), console)
    assert told["samples"] == 1
    with pytest.raises(InputError, match="has no motion with a known start"):
        export_file(bare, ExportOptions("trajectory", tmp_path / "no.json", True, "crs97"), console)
    bare.write_text('{"t":0,"kind":"open"}\n')
    with pytest.raises(InputError, match="has no position sample"):
        export_file(bare, ExportOptions("csv", tmp_path / "no.csv", unit="crs97"), console)


def test_another_unit_than_that_in_the_log_is_refused(tmp_path: Path) -> None:
    log = tmp_path / "wire.jsonl"
    log.write_text('{"t":0,"kind":"open"}\n{"t":0,"kind":"run","unit":"crs93"}\n')
    session = read_log(log)
    assert unit_of(session, "crs93").name == unit_of(session, None).name == "crs93"
    with pytest.raises(InputError, match="--unit crs97: the log is of crs93, and with another unit"):
        unit_of(session, "crs97")
