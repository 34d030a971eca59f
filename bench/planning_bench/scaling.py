"""CPU of planning against the number of still bodies and of cubes, without and with a wall between them."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from arm.board import CUBE_SEAT_DEPTH
from arm.robot.shapes import Body, Box
from arm.se3 import frozen, rot_x, rot_z, transform
from cell.scene.bodies import cube_body
from plan.scene import Scene, Station, Transfer
from planning_bench.ours import Ours
from planning_bench.query import Query
from planning_bench.scenes import RELEASE_GAP, cell_file, draw, q_start
from planning_bench.tables import markdown

BODIES = (10, 20, 50, 100, 200, 300)
CUBES = (1, 2, 3, 4, 6, 8, 10, 12)
REPEATS = 3


WALLS = (0.2, 0.4)  # heights, m


def walls_row() -> str:
    """Cubes with a wall between where they are and where they go, against the same without, in the same run."""
    planner = Ours()
    planner.plan(grid(1))
    rows, eight = [], 0.0
    for height in (None, *WALLS):
        found, said = [], []
        for count in CUBES:
            query = grid(count) if height is None else walled(count, height)
            began = time.process_time()
            plan = planner.plan(query)
            found.append((count, time.process_time() - began))
            gap = plan.task["above_that_s"]["unexplored"] / plan.duration_s
            said.append(f"{count}: {plan.duration_s:.1f} s, {100.0 * gap:.1f} %")
        eight = eight or dict(found)[8]
        rows.append(
            [
                "none" if height is None else f"{height:g} m",
                ", ".join(f"{n}: {t:.2f}" for n, t in found),
                f"{exponent(found):.2f}",
                f"{exponent([p for p in found if p[0] >= 4]):.2f}",
                f"{dict(found)[8] / eight:.2f}",
                ", ".join(said),
            ]
        )
    head = [
        "wall",
        "CPU s",
        "exponent",
        "from 4 cubes",
        "8 cubes over those without wall",
        "motion, unexplored",
    ]
    return markdown(head, rows)


def walled(count: int, height: float) -> Query:
    """`grid` with a wall 0.5 m long and 20 mm thick across all ways, from 0.25 m in front of the arm's axis."""
    query = grid(count)
    wall = Body("wall", Box((0.5, 0.02, height)), transform(t=(0.5, 0.0, height / 2.0)), "wall")
    return replace(query, scene=replace(query.scene, bodies=(*query.scene.bodies, wall)))


def scaling_row(seed: int, plot: Path | None) -> str:
    """Both rows, their exponents, and an SVG if asked for."""
    planner = Ours()
    bodies = [(n, _cpu(planner, with_bodies(draw("easy", seed).query(0), n, seed))) for n in BODIES]
    cubes = [(n, _cpu(planner, grid(n))) for n in CUBES]
    rows = []
    for name, found in (("still bodies", bodies), ("cubes", cubes)):
        rows.append([name, ", ".join(f"{n}: {t:.3f}" for n, t in found), f"{exponent(found):.2f}"])
    if plot is not None:
        plot.write_text(svg({"still bodies": bodies, "cubes": cubes}))
    return markdown(["against", "CPU s", "exponent (log-log fit)"], rows)


def with_bodies(query: Query, count: int, seed: int) -> Query:
    """Small boxes far from everything until `count` bodies stand."""
    rng = np.random.default_rng([seed, 15])
    have = list(query.scene.bodies)
    for i in range(len(have), count):
        angle, radius = rng.uniform(0.6 * np.pi, 1.4 * np.pi), rng.uniform(1.3, 1.8)
        at = (radius * np.cos(angle), radius * np.sin(angle), rng.uniform(0.1, 1.2))
        have.append(Body(f"far {i}", Box((0.05, 0.05, 0.05)), transform(t=at), "box"))
    return replace(query, scene=replace(query.scene, bodies=tuple(have)))


def grid(count: int) -> Query:
    """Cubes on the table in an arc on the arm's left, 70 mm apart, to go to the mirrored places on its right."""
    cell = cell_file()
    cubes, transfers, holes = [], [], []
    for n in range(count):
        radius, angle = 0.42 + 0.07 * (n % 3), np.radians(20.0 + 14.0 * (n // 3))
        ends = []
        for side, gap in ((1.0, 0.0), (-1.0, RELEASE_GAP)):
            at = transform(rot_z(side * angle)) @ transform(t=(radius, 0.0, 0.0))
            height = cell.grip_height + CUBE_SEAT_DEPTH + gap
            tools = [
                at @ transform(rot_x(np.pi) @ rot_z(k * np.pi / 2), (0.0, 0.0, height)) for k in range(4)
            ]
            name = f"{'left' if side > 0 else 'right'}/{n + 1}"
            ends.append((Station(name, tuple(map(frozen, tools)), frozenset(("table",))), at))
        standing = ends[0][1] @ transform(t=(0.0, 0.0, cell.cube_size / 2))
        cubes.append(cube_body(f"cube {n + 1}", cell.cube_size, standing))
        transfers.append(Transfer(f"cube {n + 1}", ends[0][0], ends[1][0]))
        holes.append((ends[0][1], ends[1][1]))
    scene = Scene(
        cell.robot(),
        cell.robot_holding(),
        tuple(cell.fixed),
        tuple(cubes),
        frozenset(frozenset((c.name, "table")) for c in cubes),
    )
    name = f"grid {count}"
    return Query(name, scene, tuple(transfers), q_start(cell), cell.unit, cell.limits, tuple(holes), 0)


def _cpu(planner: Ours, query: Query) -> float:
    times = []
    for _ in range(REPEATS):
        began = time.process_time()
        planner.plan(query)
        times.append(time.process_time() - began)
    return float(np.median(times))


def exponent(points: list[tuple[int, float]]) -> float:
    """Slope of a straight line through the logarithms."""
    n, t = np.log(np.array(points, dtype=float)).T
    return float(np.polyfit(n, t, 1)[0])


def svg(series: dict[str, list[tuple[int, float]]]) -> str:
    """Log-log plots side by side."""
    width, height, margin = 320, 260, 46
    parts = []
    for k, (name, points) in enumerate(series.items()):
        n, t = np.log10(np.array(points, dtype=float)).T
        x0 = k * width
        low, high = float(t.min()) - 0.1, float(t.max()) + 0.1
        x = x0 + margin + (n - n.min()) / np.ptp(n) * (width - 2 * margin)
        y = height - margin - (t - low) / (high - low) * (height - 2 * margin)
        line = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
        parts.append(f'<polyline fill="none" stroke="#1f5fa8" stroke-width="1.5" points="{line}"/>')
        for a, b, (count, seconds) in zip(x, y, points, strict=True):
            parts.append(f'<circle cx="{a:.1f}" cy="{b:.1f}" r="3" fill="#1f5fa8"/>')
            parts.append(f'<text x="{a:.1f}" y="{b - 8:.1f}" text-anchor="middle">{seconds:.2f}</text>')
            parts.append(f'<text x="{a:.1f}" y="{height - margin + 16}" text-anchor="middle">{count}</text>')
        title = f"CPU s against {name}, exponent {exponent(points):.2f}"
        parts.append(f'<text x="{x0 + width / 2}" y="18" text-anchor="middle">{title}</text>')
    head = f'<svg xmlns="http://www.w3.org/2000/svg" width="{width * len(series)}" height="{height}"'
    return head + ' font-family="sans-serif" font-size="10">\n' + "\n".join(parts) + "\n</svg>\n"
