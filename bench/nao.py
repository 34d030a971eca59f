"""Benchmark of the NAO's calibration: medians over seeds, one row per claim.

python bench/nao.py --seeds 20 --honest 100

Simulated runs (`nao_paper_bench.run`): the robot on its back drives to each stance and settles; vertices are
drawn with the paper's noise (0.0486, 0.0403) px, not rendered; joints stop within 0.2 deg of where they are
sent. Truth: the mean column of the paper's Table 2; with springs 0.3 to 0.9 deg/Nm and half plays 0.2 to 0.6
deg in rows that say so. 24 stances a leg with three postures of the head, drawn anew for each seed from a
pool of 300 a leg, unless a row says `planned`. Models are chosen by hand but in the verdict's rows; whether
play is hard or smooth is found by the fit.
Joint errors: rms over the 12 offsets. Standing error: rms distance of the soles in the camera over 600 standing and
swinging postures, gravity down.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from nao_paper_bench.kinematics import ON_ITS_BACK, NaoKinematics, masses_off, standing_error
from nao_paper_bench.limb_campaign import joint_rms_deg, limb_row, one_limb, parts_of, print_limb_rows
from nao_paper_bench.robot import Servos
from nao_paper_bench.run import NaoMeasurement, recording_of, run_measurement
from nao_paper_bench.stance_design import (
    Plan,
    Sensing,
    find_pool,
    plan_stances,
    random_stances,
    stance_informations,
)
from nao_paper_bench.stance_pool import Stance
from nao_paper_bench.table_2 import (
    NAO_CAMERA,
    PAPER_PIXEL_SIGMA,
    READING_SIGMA,
    VERTICES,
    table_2_robot,
)

from arm.se3 import Array
from calib.chain.fit import ChainFit, fit_chains
from calib.nao.backlash import fit_compliance_and_backlash
from calib.nao.calibrate import NAO_LIMITS, calibrate_nao
from calib.nao.chain import LEG_JOINTS, SIDES, NaoUnknowns

PAPER, HEAD, ALL = NaoUnknowns(), NaoUnknowns(head=True), NaoUnknowns(True, True, True)
SENSING = Sensing(NAO_CAMERA, VERTICES, PAPER_PIXEL_SIGMA, np.full(8, READING_SIGMA))
POOL = 300


@dataclass(frozen=True)
class Runs:
    """How many seeds, and the pool."""

    seeds: int
    honest: int
    pool: list[Stance]

    def stances(self, seed: int) -> Plan:
        """24 at random, as many as the paper has."""
        return random_stances(self.pool, 24, SENSING, PAPER, np.random.default_rng([seed, 24]))


def fitted(m: NaoMeasurement, unknowns: NaoUnknowns, reading_sigma: float) -> tuple[ChainFit, float]:
    """A fit from zero and how long it took, s."""
    problem = m.problem(unknowns, PAPER_PIXEL_SIGMA, reading_sigma)
    began = time.perf_counter()
    fit = fit_chains(problem)
    return fit, time.perf_counter() - began


def exact(runs: Runs) -> None:
    """Exact encoders: the paper's simulation."""
    rows = []
    for seed in range(runs.seeds):
        truth = table_2_robot(PAPER, np.random.default_rng(seed))
        m = run_measurement(truth, runs.stances(seed), np.random.default_rng(seed), Servos(step=0.0))
        fit, took = fitted(m, PAPER, 0.0)
        std = np.concatenate([r.reshape(-1, 2) for r in fit.residuals]).std(axis=0)
        rows.append((*std, fit.iterations, took, joint_rms_deg(fit, truth)))
    x, y, iterations, took, joints = np.median(rows, axis=0)
    print(
        f"exact encoders: residual std {x:.4f} / {y:.4f} px ({100 * (x / 0.0486 - 1):+.1f} / "
        f"{100 * (y / 0.0403 - 1):+.1f} % of the noise), {iterations:.0f} iterations from zero (most "
        f"{max(r[2] for r in rows):.0f}), {took:.2f} s, joints {joints:.4f} deg"
    )


