"""Draws the pictures of docs/planning.md and docs/certificates.md that show a real motion: planned and proved here.

python docs/pictures/runs.py

The motion is that of examples/03_a_certified_move.py: the A465 goes around a wall, 10 mm asked.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from certificates import BLUE, GREY, INK, RED, dot, line, shape, svg, text

from arm.controller.unit import load_unit
from arm.plan_file import Move
from arm.robot.model import load_a465
from arm.robot.shapes import Body, Box
from arm.se3 import Array, transform
from plan.collision.certificate import check_move
from plan.collision.world import World
from plan.options import PlanOptions
from plan.program.go_to import plan_way
from plan.program.setting import planned_limits
from plan.scene import Scene

HERE = Path(__file__).resolve().parent
ASKED = 0.010  # m
WALL_SIZE, WALL_AT = (0.40, 0.02, 0.50), (0.50, 0.0, 0.25)
Q_FROM, Q_TO = (np.radians([j1, -35, -85, 0, -60, 0]) for j1 in (-35, 35))
COLOURS = ("#2563a8", "#b3261e", "#1a7f37", "#9a6700", "#7b3fb5", "#57606a")
UNIT, ROBOT = load_unit("crs93"), load_a465(0.134112, 0.060)
OPTIONS = PlanOptions(speed=1.0, clearance=ASKED)
BODIES = (
    Body("table", Box((1.2, 1.4, 0.04)), transform(t=(0.3, 0.0, -0.02)), "table"),
    Body("wall", Box(WALL_SIZE), transform(t=WALL_AT), "wall"),
)
WORLD = World(ROBOT, BODIES)


def main() -> None:
    """All three."""
    plan = plan_way(Scene(ROBOT, load_a465(0.134112, 0.040), BODIES, ()), Q_FROM, Q_TO, UNIT, options=OPTIONS)
    if plan is None:
        raise SystemExit("the arm is there already")
    (move,) = plan.moves
    (HERE / "planning-way.svg").write_text(way(move))
    (HERE / "planning-speeds.svg").write_text(speeds(move))
    (HERE / "certificate-bounds.svg").write_text(bounds(move))


def way(move: Move) -> str:
    """From above: the tool on the straight joint motion, which meets the wall, and on the planned one."""

    def drawn(points: Array) -> Array:
        return np.column_stack([230 - 560 * points[:, 1], 310 - 360 * points[:, 0]])

    def tool(q: Array) -> Array:
        return np.array([ROBOT.T_base_tool(one)[:3, 3] for one in q])

    u = np.linspace(0.0, 1.0, 400)[:, None]
    straight = Q_FROM + u * (Q_TO - Q_FROM)
    hits = np.array([WORLD.in_collision(q) for q in straight])
    planned = UNIT.positions(move.path.sample(0.01))
    x, y = np.array(WALL_AT[:2]), np.array(WALL_SIZE[:2]) / 2
    corners = np.array([x + y * s for s in ((1, 1), (1, -1), (-1, -1), (-1, 1))])
    T = tool(planned)
    highest = int(np.argmax(T[:, 2]))
    return svg(
        460,
        330,
        [
            shape(drawn(corners), "#e8eaed", INK),
            line(drawn(tool(straight)), GREY, 2, "5 4"),
            line(drawn(tool(straight[hits])), RED, 3.5),
            line(drawn(T), BLUE, 2.5),
            dot(drawn(np.zeros((1, 3)))[0], INK),
            *(dot(drawn(T[[i]])[0], BLUE) for i in (0, -1)),
            text(drawn(np.zeros((1, 3)))[0] + (10, 5), "axis of J1"),
            text(drawn(T[[0]])[0] + (-30, 26), f"from, {100 * T[0, 2]:.0f} cm up", BLUE),
            text(drawn(T[[-1]])[0] + (-60, 26), f"to, {100 * T[-1, 2]:.0f} cm up", BLUE),
            text(drawn(T[[highest]])[0] + (24, -10), f"planned, here {100 * T[highest, 2]:.0f} cm up", BLUE),
            text(np.array([20.0, 44.0]), "dashed: straight in joint space; red: something touches", RED),
            text(np.array([20.0, 24.0]), "from above; in the middle a wall, 50 cm high", INK),
        ],
    )


def speeds(move: Move) -> str:
    """Speed and acceleration of every joint over its limit."""
    limits = planned_limits(UNIT.limits(), OPTIONS, UNIT)
    t, share = [], []
    for segment, begin in zip(move.path.segments, starts(move), strict=True):
        u = np.linspace(0.0, 1.0, 4)
        seconds = segment.duration_ms / 1e3
        t.append(begin + u * seconds)
        share.append(
            [
                np.array([segment.derivative(float(v), order) for v in u]) / UNIT.counts_per_rad
                for order in (1, 2)
            ]
        )
    end, times = move.path.duration_s, np.concatenate(t)
    parts = []
    for top, title, which, limit in (
        (30.0, "speed over its limit", 0, limits.velocity),
        (200.0, "acceleration over its limit", 1, limits.acceleration),
    ):
        parts += axes(top, f"{title}; time in s", end, ("-1", "0", "1"))
        values = np.concatenate([s[which] for s in share]) / limit
        for joint, colour in enumerate(COLOURS):
            parts.append(line(graph(times, (values[:, joint] + 1) / 2, end, top), colour, 1.5))
    parts += [text(np.array([418.0, 60.0 + 18 * k]), f"J{k + 1}", c) for k, c in enumerate(COLOURS)]
    return svg(460, 370, parts)


def bounds(move: Move) -> str:
    """Distances that were computed densely, and what is proved of each segment."""
    check = check_move(WORLD, move.path, UNIT, ASKED, tight=True)
    end, most = move.path.duration_s, 0.06
    t = np.linspace(0.0, end, 1500)
    true = np.array([WORLD.distance(q).value for q in UNIT.positions(move.path.at(t))])
    stairs_t = np.repeat([*starts(move), end], 2)[1:-1]
    stairs = np.repeat(np.array(check.bounds), 2)
    return svg(
        460,
        200,
        [
            *axes(30.0, "smallest distance in mm; time in s", end, ("0", "30", "60")),
            line(graph(stairs_t, np.clip(stairs / most, 0, 1), end, 30.0), RED, 2),
            line(graph(t, np.clip(true / most, 0, 1), end, 30.0), BLUE, 2),
            line(graph(np.array([0.0, end]), np.full(2, ASKED / most), end, 30.0), INK, 1, "6 4"),
            text(np.array([50.0, 154.0]), f"asked: {1e3 * ASKED:.0f} mm"),
            text(np.array([290.0, 58.0]), "computed every 4 ms", BLUE),
            text(np.array([270.0, 108.0]), "proved of each segment", RED),
        ],
    )


LEFT, WIDTH, HEIGHT = 46.0, 360.0, 130.0  # of a graph, px


def graph(t: Array, share: Array, end: float, top: float) -> Array:
    """Pixels of values from 0 (bottom) to 1 (top)."""
    return np.column_stack([LEFT + WIDTH * t / end, top + HEIGHT * (1.0 - share)])


def axes(top: float, title: str, end: float, marks: Sequence[str]) -> list[str]:
    """A frame, with marks at even heights and at whole seconds."""
    box = np.array([[0, 0], [WIDTH, 0], [WIDTH, HEIGHT], [0, HEIGHT]]) + (LEFT, top)
    parts = [shape(box, "none", GREY), text(np.array([LEFT, top - 6]), title)]
    for k, mark in enumerate(marks):
        y = top + HEIGHT * (1 - k / (len(marks) - 1))
        parts += [line([(LEFT, y), (LEFT + WIDTH, y)], "#d0d7de", 1), text(np.array([14.0, y + 4]), mark)]
    for second in range(int(end) + 1):
        x = LEFT + WIDTH * second / end
        parts += [
            line([(x, top + HEIGHT), (x, top + HEIGHT + 4)], GREY, 1),
            text(np.array([x - 4, top + HEIGHT + 18]), str(second)),
        ]
    return parts


def starts(move: Move) -> Array:
    """Of the segments, s."""
    return np.concatenate([[0.0], np.cumsum([s.duration_ms / 1e3 for s in move.path.segments])[:-1]])


if __name__ == "__main__":
    main()
