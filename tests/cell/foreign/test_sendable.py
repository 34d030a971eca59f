"""A trajectory becomes segments in whole counts that keep limits and stay on it, or is refused with its reason."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.io.storage import data_file
from arm.plan_file import Plan
from arm.se3 import frozen
from cell.files.task import read_place
from cell.foreign.sendable import DEVIATION, plan_of_trajectory
from cell.foreign.trajectory_file import JointTrajectory
from cell.task.pose_list_planning import place_of_cell
from plan.trajectory.extremes import segment_extremes

START = np.radians([-60.0, -40.0, -80.0, 0.0, -60.0, 0.0])


def _wave(lasts: float, every: float, size: float = 0.2) -> JointTrajectory:
    """From rest to rest, there and back by `size` rad with all joints, a point every so many seconds."""
    t = np.linspace(0.0, lasts, 1 + round(lasts / every))
    u, rate = t / lasts, 1.0 / lasts
    bump, slope = 16.0 * u**2 * (1.0 - u) ** 2, 32.0 * u * (1.0 - u) * (1.0 - 2.0 * u) * rate
    way = size * np.array([1.0, 0.5, 0.7, -1.0, 0.5, 1.0])
    return JointTrajectory(frozen(t), frozen(START + bump[:, None] * way), frozen(slope[:, None] * way))


def _plan(folder: Path, of: JointTrajectory, speed: float = 0.5) -> Plan:
    file = folder / "other.json"
    file.write_text("{}")
    place = place_of_cell(read_place(data_file("scenes/cell.toml")), None, speed)
    return plan_of_trajectory(file, of, place, 0.005)


@pytest.mark.parametrize("every", [0.01, 0.033, 0.1, 0.4])
def test_what_is_sent_stays_on_the_trajectory_and_within_the_limits(tmp_path: Path, every: float) -> None:
    of = _wave(12.0, every)
    (move,) = _plan(tmp_path, of).moves
    task = read_place(data_file("scenes/cell.toml"))
    unit, limits = task.cell.unit, task.cell.limits.scaled(0.5)
    at = np.linspace(0.0, of.duration, 1001)
    off = np.abs(unit.positions(move.path.at(at)) - of.at(at)[0]) - 1.0 / np.abs(unit.counts_per_rad)
    assert off.max() <= DEVIATION
    assert min(segment.duration_ms for segment in move.path.segments) >= 40
    found = segment_extremes(move.path, unit)
    assert (found.velocity <= limits.velocity * (1.0 + 1e-9)).all()
    assert (found.acceleration <= limits.acceleration * (1.0 + 1e-9)).all()
    assert found.jumps.max() < 0.01
    assert move.certified
    assert move.clearance >= 0.005


def test_what_cannot_be_sent_is_refused_with_its_reason(tmp_path: Path) -> None:
    wave = _wave(12.0, 0.1)
    lines = JointTrajectory(wave.times, wave.q, None)
    moving = JointTrajectory(wave.times[5:], wave.q[5:], _wave(12.0, 0.1).velocity[5:])  # type: ignore[index]
    short = JointTrajectory(frozen([0.0, 0.02]), wave.q[:2], frozen(np.zeros((2, 6))))
    shaken = np.array(wave.velocity)
    shaken[9:12, 0] = [0.3, -0.3, 0.3]
    for of, speed, rule in (
        (lines, 0.5, "give velocities"),
        (moving, 0.5, "does not begin at rest"),
        (short, 0.5, "takes 0.020 s; the controller needs at least 40 ms"),
        (_wave(12.0, 0.1, 0.9), 0.1, "needs .* of its .* limit at speed 0.1"),
    ):
        with pytest.raises(ImpossibleError, match=rule):
            _plan(tmp_path, of, speed)
    dense = _wave(12.0, 0.01)
    rough = np.array(dense.q)
    rough[601, 0] += 0.002  # between knots that are 40 ms apart
    with pytest.raises(ImpossibleError, match=r"J1 would be .* off 6.0.0 s after the start"):
        _plan(tmp_path, JointTrajectory(dense.times, frozen(rough), dense.velocity))


def test_the_plan_is_refused_if_a_body_is_near(tmp_path: Path) -> None:
    file = tmp_path / "other.json"
    file.write_text("{}")
    place = place_of_cell(read_place(data_file("scenes/cell.toml")), None, 0.5)
    with pytest.raises(ImpossibleError, match=r"in whole counts: .* comes within") as caught:
        plan_of_trajectory(file, _wave(12.0, 0.1), place, 0.3)
    assert caught.value.data["distance_m"] < 0.3
