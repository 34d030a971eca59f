"""Messages of ROS 2, with the fields of their definitions."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from arm.controller.unit import Unit, load_unit
from cell.export.series import executed
from driver.log.read import Session
from wire.exported import export, seconds
from wire.logged_session import LoggedRun

pytestmark = pytest.mark.xdist_group("logs")


@pytest.fixture(scope="module")
def unit() -> Unit:
    return load_unit("crs93")


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
