"""Robot-world calibration from pose streams on kinhec 1.1.0: our estimator, kinhec's solvers and OpenCV's in one run.

python bench/pose_pairs.py --seed 20261121 --workers 2

Needs the extra `bench`. The tier of kinhec_bench/tier.yaml (160 sequences, synthetic, no images) is generated here in a
few minutes and kept in --folder; another --seed generates it again. All solvers get the keyframes of kinhec's protocol.
X is what the gripper holds, Y is fixed; errors are kinhec's: mm and deg. "known" is a least-squares fit given the size
of every error, the wrong pairs and the arm's true geometry: what such data allow, not a solver.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from kinhec import __version__ as kinhec_version
from kinhec.benchmark import SOLVERS, evaluate_sequence
from kinhec.metrics import calibration_errors
from kinhec_bench.known import known_noise
from kinhec_bench.opencv import HAND_EYE, ROBOT_WORLD, opencv
from kinhec_bench.sequences import Sample, generated, samples
from scipy.spatial.transform import Rotation

from arm.errors import CalibrationRefused
from arm.se3 import Array, inverse
from calib.robot_world.solve import RobotWorld, calibrate_pose_pairs

OURS = "a465"
DEGENERATE = ("cone 2 deg", "cone 10 deg", "parallel joints")
ASKED_MM = {
    "pnp": 0.15,
    "noise": 0.82,
    "robot_error": 0.79,
    "outliers 5 %": 0.55,
    "outliers 20 %": 0.80,
    "outliers 50 %": 1.2,
}


@dataclass(frozen=True)
class Result:
    """One solver on one sequence; errors are NaN where it gave nothing."""

    group: str
    sequence: str
    solver: str
    X_mm: float
    X_deg: float
    Y_mm: float
    ms: float
    said: str = ""
    nees: float = float("nan")
    wrong_kept: int = 0
    right_lost: int = 0


def solved(sample: Sample) -> list[Result]:
    """All solvers on one sequence."""
    rows = evaluate_sequence(sample.sequence, list(SOLVERS), rng=np.random.default_rng(0))
    results = [
        Result(
            sample.group,
            sample.sequence.id,
            f"kinhec {row['solver']}",
            row["X_trans_err_mm"] if row["ok"] else float("nan"),
            row["X_rot_err_deg"] if row["ok"] else float("nan"),
            row.get("Y_trans_err_mm", float("nan")) if row["ok"] else float("nan"),
            row["runtime_ms"],
        )
        for row in rows
    ]
    for name in (*ROBOT_WORLD, *HAND_EYE):
        begun = time.perf_counter()
        found = opencv(name, sample.A, sample.B)
        ms = 1e3 * (time.perf_counter() - begun)
        X, Y = found or (None, None)
        results.append(_result(sample, name, X, Y, ms))
    if sample.group not in DEGENERATE:
        results.append(_result(sample, "known", *known_noise(sample), float("nan")))
    results.append(_ours(sample))
    return results


def _result(sample: Sample, solver: str, X: Array | None, Y: Array | None, ms: float) -> Result:
    nan = float("nan")
    s = sample.sequence
    if X is None:
        return Result(sample.group, s.id, solver, nan, nan, nan, ms)
    e = calibration_errors(X, s.X, Y, s.Y)
    return Result(
        sample.group, s.id, solver, e["X_trans_err_mm"], e["X_rot_err_deg"], e.get("Y_trans_err_mm", nan), ms
    )


def _ours(sample: Sample) -> Result:
    begun = time.perf_counter()
    try:
        found = calibrate_pose_pairs(sample.pairs)
    except CalibrationRefused as refused:
        ms = 1e3 * (time.perf_counter() - begun)
        nan = float("nan")
        return Result(
            sample.group, sample.sequence.id, OURS, nan, nan, nan, ms, f"refused: {refused.data['reason']}"
        )
    ms = 1e3 * (time.perf_counter() - begun)
    plain = _result(sample, OURS, found.T_held, found.T_standing, ms)
    said = found.scatter.shape + (", geometry" if found.scatter.geometry else "")
    said += ", strays" if found.scatter.freedom else ""
    return Result(
        **{
            **asdict(plain),
            "said": said,
            "nees": _nees(sample, found),
            "wrong_kept": int((found.inliers & sample.wrong).sum()),
            "right_lost": int((~found.inliers & ~sample.wrong).sum()),
        }
    )


def _nees(sample: Sample, found: RobotWorld) -> float:
    """Squared error of X and Y over the covariance, per degree of freedom: 1 on the average if it is honest."""
    s = sample.sequence
    off = [inverse(found.T_held) @ s.X, inverse(found.T_standing) @ s.Y]
    e = np.concatenate([np.r_[E[:3, 3], Rotation.from_matrix(E[:3, :3]).as_rotvec()] for E in off])
    return float(e @ np.linalg.solve(found.covariance, e)) / len(e)


def _share(data: Path, tracks: list[str] | None, workers: int, number: int) -> list[Result]:
    chosen = (s for i, s in enumerate(samples(data, tracks)) if i % workers == number)
    return [result for sample in chosen for result in solved(sample)]


def _median(values: Iterable[float]) -> float:
    finite = [v for v in values if np.isfinite(v)]
    return float(np.median(finite)) if finite else float("nan")


def table(results: list[Result]) -> dict[str, dict[str, dict[str, float]]]:
    """Medians by group and solver."""
    groups: dict[str, dict[str, list[Result]]] = {}
    for r in results:
        groups.setdefault(r.group, {}).setdefault(r.solver, []).append(r)
    return {
        group: {
            solver: {
                "n": len(rows),
                "gave": sum(bool(np.isfinite(r.X_mm)) for r in rows),
                "X_mm": _median(r.X_mm for r in rows),
                "X_deg": _median(r.X_deg for r in rows),
                "p90_mm": float(np.percentile([r.X_mm for r in rows if np.isfinite(r.X_mm)] or [np.nan], 90)),
                "Y_mm": _median(r.Y_mm for r in rows),
                "ms": _median(r.ms for r in rows),
            }
            for solver, rows in solvers.items()
        }
        for group, solvers in groups.items()
    }


def asked(results: list[Result]) -> list[dict[str, object]]:
    """The figures that were asked for, and whether they are reached."""
    medians = table(results)
    lines: list[dict[str, object]] = []
    for group, limit in ASKED_MM.items():
        if group not in medians:
            continue
        best = {k: v["X_mm"] for k, v in medians[group].items() if k not in (OURS, "known")}
        first = min(best, key=lambda k: best[k] if np.isfinite(best[k]) else np.inf)
        here = medians[group][OURS]["X_mm"]
        lines.append(
            {
                "figure": f"{group}: X shift, median mm (n = {medians[group][OURS]['n']})",
                "asked": f"<= {limit:g}",
                "here": round(here, 3),
                "best_baseline": f"{first} {best[first]:.3f}",
                "known": round(medians[group]["known"]["X_mm"], 3),
                "reached": bool(here <= limit),
            }
        )
    ours = [r for r in results if r.solver == OURS]
    for name, rows, share in (
        ("degenerate motions refused", [r for r in ours if r.group in DEGENERATE], 1.0),
        ("all others refused", [r for r in ours if r.group not in DEGENERATE], 0.0),
    ):
        refused = sum(r.said.startswith("refused") for r in rows)
        lines.append(
            {
                "figure": name,
                "asked": f"{100 * share:.0f} %",
                "here": f"{refused} of {len(rows)}",
                "best_baseline": "none refuses",
                "known": "",
                "reached": refused == round(share * len(rows)),
            }
        )
    return lines


def show(results: list[Result]) -> None:
    """Tables for a person."""
    for group, solvers in table(results).items():
        print(f"\n{group}, n = {solvers[OURS]['n']}")
        print(f"  {'':28}{'X mm':>9}{'p90':>9}{'X deg':>9}{'Y mm':>9}{'ms':>8}  gave")
        order = sorted(
            solvers, key=lambda k: (k != OURS, k != "known", np.nan_to_num(solvers[k]["X_mm"], nan=1e9))
        )
        for name in order:
            v = solvers[name]
            numbers = f"{v['X_mm']:9.3f}{v['p90_mm']:9.2f}{v['X_deg']:9.4f}{v['Y_mm']:9.3f}{v['ms']:8.1f}"
            print(f"  {name:28}{numbers.replace('nan', '  -')}  {v['gave']}/{v['n']}")
        ours = [r for r in results if r.solver == OURS and r.group == group]
        said = ", ".join(f"{word} {count}" for word, count in Counter(r.said for r in ours).most_common())
        nees = [r.nees for r in ours if np.isfinite(r.nees)]
        kept, lost = sum(r.wrong_kept for r in ours), sum(r.right_lost for r in ours)
        honesty = f"; NEES/dof mean {np.mean(nees):.2f}, median {np.median(nees):.2f}" if nees else ""
        print(f"  {OURS}: {said}{honesty}; wrong pairs kept {kept}, right ones lost {lost}")
    print(f"\n{'figure':52}{'asked':>9}{'here':>12}{'known':>9}  reached  best baseline of this run")
    for line in asked(results):
        word = "yes" if line["reached"] else "NO"
        print(
            f"{line['figure']!s:52}{line['asked']!s:>9}{line['here']!s:>12}{line['known']!s:>9}  {word:7}  "
            f"{line['best_baseline']}"
        )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=20261121, help="of the tier")
    parser.add_argument("--tracks", nargs="*", help="default: all")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir()) / "a465-kinhec")
    parser.add_argument("--json", type=Path, help="write all results here")
    options = parser.parse_args()
    print(
        f"kinhec {kinhec_version}, OpenCV {cv2.__version__}, Python {platform.python_version()}, tier seed "
        f"{options.seed}, synthetic pose streams, medians over sequences",
        flush=True,
    )
    data = generated(options.seed, options.folder, options.workers)
    begun = time.perf_counter()
    task = partial(_share, data, options.tracks, options.workers)
    if options.workers > 1:
        with ProcessPoolExecutor(options.workers) as pool:
            results = [r for part in pool.map(task, range(options.workers)) for r in part]
    else:
        results = task(0)
    show(results)
    print(f"\n{time.perf_counter() - begun:.0f} s on {options.workers} processes", file=sys.stderr)
    if options.json:
        document = {
            "seed": options.seed,
            "asked": asked(results),
            "table": table(results),
            "results": [asdict(r) for r in results],
        }
        options.json.write_text(json.dumps(document, indent=1))


if __name__ == "__main__":
    main()
