"""``a465 calibrate following``: standard deviations of errors that are known."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from arm.errors import CalibrationRefused, InputError
from cell.commands.calibration.following import LEAST_RESTS, following_step
from cell.console import Console
from cell.report.run_folder import LOG
from typed.command_line import ended
from wire.erring_axes import ABSOLUTE_MOVES, erring_log


@pytest.mark.slow
def test_errors_of_known_size_are_estimated_and_bounded(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sigmas = np.array([2.0, 6.0, 4.0, 0.0, 3.0, 1.0])  # counts
    off = np.clip(np.rint(np.random.default_rng(1).normal(size=(24, 6)) * sigmas), -20, 20).astype(int)
    units = [
        erring_log(tmp_path / f"{name}.jsonl", rows.tolist())
        for name, rows in (("a", off[:12]), ("b", off[12:]))
    ]
    found = following_step([tmp_path / "a.jsonl", tmp_path / "b.jsonl"], None, Console())
    count = found["rests"]
    assert count == len(off) + 2 * ABSOLUTE_MOVES
    per_rad = np.abs(units[0].counts_per_rad)
    rms = np.degrees(np.sqrt((off**2).sum(axis=0) / count) / per_rad)
    most = np.degrees(np.abs(off).max(axis=0) / per_rad)
    assert [of["rest_rms_deg"] for of in found["joints"]] == pytest.approx(rms.tolist(), abs=1e-9)
    assert [of["rest_most_deg"] for of in found["joints"]] == pytest.approx(most.tolist(), abs=1e-9)
    true = float(np.degrees(sigmas / per_rad).max())
    assert true < found["following_deg"] < 1.6 * true
    assert f"\nfollowing_deg = {found['following_deg']:g}\n" in capsys.readouterr().out


@pytest.mark.slow
def test_in_motion_an_axis_that_drifts_is_off_its_path(tmp_path: Path) -> None:
    off = [[0, 15, 0, 0, 0, 0]] * LEAST_RESTS
    unit = erring_log(tmp_path / "wire.jsonl", off)
    found = following_step([tmp_path / "wire.jsonl"], "crs93", Console())
    drifted, others = found["joints"][1], [*found["joints"][:1], *found["joints"][2:]]
    fifteen = float(np.degrees(15 / np.abs(unit.counts_per_rad[1])))
    assert drifted["motion_most_deg"] == pytest.approx(fifteen, rel=0.35)  # the nearest point is nearer
    assert max(of["rest_most_deg"] for of in others) == 0.0


def test_too_few_rests_and_logs_of_two_units_are_refused(tmp_path: Path) -> None:
    erring_log(tmp_path / "wire.jsonl", [[0] * 6] * 3)
    with pytest.raises(
        CalibrationRefused,
        match=f"{3 + ABSOLUTE_MOVES} times after a motion that ended: at least {LEAST_RESTS}",
    ):
        following_step([tmp_path], None, Console())
    code, said = ended("calibrate", "following", tmp_path, cwd=tmp_path)
    assert code == 5
    assert "give the logs of more runs" in said
    other = tmp_path / "other.jsonl"
    noted = json.dumps({"t": 0.0, "kind": "run", "unit": "crs97"})
    other.write_text(f"{(tmp_path / LOG).read_text()}{noted}\n")
    with pytest.raises(InputError, match="the logs are of crs93 and crs97: must be of one unit"):
        following_step([tmp_path, other], None, Console())


def test_a_folder_of_runs_is_told_with_the_runs_in_it(tmp_path: Path) -> None:
    with pytest.raises(InputError) as refused:
        following_step([tmp_path], None, Console())
    assert str(refused.value) == f"{tmp_path}: has no {LOG}: it is no run, nor is any folder in it"
    for number in range(1, 7):
        (tmp_path / f"task2-{number}").mkdir()
        (tmp_path / f"task2-{number}" / LOG).touch()
    code, said = ended("calibrate", "following", ".", cwd=tmp_path)
    assert code == 2
    told = "it is no run; give the runs in it: task2-1 task2-2 task2-3 task2-4 and 2 more"
    assert f".: has no {LOG}: {told}" in said
