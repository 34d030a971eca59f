"""Camera calibration on rendered images: coverage of its errors, and planted faults.

python bench/camera_calibration.py --runs 50 --views 20

A ChArUco board 7 x 5, 30/22 mm, is held 0.85 to 1.25 m from the lab's camera (1920 x 1200, f 4740 px), rotated by up to
0.5 rad about each axis of the image; rendered with 16 rays a pixel at edges, blur 0.7 px, noise 2 grey levels; corners
are detected, not simulated. Every run has its own seed. A parameter is covered if it lies within two of its predicted
standard deviations of the truth.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from arm.errors import CalibrationRefused
from arm.io.storage import data_file
from calib.camera.calibrate import calibrate_camera
from calib.camera.view_selection import TargetPhoto
from calib.model.intrinsics import NAMES, vector_of
from cell.sim.target_photos import Shot, photograph_target, random_poses
from vision.camera.model import read_camera
from vision.targets.target import Target, TargetFinder


@dataclass(frozen=True)
class Fault:
    """A planted fault: how the views are taken, and the word that a reason or remark must have."""

    name: str
    shot: Shot = field(default_factory=Shot)
    tilt: float = 0.5
    blurred: int = 0
    word: str = ""


FAULTS = (
    Fault("bent 0.5 mm", Shot(bend=0.5e-3), word="bent by"),
    Fault("bent 0.25 mm", Shot(bend=0.25e-3), word="bent by"),
    Fault("markers 21 mm, file says 22", Shot(true_marker=0.021), word="its markers measure"),
    Fault("markers 23 mm, file says 22", Shot(true_marker=0.023), word="its markers measure"),
    Fault("three blurred views", blurred=3, word="blurred"),
    Fault("all views face the camera", tilt=0.02, word="faces the camera"),
)


@dataclass(frozen=True)
class Outcome:
    """One run: standard scores (9,), errors in px and mm, and what was said."""

    seed: int
    scores: list[float]
    corner_sigma: float
    true_sigma: float
    held_out_px: float
    predicted_mm: float
    jackknife_mm: float
    actual_mm: float
    accepted: bool
    told: list[str]
    used: int


def run(seed: int, views: int, fault: Fault | None = None) -> Outcome:
    """Render, detect, calibrate."""
    fault = fault or Fault("none")
    camera, target = read_camera(data_file("scenes/cameras/lab.toml")), Target()
    rng = np.random.default_rng(seed)
    finder = TargetFinder(target)
    photos, errors = [], []
    for number, T in enumerate(random_poses(camera, target, rng, views, tilt=fault.tilt)):
        shot = replace(fault.shot, psf_px=2.5) if number < fault.blurred else fault.shot
        image = photograph_target(camera, target, T, rng, shot)
        photos.append(TargetPhoto.of(f"view-{number:02d}", image, finder))
        seen = photos[-1].view
        if seen is not None:
            points = target.points()[seen.ids] @ T[:3, :3].T + T[:3, 3]
            errors.append((seen.corners_px - camera.project(points)).ravel())
        else:
            errors.append(np.empty(0))
    try:
        c = calibrate_camera(photos, target, camera.size)
    except CalibrationRefused as error:
        return Outcome(seed, [], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, False, [str(error)], 0)
    used = np.concatenate([e for e, v in zip(errors, c.views, strict=True) if v.used])
    off = vector_of(c.camera) - vector_of(camera)
    told = [*c.reasons, *c.remarks, *(f"{v.photo.name}: {v.why_not}" for v in c.views if v.why_not)]
    return Outcome(
        seed,
        list(off / c.sigmas),
        c.corner_sigma,
        float(np.sqrt(np.mean(used**2))),
        c.cross.sigma_px,
        _rms_mm(c.work_sigmas),
        _rms_mm(c.cross.work_sigmas),
        _rms_mm(c.work.shifts(off)),
        c.accepted,
        told,
        len(c.used),
    )


def _rms_mm(values: np.ndarray) -> float:
    return 1e3 * float(np.sqrt(np.mean(values**2)))


def report(outcomes: list[Outcome]) -> None:
    """Coverage and errors of sound runs."""
    scores = np.array([o.scores for o in outcomes])
    inside = np.abs(scores) < 2.0
    print(
        f"parameters within 2 of their predicted standard deviations: {100 * inside.mean():.1f} % of {inside.size}"
    )
    for name, part, z in zip(NAMES, inside.mean(axis=0), scores.T, strict=True):
        print(f"    {name}: {100 * part:5.1f} %   rms of the standard score {np.sqrt(np.mean(z**2)):.2f}")
    reported, true = (
        np.array([getattr(o, name) for o in outcomes]) for name in ("corner_sigma", "true_sigma")
    )
    ratio, pooled = reported / true, np.sqrt(np.mean(reported**2) / np.mean(true**2))
    print(
        f"reported corner error over the true one: median {np.median(ratio):.3f}, pooled {pooled:.3f}, "
        f"runs from {ratio.min():.3f} to {ratio.max():.3f} (true median {np.median(true):.4f} px)"
    )
    for name in ("held_out_px", "predicted_mm", "jackknife_mm", "actual_mm"):
        values = [getattr(o, name) for o in outcomes]
        print(f"{name}: median {np.median(values):.4f}, most {max(values):.4f}")
    print(f"accepted {sum(o.accepted for o in outcomes)} of {len(outcomes)}")
    for o in outcomes:
        if not o.accepted or o.told:
            print(f"    seed {o.seed}: {'; '.join(o.told)}")


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--views", type=int, default=20)
    parser.add_argument("--fault-runs", type=int, default=5, help="of each planted fault")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    print(
        f"python {platform.python_version()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, {vars(arguments)}"
    )
    began = time.monotonic()
    seeds = range(arguments.seed, arguments.seed + arguments.runs)
    with ProcessPoolExecutor(arguments.jobs) as pool:
        sound = list(pool.map(partial(run, views=arguments.views), seeds))
        if sound:
            report(sound)
        for fault in FAULTS:
            seeds = range(arguments.seed + 10_000, arguments.seed + 10_000 + arguments.fault_runs)
            outcomes = list(pool.map(partial(run, views=arguments.views, fault=fault), seeds))
            named = [any(fault.word in text for text in o.told) for o in outcomes]
            refused = sum(not o.accepted for o in outcomes)
            print(f"{fault.name}: named in {sum(named)} of {len(named)}, refused {refused}")
            if outcomes:
                print(f"    seed {outcomes[0].seed}: {'; '.join(outcomes[0].told)}")
    print(f"{time.monotonic() - began:.0f} s")
    if arguments.json:
        arguments.json.write_text(json.dumps([o.__dict__ for o in sound], indent=1))


if __name__ == "__main__":
    main()
