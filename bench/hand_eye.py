"""Eye-to-hand calibration of the A465: errors against bounds and peers, poses needed, wrong images, verdicts.

python bench/hand_eye.py --seeds 20 --jobs 2 [--only WORD]

Recordings are simulated (tests/support/recorded/arm_sets.py), not rendered: the lab's camera 1.2 m above the table,
corners with 0.3 px of noise per coordinate, joint offsets (zeros) of J2 to J5 within 0.3 deg, place and mount varied by
some mm and degrees per seed; a marker of 60 mm or a ChArUco board of 24 corners, 12 mm apart, both held 0.1 m from the
flange. Rows give medians over seeds. "Camera" is the error of T_base_camera, "bound" the Cramer-Rao bound of the same
postures (root mean squares of both are compared), "held out" the rms error of 60 targets predicted in postures that
were not recorded, NEES the normalised squared error per unknown (1: consistent covariance).
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

import numpy as np
from hand_eye_bench.cases import Case, Outcome, run
from hand_eye_bench.judge import Off

from recorded.faults import FAULTS

ENOUGH = Off(0.2, 0.02)  # of T_base_camera


@dataclass(frozen=True)
class Campaign:
    """Seeds and processes."""

    seeds: int
    pool: ProcessPoolExecutor

    def __call__(self, case: Case) -> list[Outcome]:
        return list(self.pool.map(run, [case] * self.seeds, range(self.seeds)))


def _median(values: Sequence[float]) -> float:
    return float(np.median(values))


def _rms_ratio(outcomes: Sequence[Outcome], of: str) -> float:
    errors, least = (
        np.array([getattr(o, which).__dict__[of] for o in outcomes]) for which in ("camera", "least")
    )
    return float(np.sqrt((errors**2).mean() / (least**2).mean()))


def _line(name: str, outcomes: Sequence[Outcome]) -> str:
    good = [o for o in outcomes if np.isfinite(o.camera.mm)]
    mm, deg, held = (
        _median(v) for v in zip(*((o.camera.mm, o.camera.deg, o.held_out.mm) for o in good), strict=True)
    )
    return (
        f"{name:46} {mm:8.4f} {deg:9.5f} {_rms_ratio(good, 'mm'):6.2f} {_rms_ratio(good, 'deg'):5.2f} {held:9.4f} "
        f"{np.mean([o.nees for o in good]):6.2f} {sum(o.links for o in good):5d} {sum(o.accepted for o in outcomes):5d}"
        f"/{len(outcomes)} {_median([o.cpu_s for o in good]):6.2f}"
    )


HEAD = (
    f"{'':46} {'camera mm':>8} {'deg':>9} {'/bound':>6} {'':5} {'held out':>9} {'NEES':>6} {'links':>5} "
    "accepted  cpu s"
)


def accuracy(campaign: Campaign) -> None:
    """What 270 and fewer poses reach; SHAH and LI beside it."""
    print("\nAccuracy\n" + HEAD)
    for case in (
        Case(peers=True),
        Case(links=True, peers=True),
        Case(links=True, poses=40),
        Case(target="marker"),
    ):
        outcomes = campaign(case)
        name = f"{case.poses} poses, {case.target}{', links off too' if case.links else ''}"
        print(_line(name, outcomes), flush=True)
        for peer in outcomes[0].peers:
            camera, held = zip(*(o.peers[peer] for o in outcomes), strict=True)
            print(
                f"  {peer:44} {_median([o.mm for o in camera]):8.4f} {_median([o.deg for o in camera]):9.5f} {'':12} "
                f"{_median([o.mm for o in held]):9.4f}",
                flush=True,
            )


def how_many(campaign: Campaign) -> None:
    """Poses until T_base_camera is known to 0.2 mm and 0.02 deg."""
    print(f"\nPoses until the medians are {ENOUGH.mm} mm and {ENOUGH.deg} deg\n" + HEAD)
    for target in ("charuco", "marker"):
        for sampler in ("planned", "wide"):
            counts = (8, 12) if sampler == "planned" else (8, 10, 12, 14, 16, 20, 24, 30)
            for poses in counts:
                outcomes = campaign(Case(poses=poses, target=target, sampler=sampler))
                print(_line(f"{poses} poses, {target}, {sampler}", outcomes), flush=True)
                mm, deg = (_median([getattr(o.camera, of) for o in outcomes]) for of in ("mm", "deg"))
                if mm <= ENOUGH.mm and deg <= ENOUGH.deg:
                    break


def wrong_images(campaign: Campaign) -> None:
    """Wrong detections: error over that of the same recordings with none."""
    print(
        "\nWrong images, 60 poses: rms error over that of the same recordings without them (0.8 and 0.7 of the"
    )
    print("images tell 1.12 and 1.20 times less)")
    print(f"{'':46} {'mm':>6} {'deg':>6} {'right ones lost':>16} {'wrong ones kept':>16}")
    for target in ("marker", "charuco"):
        clean = campaign(Case(poses=60, target=target))
        for way in ("shifted", "other", "turned"):
            for part in (0.2, 0.3):
                outcomes = campaign(Case(poses=60, target=target, wrong=part, way=way))
                mm, deg = (
                    np.sqrt(
                        np.mean([getattr(o.camera, of) ** 2 for o in outcomes])
                        / np.mean([getattr(o.camera, of) ** 2 for o in clean])
                    )
                    for of in ("mm", "deg")
                )
                print(
                    f"{f'{target}, {100 * part:.0f} % {way}':46} {mm:6.2f} {deg:6.2f} "
                    f"{sum(o.lost for o in outcomes):16d} {sum(o.missed for o in outcomes):16d}",
                    flush=True,
                )


def mounts(campaign: Campaign) -> None:
    """The course report's fourth lesson (docs/sources.md, "The course report")."""
    print("\nMount x target x sampler, 60 poses\n" + HEAD)
    for target in ("marker", "charuco"):
        for mount in ("parallel", "perpendicular"):
            for sampler in ("recipe", "wide", "planned"):
                outcomes = campaign(Case(60, target, mount, sampler))
                print(_line(f"{target}, {mount}, {sampler}", outcomes), flush=True)


