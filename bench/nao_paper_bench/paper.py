"""The NAO's paper reproduced: its simulation, three runs of a robot as real as can be simulated, and what comes after.

The paper's robot showed residuals of 3.1 and 2.5 px and offsets that changed from run to run. The robot here has what
the paper suspects: play that changes sides all at once, springs, a head that is off, and masses that are 10 % off those
that are believed. Both methods get the same images: the paper's (its 21 unknowns, pixels alone) and this project's.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from arm.errors import InputError
from arm.se3 import Array
from calib.chain.fit import Problem, fit_chains
from calib.nao.backlash import fit_compliance_and_backlash
from calib.nao.chain import SIDES, NaoUnknowns
from nao_paper_bench.charts import Cloud, board_figure, residual_figure
from nao_paper_bench.field import FieldErrors, draw_field, field_errors
from nao_paper_bench.kinematics import (
    ON_ITS_BACK,
    STANDING,
    NaoKinematics,
    PoseErrors,
    masses_off,
    pose_errors,
    standing_postures,
)
from nao_paper_bench.robot import Servos
from nao_paper_bench.run import (
    NaoMeasurement,
    RenderedVertices,
    See,
    run_measurement,
)
from nao_paper_bench.stance_design import Plan, Sensing, find_pool, plan_stances, random_stances
from nao_paper_bench.table_2 import (
    NAO_CAMERA,
    PAPER_PIXEL_SIGMA,
    READING_SIGMA,
    VERTICES,
    table_2_robot,
)
from nao_paper_bench.tables import (
    PAPER,
    PaperRun,
    Say,
    joint_rms_deg,
    print_table_1,
    print_table_2,
    run_as_json,
)
from vision.camera.model import Image

RENDERED_SIGMA = np.array([0.03, 0.03])  # px, of vertices found in rendered images, against the truth
ALL = NaoUnknowns(head=True, compliance=True, backlash=True)
_SHOWN = 8  # number of the image that is kept for figure 5


def reproduce(
    out: Path,
    say: Say,
    seed: int = 0,
    rendered: bool = True,
    stances: int = 24,
    pool_size: int = 300,
    runs: int = 3,
) -> dict[str, Any]:
    """Run it all, print the paper's tables through `say`, write its figures to `out`; returns the figures as JSON.

    Args:
        out: folder, made if it is not there.
        say: prints a line.
        seed: of everything that is drawn.
        rendered: whether vertices are found in rendered images; otherwise they are drawn with the paper's noise.
        stances: of each leg; the paper has 24.
        pool_size: of sound stances of each leg that they are chosen from.
        runs: of the robot, two at least; the paper has 3.

    Raises:
        InputError: the folder cannot be written to.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--out {out}: {error.strerror}", out=str(out)) from error
    rng = np.random.default_rng(seed)
    sigma = RENDERED_SIGMA if rendered else PAPER_PIXEL_SIGMA
    began = time.perf_counter()
    pool = find_pool(NAO_CAMERA, pool_size, seed)
    pool_s = time.perf_counter() - began
    sensing = Sensing(NAO_CAMERA, VERTICES, sigma, np.full(8, READING_SIGMA))
    plan = random_stances(pool, stances, sensing, PAPER, rng)
    say(
        f"{stances} stances a leg, 3 postures of the head each; {pool_size} sound stances a leg found in {pool_s:.1f} s"
    )
    say("")
    print_table_1(say)
    simulated, clouds = _simulation(plan, rng, rendered, sigma, say)

    true = table_2_robot(ALL, rng, hard=True, masses=masses_off(0.1, rng))
    guess = np.where([("comp" in n or "back" in n) for n in ALL.names], np.radians(0.5), 0.0)
    better = plan_stances(pool, stances, sensing, ALL, guess)
    eye = RenderedVertices(rng, keep=[_SHOWN])
    papers, ours, first = [], [], None
    for number in range(runs):
        m = run_measurement(
            true, plan, rng, see=(eye if number == 0 else _sight(rng, True)) if rendered else None
        )
        first = first or m
        papers.append(_by_paper(m))
        ours.append(_by_us(m, sigma))
    planned = _by_us(run_measurement(true, better, rng, see=_sight(rng, rendered)), sigma)
    print_table_2(papers, ours, true, say)
    measured = first if first is not None else m
    clouds += [
        Cloud("(c) robot, before", _residuals(measured.problem(PAPER, sigma, 0.0), np.zeros(21))),
        Cloud(
            "(d) robot, the paper's fit", _residuals(measured.problem(PAPER, sigma, 0.0), papers[0].taken.x)
        ),
    ]
    _write(out / "figure_4.png", residual_figure(clouds))
    if rendered:
        _figure_5(out, measured, eye, ours[0])
    nothing = NaoKinematics(PAPER, np.zeros(21))
    after = {
        "not calibrated": nothing,
        "the paper's method": papers[-1].taken,
        "this project's": ours[-1].taken,
        "this project's, planned stances": planned.taken,
    }
    poses = _compensation(true, after, say)
    field = _field(out, true, after, say)
    haste = _haste(plan, rng, say)
    return {
        "simulation": simulated,
        "runs": {"paper": [run_as_json(r) for r in papers], "ours": [run_as_json(r) for r in ours]},
        "poses_mm": poses,
        "field": field,
        "without_settling_joint_rms_deg": haste,
    }


