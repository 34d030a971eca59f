"""Expected values of scene files, from MuJoCo alone.

python tests/support/arms/expected_distances.py scenes/fixtures/*.toml

Of the project only the reader of the files is used: kinematics, the place of the tool, pairs and distances are
MuJoCo's. The values replace those in the files (rounded to 0.1 um); all else in them stays.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from arm.io.storage import data_file
from arms.mujoco_cell import MujocoCell
from cell.files.scene import Pair, SceneFile, read_scene_file

SAMPLES = 801  # of a motion, before its least distance is narrowed down
FINGER_LENGTH = 0.0254  # m
EXPECTED_KEYS = ("verdict", "pair", "distance_mm", "clearance_mm")


class MujocoScene:
    """A scene file in MuJoCo."""

    def __init__(self, scene: SceneFile) -> None:
        self.scene = scene
        held = [(scene.held.name, scene.held.shape)] if scene.held else []
        self.cell = MujocoCell(
            data_file("urdf/a465/a465.urdf"), scene.bodies, held, scene.robot.disabled_collisions
        )
        self.pairs = self.cell.pairs(scene.held.name if scene.held else None)

    def place(self, q: np.ndarray) -> None:
        """Put the arm, and what it holds, at q (6,) rad."""
        self.cell.place(q, self.scene.jaw_opening, {})
        if self.scene.held is not None:
            T = self.T_base_tool() @ self.scene.T_tool_held
            self.cell.place(q, self.scene.jaw_opening, {self.scene.held.name: T})

    def T_base_tool(self) -> np.ndarray:
        """Between the finger tips, turned as they are; 4x4."""
        data = self.cell.data
        left, right = (data.geom(name) for name in ("finger_l", "finger_r"))
        T = np.eye(4)
        T[:3, :3] = left.xmat.reshape(3, 3)
        T[:3, 3] = (left.xpos + right.xpos) / 2 + T[:3, 2] * FINGER_LENGTH / 2
        return T

    def closest(self, q: np.ndarray, allowed: Iterable[Pair]) -> tuple[float, tuple[str, str]]:
        """Distance m, less the padding, and names of the closest pair at q that may not touch."""
        self.place(q)
        touching = self.scene.allowed | frozenset(allowed)
        values = [(self.cell.distance(*p), p) for p in self.pairs if frozenset(p) not in touching]
        distance, pair = min(values)
        return distance - self.scene.padding, pair

    def least(
        self, ends: np.ndarray, allowed: Iterable[Pair], samples: int = SAMPLES
    ) -> tuple[float, tuple[str, str]]:
        """The same over a straight joint motion: samples, and golden section about the lowest five."""
        allowed = frozenset(allowed)

        def at(s: float) -> float:
            return self.closest(ends[0] + s * (ends[1] - ends[0]), allowed)[0]

        grid = np.linspace(0.0, 1.0, samples)
        values = np.array([at(s) for s in grid])
        inner = np.flatnonzero((values[1:-1] <= values[:-2]) & (values[1:-1] <= values[2:])) + 1
        best = min((float(values[i]), float(grid[i])) for i in (0, samples - 1))
        for i in sorted(inner, key=lambda i: values[i])[:5]:
            best = min(best, _golden(at, grid[i - 1], grid[i + 1]))
        _, pair = self.closest(ends[0] + best[1] * (ends[1] - ends[0]), allowed)
        return best[0], pair


def _golden(function: Callable[[float], float], low: float, high: float) -> tuple[float, float]:
    """Least value and where, to 1e-9 of the motion."""
    ratio = (np.sqrt(5.0) - 1.0) / 2.0
    a, b = high - ratio * (high - low), low + ratio * (high - low)
    at_a, at_b = function(a), function(b)
    while high - low > 1e-9:
        if at_a < at_b:
            high, b, at_b = b, a, at_a
            a = high - ratio * (high - low)
            at_a = function(a)
        else:
            low, a, at_a = a, b, at_b
            b = low + ratio * (high - low)
            at_b = function(b)
    return min((float(at_a), float(a)), (float(at_b), float(b)))


def expected_lines(scene: SceneFile) -> dict[str, list[list[str]]]:
    """Lines to end each table of queries and motions with."""
    judge = MujocoScene(scene)
    lines: dict[str, list[list[str]]] = {"[[queries]]": [], "[[motions]]": []}
    for query in scene.queries:
        distance, pair = judge.closest(query.q[0], query.allowed)
        verdict = "free" if distance > 0.0 else "collides"
        lines["[[queries]]"].append(_lines(verdict, "distance_mm", distance, pair))
    for motion in scene.motions:
        distance, pair = judge.least(motion.q, motion.allowed)
        verdict = "clear" if distance >= motion.asked else "too close"
        lines["[[motions]]"].append(_lines(verdict, "clearance_mm", distance, pair))
    return lines


def _lines(verdict: str, key: str, distance: float, pair: tuple[str, str]) -> list[str]:
    names = ", ".join(f'"{name}"' for name in sorted(pair))
    return [f'verdict = "{verdict}"', f"{key} = {1e3 * distance:.4f}", f"pair = [{names}]"]


def rewrite(path: Path) -> None:
    """Put the values of now into a scene file."""
    values = expected_lines(read_scene_file(path))
    blocks: list[list[str]] = [[]]
    for line in path.read_text().splitlines():
        if line.startswith("["):
            blocks.append([])
        if not line.startswith(tuple(f"{key} =" for key in EXPECTED_KEYS)):
            blocks[-1].append(line)
    for block in blocks[1:]:
        if block[0] in values:
            while not block[-1]:
                block.pop()
            block += [*values[block[0]].pop(0), ""]
    path.write_text("\n".join(line for block in blocks for line in block).rstrip() + "\n")


if __name__ == "__main__":
    for name in sys.argv[1:]:
        rewrite(Path(name))
        print(name)
