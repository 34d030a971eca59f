"""Classification of holes in rendered images: right, unsure or wrong, by condition.

python bench/occupancy.py --holes 1000 --mujoco 200

Each scene is a board of the lab anywhere in the lab camera's view (1920 x 1200 px, about 1.1 m away; "at the image's
edge" a black corner of a marker is 3 px to a white border's width from it), tilted 0, 7 or 15 degrees in a random
direction, a cube in about half of its holes: 40 mm to 0.3 mm, grey level 25 to 235 (the plate has 150, the markers 22
and 235), rotated by up to 1 degree and shifted by 0.2 mm. Two images, noise of 3 grey levels, exposure 0.8 to 1.1, a
lamp 50 to 80 degrees high, its shadow 30 % deep with a soft edge, unless a row says otherwise (figures in
tests/support/pictures/holes.py). The board's pose is measured in the same images; where that is refused (overexposed
markers), it is drawn with 0.1 mm across, 0.3 mm along the normal and 2 mrad of error. "across" has one hole a scene
with a cube beside its seat (standing 6 to 36 mm off, any rotation, or leaning in) or a bar over it: it must be unsure.
MuJoCo draws the same kinds of scenes with its own geometry, pockets as bright as the plate, and hard shadows of all of
the lamp's light. Weights and limits were chosen with other seeds.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
import time
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import repeat
from multiprocessing import get_context
from pathlib import Path

import cv2
import mujoco
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from pictures.boards import CUBE, lab_camera
from pictures.holes import ACROSS, CONDITIONS, drawn_pose, measured_pose, photographs, random_scene
from pictures.holes_mujoco import mujoco_photographs, why_no_opengl
from vision.occupancy.classify import hole_occupancy

FIRST_SEED = 300_000
ACROSS_PART = 10  # one scene "across" to as many others


@dataclass(frozen=True)
class Judged:
    """One hole: what is true, what was said, why it was unsure, and where."""

    condition: str
    true: str
    said: str
    reason: str
    measured: bool
    place: str
    ms: float


def judged(job: tuple[str, int], renderer: str) -> list[Judged]:
    """The holes of one scene."""
    cv2.setNumThreads(1)
    condition, seed = job
    camera = lab_camera()
    scene = random_scene(seed, CONDITIONS.get(condition, ACROSS), camera)
    images = (photographs if renderer == "ours" else mujoco_photographs)(scene, camera)
    measured = measured_pose(scene, images, camera)
    pose = measured or drawn_pose(scene)
    found = []
    for index, true in enumerate(scene.holes):
        began = time.process_time()
        said = hole_occupancy(images, camera, pose, index, CUBE)
        ms = 1e3 * (time.process_time() - began)
        place = f"seed {seed} hole {index}"
        found.append(Judged(condition, true, said.state, said.reason, measured is not None, place, ms))
    return found


def jobs(holes: int) -> list[tuple[str, int]]:
    """Scenes of all conditions in turn, and those with something across a hole."""
    names = list(CONDITIONS)
    scenes = [(names[i % len(names)], FIRST_SEED + i) for i in range(holes // 4)]
    return scenes + [("across", FIRST_SEED + holes + i) for i in range(max(holes // 4 // ACROSS_PART * 2, 4))]


def report(found: Iterable[Judged]) -> None:
    """Tables by condition, the totals, and every hole that was not told right."""
    found = list(found)
    print("| condition | cubes | said cube | empty | unsure | empty holes | said empty | cube | unsure |")
    print("|---|---|---|---|---|---|---|---|---|")
    for condition in dict.fromkeys(j.condition for j in found):
        table = Counter((j.true, j.said) for j in found if j.condition == condition)
        cells = [
            str(
                sum(n for (true, _), n in table.items() if true == state)
                if said is None
                else table[state, said]
            )
            for state, order in (
                ("cube", (None, "cube", "empty", "unsure")),
                ("empty", (None, "empty", "cube", "unsure")),
            )
            for said in order
        ]
        print(f"| {condition} | {' | '.join(cells)} |")
    plain = [j for j in found if j.condition != "across"]
    wrong = [j for j in found if j.said not in (j.true, "unsure")]
    unsure = [j for j in plain if j.said == "unsure"]
    other = [j for j in found if j.true == "other"]
    print(
        f"\n{len(plain)} holes: wrong {sum(j in plain for j in wrong)}, unsure {len(unsure)} "
        f"({100.0 * len(unsure) / max(len(plain), 1):.2f} %); something across {len(other)} holes: "
        f"{sum(j.said == 'unsure' for j in other)} unsure; wrong in all {len(wrong)}; "
        f"pose drawn for {sum(not j.measured for j in plain)}; "
        f"{np.median([j.ms for j in found]):.0f} ms CPU a hole (median)"
    )
    for j in [*wrong, *unsure]:
        print(f"  {j.condition}, {j.place}: {j.true}, said {j.said} {j.reason}")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--holes", type=int, default=1000)
    parser.add_argument("--mujoco", type=int, default=200)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    options = parser.parse_args()
    print(__doc__)
    print(
        f"numpy {np.__version__}, OpenCV {cv2.__version__}, MuJoCo {mujoco.__version__}, Python "
        f"{platform.python_version()}, {options.jobs} processes; seeds from {FIRST_SEED}"
    )
    # spawned: OpenGL's threads do not live on in a forked process
    with ProcessPoolExecutor(options.jobs, get_context("spawn")) as pool:
        for renderer, holes in (("ours", options.holes), ("MuJoCo", options.mujoco)):
            if renderer == "MuJoCo" and holes and why_no_opengl():
                print(f"\nMuJoCo cannot render here: {why_no_opengl()}")
                continue
            if holes:
                began = time.monotonic()
                print(f"\n## {renderer}")
                report(j for scene in pool.map(judged, jobs(holes), repeat(renderer)) for j in scene)
                print(f"{time.monotonic() - began:.0f} s", flush=True)


if __name__ == "__main__":
    main()
