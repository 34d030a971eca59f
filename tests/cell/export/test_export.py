"""A log in other forms: times that increase, figures that agree with the arm's own, whole files or none."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from arm.controller.unit import Unit, load_unit
from arm.errors import InputError
from driver.log.read import read_log
from wire.exported import export
from wire.logged_session import LoggedRun

pytestmark = pytest.mark.xdist_group("logs")


@pytest.fixture(scope="module")
def unit() -> Unit:
    return load_unit("crs93")


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
