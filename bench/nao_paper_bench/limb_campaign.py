"""Rows of `bench/nao.py` about limbs that are not as long as the model's."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from arm.se3 import Array
from calib.chain.fit import ChainFit, fit_chains
from calib.chain.result import ChainCalibration
from calib.nao.calibrate import BACKLASH, COMPLIANCE, HEAD, LIMBS, calibrate_nao
from calib.nao.chain import LEG_JOINTS, SIDES, NaoUnknowns
from calib.nao.limbs import LIMB_NAMES, find_limb_errors
from nao_paper_bench.kinematics import NaoKinematics
from nao_paper_bench.run import recording_of, run_measurement
from nao_paper_bench.stance_design import Plan
from nao_paper_bench.table_2 import PAPER_PIXEL_SIGMA, READING_SIGMA, table_2_robot


def joint_rms_deg(fit: ChainFit, truth: NaoKinematics) -> float:
    """Over the legs' offsets; head, springs and play of the truth may be unknown to the fit and the other way round."""
    places = [NaoUnknowns().names.index(f"{j}_deg") for j in LEG_JOINTS]
    return float(np.degrees(np.sqrt(np.mean((fit.unknowns[places] - truth.x[places]) ** 2))))


def parts_of(c: ChainCalibration) -> tuple[bool, ...]:
    """Whether head, compliance, backlash and limbs are in a model."""
    needed = {t.part for t in c.trials if t.needed}
    return tuple(part in needed for part in (HEAD, COMPLIANCE, BACKLASH, LIMBS))


def limb_row(true: NaoUnknowns, seed: int, plan: Plan) -> tuple[float, ...]:
    """Calibrate a robot with the errors `true` and hard backlash; a row for `print_limb_rows`."""
    rng = np.random.default_rng([seed, 18])
    truth = table_2_robot(true, rng, hard=true.backlash)
    m = run_measurement(truth, plan, rng)
    began = time.perf_counter()
    c = calibrate_nao(recording_of(m))
    took = time.perf_counter() - began
    x = np.array([truth.x[true.names.index(n)] if n in true.names else 0.0 for n in c.names])
    right = parts_of(c) == (true.head, true.compliance, true.backlash, true.limbs)
    found = (*_limb_errors(c, x), joint_rms_deg(c.fit, truth), c.fit.chi2_dof, took)
    return (*found, float(parts_of(c)[3]), float(right), float(c.accepted))


def print_limb_rows(name: str, rows: Sequence[tuple[float, ...]]) -> None:
    """Print for robots of one kind whether limbs were chosen and found."""
    mean, r, n = np.mean(rows, axis=0), np.median(rows, axis=0), len(rows)
    in_model, right, accepted = (n * mean[-3:]).round().astype(int)
    print(
        f"limbs, {name}: limbs in the model {in_model} of {n}, all parts those of the truth {right}, accepted "
        f"{accepted}; limbs {1e3 * r[0]:.3f} mm rms (told {1e3 * r[1]:.3f}), NEES per dof of limbs {mean[2]:.2f}, "
        f"of all {mean[3]:.2f}, with the target's size tolerance {mean[4]:.2f}; joints {r[5]:.4f} deg, chi2 "
        f"{r[6]:.3f}, {r[7]:.1f} s (most {max(row[7] for row in rows):.1f})",
        flush=True,
    )


def _limb_errors(c: ChainCalibration, x: Array) -> tuple[float, float, float, float, float]:
    """Of limbs, rms and as told, m; NEES of limbs and of all free unknowns, and with the covariance that is told."""
    limb, free = [c.names.index(n) for n in LIMB_NAMES], c.problem.free
    off, bare = c.fit.unknowns - x, c.fit.covariance(free)
    every, told = np.flatnonzero(free), c.covariance

    def nees(which: Sequence[int], covariance: Array) -> float:
        e = off[which]
        return float(e @ np.linalg.solve(covariance[np.ix_(which, which)], e) / len(which))

    of_limbs = nees(limb, bare) if free[limb].all() else float("nan")
    sigma = float(np.sqrt(np.mean(np.diag(told)[limb])))
    rms = float(np.sqrt(np.mean(off[limb] ** 2)))
    return rms, sigma, of_limbs, nees(every.tolist(), bare), nees(every.tolist(), told)


def one_limb(seeds: int, stances: Callable[[int], Plan]) -> None:
    """Print whether a single limb, 0.5 mm longer, is the one that is named after a fit of the paper's model.

    Args:
        seeds: robots; the limb is another in each of ten.
        stances: of a seed.
    """
    longer = NaoUnknowns(limbs=True)
    first, alone, amounts, tests, fits = 0, 0, [], [], []
    for seed in range(seeds):
        rng = np.random.default_rng([seed, 19])
        truth, name = table_2_robot(longer, rng), LIMB_NAMES[seed % len(LIMB_NAMES)]
        x = truth.x.copy()
        x[[longer.names.index(n) for n in LIMB_NAMES]] = 0.0
        x[longer.names.index(name)] = 0.5e-3
        m = run_measurement(replace(truth, x=x), stances(seed), rng)
        problem = m.problem(longer, PAPER_PIXEL_SIGMA, READING_SIGMA)
        free = np.array([n not in LIMB_NAMES for n in longer.names])
        began = time.perf_counter()
        problem = replace(problem, free=free)
        fit = fit_chains(problem)
        fits.append(time.perf_counter() - began)
        test = find_limb_errors(problem, fit, longer, SIDES)
        tests.append(time.perf_counter() - began - fits[-1])
        sure = [limb.name for limb in test.limbs if limb.sure]
        first += test.drop > test.limit and test.limbs[0].name == f"limb {name.removesuffix('_mm')}"
        alone += sure == [f"limb {name.removesuffix('_mm')}"]
        amounts.append(next(1e3 * t.amount for t in test.limbs if t.name.split()[1] == name[:-3]))
    print(
        f"limbs, one 0.5 mm longer: named first {first} of {seeds}, the only one that is sure {alone}; its amount "
        f"{np.mean(amounts):.3f} mm (from {min(amounts):.2f} to {max(amounts):.2f}); score test "
        f"{np.median(tests):.2f} s after a fit of {np.median(fits):.2f} s",
        flush=True,
    )