def verdicts(campaign: Campaign) -> None:
    """Planted faults: refused, named, and what error is left where they were accepted."""
    print(
        "\nVerdicts, 40 poses: complete recordings accepted; planted faults refused or named by the right cause"
    )
    print(f"{'':54} {'refused':>8} {'rightly named':>14} {'neither':>8} {'held out mm':>12}   named")
    for target in ("charuco", "marker"):
        for links in (False, True):
            outcomes = campaign(Case(40, target, links=links))
            median = _median([o.held_out.mm for o in outcomes])
            name = f"{target}, complete{', links off' if links else ''}"
            print(
                f"{name:54} {sum(not o.accepted for o in outcomes):8d} {'':14} {'':8} {median:12.3f}",
                flush=True,
            )
        for fault, (_, cause) in FAULTS.items():
            outcomes = campaign(Case(40, target, fault=fault))
            right = [o.named == cause for o in outcomes]
            neither = sum(o.accepted and not r for o, r in zip(outcomes, right, strict=True))
            accepted = [o.held_out.mm for o in outcomes if o.accepted]
            left = f"{max(accepted):12.3f}" if accepted else f"{'':12}"
            print(
                f"{f'{target}, {fault}':54} {sum(not o.accepted for o in outcomes):8d} {sum(right):14d} {neither:8d} "
                f"{left}   {dict(Counter(o.named for o in outcomes))}",
                flush=True,
            )


PARTS: dict[str, Callable[[Campaign], None]] = {
    "accuracy": accuracy,
    "poses": how_many,
    "wrong": wrong_images,
    "mounts": mounts,
    "verdicts": verdicts,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--only", choices=tuple(PARTS), nargs="*", default=tuple(PARTS))
    arguments = parser.parse_args()
    print((__doc__ or "").partition("[--only WORD]\n\n")[2].strip())
    print(
        f"{arguments.seeds} seeds, {arguments.jobs} processes, Python {platform.python_version()}, "
        f"numpy {np.__version__}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}"
    )
    began = time.monotonic()
    with ProcessPoolExecutor(arguments.jobs) as pool:
        for name in arguments.only:
            PARTS[name](Campaign(arguments.seeds, pool))
    print(f"\n{time.monotonic() - began:.0f} s")


if __name__ == "__main__":
    main()