def _sight(rng: np.random.Generator, rendered: bool) -> See | None:
    return RenderedVertices(rng) if rendered else None


def _simulation(
    plan: Plan, rng: np.random.Generator, rendered: bool, sigma: Array, say: Say
) -> tuple[dict[str, float], list[Cloud]]:
    """Section 3.1: exact encoders, offsets and mounts alone."""
    true = table_2_robot(PAPER, rng)
    m = run_measurement(true, plan, rng, Servos(step=0.0), _sight(rng, rendered))
    problem = m.problem(PAPER, sigma, 0.0)
    began = time.perf_counter()
    fit = fit_chains(problem)
    took = time.perf_counter() - began
    after = _residuals(problem, fit.unknowns)
    std = np.nanstd(np.concatenate(list(after.values())), axis=0)
    joints = joint_rms_deg(fit.unknowns, true)
    say("Simulation (section 3.1): exact encoders, offsets and mounts of the mean column of Table 2")
    say(
        f"  residual std {std[0]:.4f} px in x and {std[1]:.4f} px in y (paper: 0.0486, 0.0403; vertices "
        f"{'found in rendered images' if rendered else 'drawn with that noise'}), {fit.iterations} iterations from "
        f"zero (paper's robot: 41), {took:.2f} s; joints {joints:.4f} deg rms off the truth, {m.missed} images missed"
    )
    say("")
    clouds = [
        Cloud("(a) simulation, before", _residuals(problem, np.zeros(21))),
        Cloud("(b) simulation, after", after),
    ]
    figures = {
        "residual_std_x_px": float(std[0]),
        "residual_std_y_px": float(std[1]),
        "iterations": float(fit.iterations),
        "solve_s": took,
        "joint_rms_deg": joints,
    }
    return figures, clouds


def _by_paper(m: NaoMeasurement) -> PaperRun:
    """Eqs. 8 and 9: pixels alone."""
    problem = m.problem(PAPER, np.ones(2), 0.0)
    began = time.perf_counter()
    fit = fit_chains(problem)
    took = time.perf_counter() - began
    return _run(m, problem, NaoKinematics(PAPER, fit.unknowns), fit.iterations, took)


def _by_us(m: NaoMeasurement, sigma: Array) -> PaperRun:
    """Encoders weighed, head offsets, springs and play looked for."""
    problem = m.problem(ALL, sigma, READING_SIGMA)
    began = time.perf_counter()
    found = fit_compliance_and_backlash(problem, ALL, [i.side for i in m.images], ON_ITS_BACK)
    took = time.perf_counter() - began
    taken = NaoKinematics(ALL, found.fit.unknowns, found.hard)
    return _run(m, found.problem, taken, found.iterations, took)


def _run(m: NaoMeasurement, problem: Problem, taken: NaoKinematics, iterations: int, took: float) -> PaperRun:
    r = np.concatenate(list(_residuals(problem, taken.x).values()))
    return PaperRun(taken, iterations, m.duration, took, np.sqrt(np.nanmean(r**2, axis=0)))


def _residuals(problem: Problem, x: Array) -> dict[str, Array]:
    """Measured minus projected, readings taken as they are, (n, 2) px of each leg."""
    found = {}
    for side, s in zip(SIDES, problem.sightings, strict=True):
        r = (s.pixels - s.projection(problem.camera, x).pixels).reshape(-1, 2)
        found[side] = r[np.isfinite(r).all(axis=1)]
    return found