def coarse(runs: Runs) -> None:
    """0.1 deg encoders, weighed and not."""
    ours: list[tuple[float, float, float, float]] = []
    paper: list[tuple[float, float, float, float]] = []
    for seed in range(runs.honest):
        truth = table_2_robot(PAPER, np.random.default_rng(seed))
        m = run_measurement(truth, runs.stances(seed), np.random.default_rng(seed))
        for sigma, rows in ((READING_SIGMA, ours), (0.0, paper)):
            fit, took = fitted(m, PAPER, sigma)
            off = fit.unknowns - truth.x
            rows.append(
                (joint_rms_deg(fit, truth), float(off @ fit.information @ off) / len(off), fit.chi2_dof, took)
            )
    for name, rows in (("encoders weighed", ours), ("the paper's pixel cost", paper)):
        first = np.median(rows[: max(runs.seeds, 20)], axis=0)
        nees = np.array(rows)[:, 1]
        print(
            f"0.1 deg encoders, {name}: joints {first[0]:.4f} deg, NEES per dof mean {nees.mean():.3g} of {len(rows)} "
            f"seeds (standard error {nees.std() / np.sqrt(len(nees)):.2g}), chi2 {first[2]:.3g}, {first[3]:.2f} s"
        )


def head(runs: Runs) -> None:
    """Head offsets, left out and looked for."""
    rows = []
    for seed in range(runs.seeds):
        truth = table_2_robot(HEAD, np.random.default_rng(seed))
        plan = runs.stances(seed)
        m = run_measurement(truth, plan, np.random.default_rng(seed))
        fit, _ = fitted(m, HEAD, READING_SIGMA)
        without, _ = fitted(m, PAPER, READING_SIGMA)
        pixel, _ = fitted(m, PAPER, 0.0)
        bound = _bound_deg(plan, HEAD, truth.x)
        c = fit.covariance(np.ones(len(HEAD.names), dtype=bool))
        a, b = HEAD.names.index("CamPitch_deg"), HEAD.names.index("HeadPitch_deg")
        rows.append(
            (
                joint_rms_deg(fit, truth),
                bound,
                joint_rms_deg(fit, truth) / bound,
                c[a, b] / np.sqrt(c[a, a] * c[b, b]),
                fit.chi2_dof,
                without.chi2_dof,
                joint_rms_deg(pixel, truth),
            )
        )
    m = np.median(rows, axis=0)
    pooled = np.sqrt(np.mean(np.square(rows), axis=0))
    print(
        f"head offsets (0.5, -0.4) deg: joints {m[0]:.4f} deg, bound {m[1]:.4f}, ratio {m[2]:.2f} (pooled "
        f"{pooled[0] / pooled[1]:.2f}), CamPitch/HeadPitch correlation {m[3]:+.3f}, chi2 {m[4]:.3f}; without head "
        f"offsets chi2 {m[5]:.2f}; the paper's model and cost: joints {m[6]:.3f} deg"
    )


def _bound_deg(plan: Plan, unknowns: NaoUnknowns, x: Array) -> float:
    """Rms standard deviation of the joints at the truth, nothing known before."""
    information = stance_informations(plan.stances, SENSING, unknowns, x).sum(axis=0)
    places = [unknowns.names.index(f"{j}_deg") for j in LEG_JOINTS]
    return float(np.degrees(np.sqrt(np.diag(np.linalg.inv(information))[places].mean())))


