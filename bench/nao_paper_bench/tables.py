"""The NAO paper's tables in print, and a run's figures as JSON."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from arm.se3 import Array
from calib.nao.chain import LEG_JOINTS, NaoUnknowns
from nao_paper_bench.kinematics import NaoKinematics, standing_error

PAPER = NaoUnknowns()
Say = Callable[[str], None]
"""Prints a line."""


@dataclass(frozen=True, eq=False)
class PaperRun:
    """One run by one method: a column of Table 2.

    Attributes:
        taken: the NAO as identified.
        iterations: of the solver, of all its fits.
        robot_s, solve_s: how long the robot took, and the solver.
        rms: of the residuals in x and y, readings taken as they are, (2,) px.
    """

    taken: NaoKinematics
    iterations: int
    robot_s: float
    solve_s: float
    rms: Array


def joint_rms_deg(x: Array, true: NaoKinematics) -> float:
    """Rms error of the legs' offsets among unknowns x that begin with the paper's."""
    places = [PAPER.names.index(f"{j}_deg") for j in LEG_JOINTS]
    return float(np.degrees(np.sqrt(np.mean((x[places] - true.x[places]) ** 2))))


def print_table_1(say: Say) -> None:
    """The identified parameters."""
    say("Table 1: identified parameters")
    kinds = {"deg": "rotation, deg", "mm": "translation, mm"}
    for i in range(0, 21, 3):
        row = [n.rpartition("_") for n in PAPER.names[i : i + 3]]
        say("  " + "".join(f"{name:<16}{kinds[unit]:<18}" for name, _, unit in row).rstrip())
    say("")


def print_table_2(
    papers: Sequence[PaperRun], ours: Sequence[PaperRun], true: NaoKinematics, say: Say
) -> None:
    """Consecutive runs: the paper's method run by run, both methods' mean and deviation, and the truth."""
    say("Table 2: consecutive runs of one robot with play, springs, a head that is off, and masses 10 % off")
    numbers = "".join(f"{n:>10}" for n in range(2, len(papers) + 1))
    say(f"{'the paper: 1':>30}{numbers}{'mean':>20}{'ours, mean':>20}{'truth':>10}")
    unit = PAPER.si()
    for i, name in enumerate(PAPER.names):
        by_paper, by_us = (np.array([r.taken.x[i] for r in runs]) / unit[i] for runs in (papers, ours))
        word, _, of = name.rpartition("_")
        each = "".join(f"{value:>10.4f}" for value in by_paper)
        means = f"{_mean(by_paper):>20}{_mean(by_us):>20}"
        say(f"  {f'{word} [{of}]':<18}{each}{means}{true.x[i] / unit[i]:>10.4f}")
    rows: list[tuple[str, Callable[[PaperRun], float], str]] = [
        ("Iterations", lambda r: float(r.iterations), ".0f"),
        ("Robot [s]", lambda r: r.robot_s, ".0f"),
        ("Solver [s]", lambda r: r.solve_s, ".2f"),
        ("rms x [px]", lambda r: float(r.rms[0]), ".4f"),
        ("rms y [px]", lambda r: float(r.rms[1]), ".4f"),
    ]
    for word, of_run, form in rows:
        a, b = ([of_run(r) for r in runs] for runs in (papers, ours))
        each = "".join(f"{value:>10{form}}" for value in a)
        say(f"  {word:<18}{each}{np.mean(a):>20{form}}{np.mean(b):>20{form}}")
    joints = [np.mean([joint_rms_deg(r.taken.x, true) for r in runs]) for runs in (papers, ours)]
    stand = [1e3 * np.mean([standing_error(true, r.taken).rms for r in runs]) for runs in (papers, ours)]
    say(f"  joints off the truth: {joints[0]:.3f} deg rms by the paper's method, {joints[1]:.3f} deg by ours")
    say(
        f"  soles of a standing robot: {stand[0]:.2f} mm rms off by the paper's method, {stand[1]:.2f} mm by ours"
    )
    say("")


def _mean(values: Array) -> str:
    return f"{values.mean():.4f} ± {values.std(ddof=1):.4f}"


def run_as_json(run: PaperRun) -> dict[str, Any]:
    """Parameters with the names of the data's truth."""
    unknowns = run.taken.unknowns
    values = dict(zip(unknowns.names, (run.taken.x / unknowns.si()).tolist(), strict=True))
    return {
        "parameters": values,
        "iterations": run.iterations,
        "robot_s": run.robot_s,
        "solve_s": run.solve_s,
        "rms_px": run.rms.tolist(),
    }
