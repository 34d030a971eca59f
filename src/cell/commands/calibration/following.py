"""``a465 calibrate following``: the following error of each joint, from the position samples of runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from arm.errors import CalibrationRefused, InputError
from arm.se3 import Array
from cell.console import Console
from cell.export.series import unit_of
from cell.preview.executed import plan_of
from cell.report.run_folder import log_of
from driver.log.following import rests_of
from driver.log.read import read_log

LEAST_RESTS = 10
_CERTAIN = 0.95


def following_step(runs: Sequence[Path], unit: str | None, console: Console) -> dict[str, Any]:
    """Estimate the following error at rest, and the deviation from the path in motion.

    Args:
        runs: run folders, or their logs, of one unit.
        unit: of the logs; None: the one that they name.
        console: output.

    Raises:
        InputError: a log cannot be read, or they are of different units.
        CalibrationRefused: fewer than `LEAST_RESTS` rests.
    """
    off, aside, names = [np.zeros((0, 6))], [np.zeros((0, 6))], set()
    for run in runs:
        session = read_log(log_of(run))
        of = unit_of(session, unit)
        names.add(of.name)
        counts = np.array([rest.off for rest in rests_of(session)], dtype=float).reshape(-1, 6)
        off.append(counts / of.counts_per_rad)
        aside += [motion.difference for motion in plan_of(session, of)[1]]
    if len(names) != 1:
        raise InputError(
            f"the logs are of {' and '.join(sorted(names))}: must be of one unit", units=sorted(names)
        )
    at_rest, in_motion = np.concatenate(off), np.concatenate(aside)
    if len(at_rest) < LEAST_RESTS:
        raise CalibrationRefused(
            f"the arm was read at rest {len(at_rest)} times after a motion that ended: at least {LEAST_RESTS} are "
            "needed; give the logs of more runs",
            rests=len(at_rest),
        )
    rows = np.degrees([_rms(at_rest), np.abs(at_rest).max(axis=0), _rms(in_motion), _most(in_motion)]).T
    console.table(
        ("joint", "at rest rms deg", "at most deg", "off its path in motion rms deg", "at most deg"),
        [(f"J{joint + 1}", *(f"{value:.4f}" for value in row)) for joint, row in enumerate(rows)],
    )
    sigma = float(rows[:, 0].max() * _upper(len(at_rest)))
    key = f"{sigma:.2g}"
    console.say(
        f"{len(at_rest)} rests of {names.pop()}: with a probability of {100 * _CERTAIN:g} % no joint errs by more than "
        f"this standard deviation; to use it, write into the cell file, in [accuracy]:"
    )
    console.say(f"following_deg = {key}")
    columns = ("rest_rms_deg", "rest_most_deg", "motion_rms_deg", "motion_most_deg")
    return {
        "rests": len(at_rest),
        "samples_in_motion": len(in_motion),
        "following_deg": float(key),
        "joints": [dict(zip(columns, row.tolist(), strict=True)) for row in rows],
    }


def _rms(errors: Array) -> Array:
    """Root mean square of each joint; a joint that is always off in the same direction errs by that, too."""
    return np.asarray(np.sqrt(np.mean(errors**2, axis=0))) if len(errors) else np.zeros(errors.shape[1])


def _most(errors: Array) -> Array:
    return np.asarray(np.abs(errors).max(axis=0, initial=0.0))


def _upper(count: int) -> float:
    """Upper confidence limit of a standard deviation over its estimate from `count` errors."""
    from scipy.stats import chi2

    return float(np.sqrt(count / chi2.ppf(1.0 - _CERTAIN, count)))