def few(runs: Runs) -> None:
    """Four stances a leg."""
    for criterion in ("A", "D"):
        began, busy = time.perf_counter(), time.process_time()
        plan = plan_stances(runs.pool, 4, SENSING, PAPER, criterion=criterion)
        took, busy = time.perf_counter() - began, time.process_time() - busy
        errors, robot = _four(runs, _always(plan))
        print(
            f"4 planned stances a leg, {criterion}-optimal: planned in {took:.1f} s ({busy:.1f} s busy); joints "
            f"{np.median(errors):.4f} deg (rms {np.sqrt(np.mean(np.square(errors))):.4f}, "
            f"predicted {plan.joint_sigma_deg:.4f}), robot {robot:.0f} s"
        )
    drawn, _ = _four(
        runs, lambda seed: random_stances(runs.pool, 4, SENSING, PAPER, np.random.default_rng([seed, 4]))
    )
    print(f"4 random stances a leg: joints {np.median(drawn):.4f} deg")


def _always(plan: Plan) -> Callable[[int], Plan]:
    return lambda _: plan


def _four(runs: Runs, plan_of: Callable[[int], Plan]) -> tuple[list[float], float]:
    errors, robot = [], 0.0
    for seed in range(runs.seeds):
        truth = table_2_robot(PAPER, np.random.default_rng(seed))
        m = run_measurement(truth, plan_of(seed), np.random.default_rng(seed))
        errors.append(joint_rms_deg(fitted(m, PAPER, READING_SIGMA)[0], truth))
        robot = m.duration
    return errors, robot


def soft(runs: Runs) -> None:
    """Springs and play: errors of a robot that stands."""
    began = time.perf_counter()
    guess = np.where([("comp" in n or "back" in n) for n in ALL.names], np.radians(0.5), 0.0)
    plan = plan_stances(runs.pool, 24, SENSING, ALL, guess)
    print(f"24 stances a leg planned for springs and play in {time.perf_counter() - began:.1f} s")
    cases = (
        ("smooth play, masses exact", 0.0, False, (0.2, 0.6)),
        ("smooth play, masses 10 % off", 0.1, False, (0.2, 0.6)),
        ("hard play, masses exact", 0.0, True, (0.2, 0.6)),
        ("hard play, masses 10 % off", 0.1, True, (0.2, 0.6)),
        ("hard play of 5 deg (half 2.5), masses 10 % off", 0.1, True, (2.5, 2.5)),
        ("hard play of +-5 deg (half 5), masses 10 % off", 0.1, True, (5.0, 5.0)),
    )
    for stances in ("planned", "random"):
        for name, off, hard, half in cases if stances == "planned" else cases[:4]:
            rows = []
            for seed in range(runs.seeds):
                rng = np.random.default_rng(seed)
                truth = table_2_robot(ALL, rng, hard, masses_off(off, rng) if off else None, half)
                m = run_measurement(truth, plan if stances == "planned" else runs.stances(seed), rng)
                rows.append(_standing(m, truth, hard))
            r = np.median(np.array(rows, dtype=float), axis=0)
            worst = max(row[0] for row in rows)
            print(
                f"springs, {name}, {stances}: standing {r[0]:.3f} mm rms (worst seed {worst:.2f}), {r[1]:.3f} deg, "
                f"chi2 {r[2]:.3f}, shape right in {sum(row[3] for row in rows):.0f} of {len(rows)}, {r[4]:.1f} s; "
                f"the paper's model and cost {r[5]:.2f} mm, residuals {r[6]:.2f} / {r[7]:.2f} px rms; "
                f"images missed {r[8]:.0f}",
                flush=True,
            )


def _standing(m: NaoMeasurement, truth: NaoKinematics, hard: bool) -> tuple[float, ...]:
    problem = m.problem(ALL, PAPER_PIXEL_SIGMA, READING_SIGMA)
    began = time.perf_counter()
    found = fit_compliance_and_backlash(problem, ALL, [i.side for i in m.images], ON_ITS_BACK)
    took = time.perf_counter() - began
    ours = standing_error(truth, NaoKinematics(ALL, found.fit.unknowns, found.hard))
    plain = fit_chains(replace(m.problem(PAPER, np.ones(2), 0.0)))
    rms = np.sqrt(np.nanmean(np.concatenate([r.reshape(-1, 2) for r in plain.residuals]) ** 2, axis=0))
    paper = standing_error(truth, NaoKinematics(PAPER, plain.unknowns))
    return (
        1e3 * ours.rms,
        float(np.degrees(ours.rotation_rms)),
        found.fit.chi2_dof,
        float(found.hard == hard),
        took,
        1e3 * paper.rms,
        *rms,
        float(m.missed),
    )