def _compensation(true: NaoKinematics, after: dict[str, NaoKinematics], say: Say) -> dict[str, Any]:
    """Commands with what was identified: where the feet are, and where they are believed to be."""
    say(
        "Compensation: feet of a standing or swinging robot against the torso, 600 postures, commanded in 0.1 deg"
    )
    step, told = np.radians(0.1), {}
    for name, taken in after.items():
        commanded, believed = [], []
        for side, (wanted, _) in standing_postures(600, np.random.default_rng(1)).items():
            ideal = NaoKinematics(PAPER, np.zeros(21))
            sent = np.rint(taken.commands(side, wanted, STANDING) / step) * step
            T_true = true.T_torso_sole(side, sent, STANDING)
            commanded.append((ideal.T_torso_sole(side, wanted, STANDING), T_true))
            believed.append((T_true, taken.T_torso_sole(side, sent, STANDING)))
        met, known = (pose_errors(*map(np.concatenate, zip(*p, strict=True))) for p in (commanded, believed))
        say(f"  {name:<32} met to {_pose(met)}; known to {_pose(known)}")
        told[name] = {"met": 1e3 * met.rms, "known": 1e3 * known.rms}
    say("")
    return told


def _pose(e: PoseErrors) -> str:
    return f"{1e3 * e.rms:6.2f} mm rms (most {1e3 * e.most:.1f}), {np.degrees(e.rotation_rms):.2f} deg"


def _field(out: Path, true: NaoKinematics, after: dict[str, NaoKinematics], say: Say) -> dict[str, Any]:
    say("Field lines projected into the image of the standing robot (gravity downwards), up to 3 m away")
    told = {}
    pictures = []
    for name, taken in after.items():
        e = field_errors(true, taken)
        say(f"  {name:<32} {_lines(e)}")
        told[name] = {"median_px": e.median_px, "median_cm": 100.0 * e.median_m, "p90_cm": 100.0 * e.p90_m}
        pictures.append(draw_field(true, taken, name))
    _write(out / "field_lines.png", np.vstack([np.hstack(pictures[:2]), np.hstack(pictures[2:])]))
    say("")
    return told


def _lines(e: FieldErrors) -> str:
    return (
        f"{e.median_px:7.2f} px (90 %: {e.p90_px:.2f}), on the ground {100 * e.median_m:6.2f} cm "
        f"(90 %: {100 * e.p90_m:.2f})"
    )


def _haste(plan: Plan, rng: np.random.Generator, say: Say) -> dict[str, float]:
    """The same robot measured when it should have arrived, and after it has settled (section 2.2, Measurement)."""
    true, told = table_2_robot(PAPER, rng), {}
    for name, settles in (("settled", True), ("in haste", False)):
        m = run_measurement(true, plan, rng, settles=settles)
        fit = fit_chains(m.problem(PAPER, PAPER_PIXEL_SIGMA, READING_SIGMA))
        told[name] = joint_rms_deg(fit.unknowns, true)
    say(
        f"Images lag behind encoders: joints {told['settled']:.4f} deg rms off the truth if the robot settles before "
        f"it looks, {told['in haste']:.2f} deg if it looks when it should be there"
    )
    return told


def _figure_5(out: Path, m: NaoMeasurement, eye: RenderedVertices, ours: PaperRun) -> None:
    seen = eye.kept.get(_SHOWN)
    if seen is None or np.isnan(seen.vertices).any():
        return
    rows = [(images, k) for images in m.images for k in range(len(images.stances))]
    images, k = min(rows, key=lambda row: _apart(row[0].pixels[row[1]], seen.vertices))
    projected = []
    for nao in (NaoKinematics(PAPER, np.zeros(21)), ours.taken):
        T = nao.T_camera_board(images.side, images.leg[k : k + 1], images.head[k : k + 1], ON_ITS_BACK)[0]
        projected.append(NAO_CAMERA.project(VERTICES @ T[:3, :3].T + T[:3, 3]))
    _write(out / "figure_5.png", board_figure(seen.image, images.pixels[k], *projected))


def _apart(a: Array, b: Array) -> float:
    """Of two sets of vertices in whatever order, px."""
    return float(np.abs(np.sort(a, axis=0) - np.sort(b, axis=0)).max())


def _write(path: Path, picture: Image) -> None:
    if not cv2.imwrite(str(path), picture):
        raise InputError(f"{path}: cannot be written", path=str(path))
