"""Is a cube that was moved surely in its hole? Seated cubes that are not confirmed, unseated ones that are.

python bench/placed.py --seated 500 --unseated 200

Each case is two scenes with the same cube. In the first it sits in a hole of one board, and its width is measured
there, as a run does before it takes a cube. In the second it stands in, or not quite in, a hole of another board:
seated, or as one of the simulated cell's faults has it (4 mm high, half seated and leaning by 8 degrees, flat on the
rim, on the plate 25 mm aside), each with up to 0.2 mm of play and 1 degree of turn. A case is told as placed if the
hole looks like one with a cube and the cube's top is surely a seated one's; the rest is not confirmed.

Boards of the lab anywhere in the lab camera's view (1920 x 1200 px, about 1.1 m away), or, in every second case, with a
marker's border up to the image's edge ("edge"), tilted 0, 7 or 15 degrees towards anywhere; cubes of 40 mm to 0.1 mm,
grey level 25 to 235 (the plate has 150, a pocket's floor less). Five photographs, noise of 3 grey levels, lens blur of
0.7 px, exposure 0.8 to 1.1, a lamp 50 to 80 degrees high, its shadow 30 % deep with a soft edge. The board's pose is
measured in the same photographs. Seeds are not those with which limits were chosen.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from arm.bodies import Body, Box
from arm.poses import hole_poses
from arm.se3 import Array, rot_z, transform
from board_scenes import CUBE, lab_camera
from cell.releasefaults import T_hole_released
from hole_scenes import CONDITIONS, measured_pose, photographs, random_scene
from vision.camera import Camera
from vision.occupancy import hole_occupancy
from vision.seated import CubeWidth, Seating, Sight, seating

FIRST_SEED = 700_000
FAULTS = ("high", "half", "rim", "aside")
PHOTOGRAPHS = 5
NOMINAL = CubeWidth(CUBE, 5e-5)


@dataclass(frozen=True)
class Case:
    """One case: how the cube stands, what was said, and where."""

    release: str
    where: str
    hole_looks: str
    found: Seating | None
    grey: float
    seed: int

    @property
    def placed(self) -> bool:
        """Whether a run would say placed."""
        return self.hole_looks == "cube" and self.found is not None and self.found.state == "seated"


def judged(job: tuple[str, int]) -> Case:
    """One case."""
    cv2.setNumThreads(1)
    release, seed = job
    camera = lab_camera()
    rng = np.random.default_rng([seed, 11])
    size, grey = CUBE + rng.uniform(-1e-4, 1e-4), float(rng.uniform(25.0, 235.0))
    where = "edge" if seed % 2 else "view"
    first = _look(rng, camera, seed, "seated", size, grey, where)
    second = _look(rng, camera, seed + 1_000_000, release, size, grey, where)
    if first is None or second is None:
        return Case(release, where, "board refused", None, grey, seed)
    sight, T_base_hole, _ = first
    known = sight.known_width(sight.in_hole(T_base_hole))
    sight, T_base_hole, looks = second
    return Case(release, where, looks, seating(sight.in_hole(T_base_hole), known), grey, seed)


def _look(
    rng: np.random.Generator, camera: Camera, seed: int, release: str, size: float, grey: float, where: str
) -> tuple[Sight, Array, str] | None:
    """Photographs of one cube, the hole as measured in them, and what it looks like."""
    conditions = CONDITIONS["at the image's edge" if where == "edge" else "plain"]
    scene = random_scene(seed, conditions, camera)
    index = int(rng.integers(4))
    play = transform(rot_z(np.radians(rng.uniform(-1.0, 1.0))), (*rng.uniform(-2e-4, 2e-4, 2), 0.0))
    T_hole_cube = play @ T_hole_released(release, size)
    if release in ("seated", "high"):  # wedged where the pocket is as wide
        T_hole_cube = T_hole_cube @ transform(t=(0.0, 0.0, 2.0 * (size - CUBE)))
    T = scene.T_base_board @ scene.board.T_board_hole(index) @ T_hole_cube
    body = Body("cube", Box((size,) * 3), T, "cube")
    things = tuple(t for t in scene.things if t[0].name != f"cube {index}")
    holes = tuple("cube" if i == index else what for i, what in enumerate(scene.holes))
    scene = replace(scene, things=(*things, (body, grey)), holes=holes)
    images = photographs(scene, camera, PHOTOGRAPHS)
    pose = measured_pose(scene, images, camera)
    if pose is None:
        return None
    looks = hole_occupancy(images, camera, pose, index, CUBE).state
    return Sight(images, camera, NOMINAL), hole_poses(pose)[index].T_base_hole, looks


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seated", type=int, default=500)
    parser.add_argument("--unseated", type=int, default=200)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    options = parser.parse_args()
    print(__doc__)
    print(
        f"numpy {np.__version__}, OpenCV {cv2.__version__}, Python {platform.python_version()}; seeds from {FIRST_SEED}"
    )
    jobs = [("seated", FIRST_SEED + i) for i in range(options.seated)]
    jobs += [(FAULTS[i % len(FAULTS)], FIRST_SEED + 10_000 + i) for i in range(options.unseated)]
    with ProcessPoolExecutor(options.jobs) as pool:
        cases = list(pool.map(judged, jobs))
    print("\n| the cube | board | cases | told as placed | not confirmed | board refused |")
    print("|---|---|---|---|---|---|")
    table = Counter((c.release, c.where, c.placed, c.hole_looks == "board refused") for c in cases)
    for release in ("seated", *FAULTS):
        for where in ("view", "edge"):
            placed, not_confirmed, refused = (
                table[release, where, *key] for key in ((True, False), (False, False), (False, True))
            )
            print(
                f"| {release} | {where} | {placed + not_confirmed + refused} | {placed} | {not_confirmed} | {refused} |"
            )
    wrong = [c for c in cases if c.placed and c.release != "seated"]
    missed = [c for c in cases if c.release == "seated" and not c.placed and c.hole_looks != "board refused"]
    lifts = [
        c.found for c in cases if c.release == "seated" and c.found and np.isfinite([c.found.lift]).all()
    ]
    print(
        f"\nunseated told as placed: {len(wrong)} of {options.unseated}; seated not confirmed: {len(missed)} of "
        f"{options.seated}; height of seated ones: rms {1e3 * np.sqrt(np.mean([f.lift**2 for f in lifts])):.2f} mm, "
        f"median told std {1e3 * np.median([f.lift_std for f in lifts]):.2f} mm"
    )
    for band in ((25, 60), (60, 130), (130, 170), (170, 235)):
        of = [c for c in cases if c.release == "seated" and band[0] <= c.grey < band[1]]
        print(
            f"  cubes of grey {band[0]} to {band[1]}: {sum(c in missed for c in of)} of {len(of)} not confirmed"
        )
    for c in [*wrong, *missed]:
        print(
            f"  {c.release}, {c.where}, seed {c.seed}, grey {c.grey:.0f}: hole looks {c.hole_looks}; {c.found}"
        )


if __name__ == "__main__":
    main()