def verdict(runs: Runs) -> None:
    """Five kinds of robots: is the right model chosen and accepted, and is one that lacks a part found out?"""
    kinds = {
        "as the paper has it": PAPER,
        "head off": HEAD,
        "springs": NaoUnknowns(compliance=True),
        "hard play": NaoUnknowns(backlash=True),
        "head off, springs and play": ALL,
    }
    wrong = 0
    for name, true in kinds.items():
        accepted, chosen, found_out, chi2 = 0, 0, 0, []
        for seed in range(runs.seeds):
            rng = np.random.default_rng([seed, 5])
            truth = table_2_robot(true, rng, hard=name == "hard play")
            m = run_measurement(truth, runs.stances(seed), rng)
            c = calibrate_nao(recording_of(m))
            accepted += c.accepted
            chosen += parts_of(c) == (true.head, true.compliance, true.backlash, true.limbs)
            chi2.append(c.fit.chi2_dof)
            plain = fit_chains(m.problem(PAPER, PAPER_PIXEL_SIGMA, READING_SIGMA))
            found_out += (plain.chi2_dof > NAO_LIMITS.chi2_dof) == (true != PAPER)
        wrong += 2 * runs.seeds - accepted - found_out
        print(
            f"verdict, {name}: accepted {accepted} of {runs.seeds}, with the parts of the truth {chosen}, chi2 "
            f"{min(chi2):.3f} to {max(chi2):.3f}; the paper's unknowns alone judged rightly {found_out}",
            flush=True,
        )
    print(
        f"verdict: {wrong} wrong of {2 * runs.seeds * len(kinds)} in {runs.seeds * len(kinds)} sets",
        flush=True,
    )


def limbs(runs: Runs) -> None:
    """Limbs that are 0.5 mm longer or shorter: chosen, found, and told by a score test."""
    for kind, true in {"as the paper has it": PAPER, "limbs off": NaoUnknowns(limbs=True)}.items():
        print_limb_rows(kind, [limb_row(true, seed, runs.stances(seed)) for seed in range(runs.seeds)])


def soft_limbs(runs: Runs) -> None:
    """A quarter as many robots with limbs off, head off, springs and hard play."""
    guess = np.where([("comp" in n or "back" in n) for n in ALL.names], np.radians(0.5), 0.0)
    plan = plan_stances(runs.pool, 24, SENSING, ALL, guess)
    few = range(max(1, runs.seeds // 4))
    kind = "limbs and head off, springs and hard play"
    print_limb_rows(kind, [limb_row(replace(ALL, limbs=True), seed, plan) for seed in few])


def single_limb(runs: Runs) -> None:
    """One limb 0.5 mm longer, and the score test alone."""
    one_limb(runs.seeds, runs.stances)


ROWS = {
    "exact": exact,
    "coarse": coarse,
    "head": head,
    "few": few,
    "soft": soft,
    "verdict": verdict,
    "limbs": limbs,
    "soft-limbs": soft_limbs,
    "single-limb": single_limb,
}


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--honest", type=int, default=100, help="seeds of the NEES")
    parser.add_argument("--rows", nargs="*", choices=ROWS, default=list(ROWS))
    arguments = parser.parse_args()
    print(
        f"python {platform.python_version()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, {vars(arguments)}"
    )
    began = time.perf_counter()
    pool = find_pool(NAO_CAMERA, POOL, 1)
    print(
        f"pool: {POOL} stances of each of {len(SIDES)} legs in {time.perf_counter() - began:.1f} s",
        flush=True,
    )
    runs = Runs(arguments.seeds, arguments.honest, pool)
    for row in arguments.rows:
        ROWS[row](runs)
        sys.stdout.flush()
    print(f"{time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
