"""Seeded scenes: the course report's layout of two boards side by side in view, with or without something in between.

A scene is kept by necessary conditions only: bodies apart, holes with a line in limits and clear of what stands. No
planner is asked whether a scene can be solved.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import coal
import numpy as np

from arm.board import CUBE_SEAT_DEPTH, PLATE_SIZE, POCKET_MOUTH, Board, plate_name
from arm.numerics.products import mul
from arm.robot.shapes import Body, Box
from arm.se3 import Array, apply, frozen, inverse, rot_x, rot_z, transform
from cell.config.cell import Cell
from cell.config.cell_file import read_cell
from cell.files.world import board_placement
from cell.scene.bodies import T_hole_cube, cube_body, plate_body, stand_body
from plan.collision.world import World
from plan.scene import Scene, Station, Transfer
from planning_bench.grips import GripLine, by_distance, grip_lines, line_poses
from planning_bench.placed import Placed, gap_between
from planning_bench.query import CLEARANCE, Q_START, Query, box_size

CELL = Path(__file__).resolve().parents[2] / "scenes" / "cell.toml"
TILTS_DEG = (0.0, 7.0, 15.0)
HIGHEST = 0.15  # plate tops, m
GAPS = {"easy": 0.010, "hard": 0.060}  # between plates seen from above, m
MARGIN_PX = 6.0
RELEASE_GAP = 1e-3  # a cube is let go this far above where it will sit, m
WALLS_A_LAYOUT = 30
_STEP = 0.02  # rad between samples of a straight move that must be blocked
_CUBE_TOP = CUBE_SEAT_DEPTH * -1.0 + 0.04


@dataclass(frozen=True)
class BenchScene:
    """One drawn scene with its four queries.

    Attributes:
        name: kind and seed.
        seed: of the draw.
        a, b: boards that cubes come from and go to.
        obstacles: what was added.
        rejected: draws thrown away before this one, by reason.
    """

    name: str
    seed: int
    a: Placed
    b: Placed
    obstacles: tuple[Body, ...]
    rejected: dict[str, int]

    def query(self, index: int) -> Query:
        """Cube `index` from its hole on A to the same hole on B; the ones before it stand on B already."""
        return self._query(f"{self.name}/{index + 1}", (index,), index)

    def whole(self) -> Query:
        """All four cubes."""
        return self._query(f"{self.name}/whole", (0, 1, 2, 3), 0)

    def _query(self, name: str, indices: Sequence[int], placed: int) -> Query:
        cell = cell_file()
        return Query(
            name=name,
            scene=scene_of(cell, self.a, self.b, self.obstacles, placed),
            transfers=tuple(transfer_of(cell, self.a, self.b, i) for i in indices),
            q_start=q_start(cell),
            unit=cell.unit,
            limits=cell.limits,
            holes=tuple((self.a.T_base_hole(i), self.b.T_base_hole(i)) for i in indices),
            seed=self.seed,
        )


@cache
def cell_file() -> Cell:
    """The cell that all scenes stand in: its arm (not padded: no peer can be asked to), table, camera and post."""
    return replace(read_cell(CELL), arm_padding=0.0)


def q_start(cell: Cell) -> Array:
    """The start as a whole number of counts."""
    return frozen(cell.unit.positions(cell.unit.counts(Q_START)))


def station(cell: Cell, placed: Placed, index: int, gap: float = 0.0) -> Station:
    """The four grips of a hole."""
    grips = (
        transform(mul(rot_x(np.pi), rot_z(k * np.pi / 2)), (0.0, 0.0, cell.grip_height + gap))
        for k in range(4)
    )
    T = placed.T_base_hole(index)
    name = f"{placed.board.name}/{index + 1}"
    return Station(name, tuple(frozen(mul(T, g)) for g in grips), frozenset((plate_name(placed.board.name),)))


def transfer_of(cell: Cell, a: Placed, b: Placed, index: int) -> Transfer:
    """Cube `index` from A to B."""
    return Transfer(f"cube {index + 1}", station(cell, a, index), station(cell, b, index, RELEASE_GAP))


def scene_of(cell: Cell, a: Placed, b: Placed, obstacles: Sequence[Body], placed: int) -> Scene:
    """The scene with cubes 1 to `placed` on B, let go where the planner lets them go, and the others on A."""
    seat = T_hole_cube(cell.cube_size)
    let_go = mul(transform(t=(0.0, 0.0, RELEASE_GAP)), seat)
    cubes = [
        cube_body(
            f"cube {i + 1}",
            cell.cube_size,
            mul(b.T_base_hole(i), let_go) if i < placed else mul(a.T_base_hole(i), seat),
        )
        for i in range(4)
    ]
    boards: list[Body] = []
    for p in (a, b):
        boards.append(plate_body(p.board.name, p.T_base_board))
        stand = stand_body(p.board.name, p.T_base_board, cell.stand_size, cell.table_z)
        boards += [stand] if stand else []
    on = [b if i < placed else a for i in range(4)]
    return Scene(
        cell.robot(),
        cell.robot_holding(),
        (*cell.fixed, *boards, *obstacles),
        tuple(cubes),
        frozenset(frozenset((c.name, plate_name(p.board.name))) for c, p in zip(cubes, on, strict=True)),
    )


def draw(kind: str, seed: int) -> BenchScene:
    """The first scene of a seed that passes.

    Args:
        kind: easy or hard.
        seed: of the draw.
    """
    cell = cell_file()
    rng = np.random.default_rng([seed, {"easy": 11, "hard": 12}[kind]])
    rejected: dict[str, int] = {}
    while True:
        a, b = _layout(cell, rng, GAPS[kind])
        scene = BenchScene(f"{kind} {seed}", seed, a, b, (), rejected)
        if not _served(scene):
            rejected["layout out of reach"] = rejected.get("layout out of reach", 0) + 1
            continue
        if kind == "easy":
            return scene
        lines = [free_lines(scene, i) for i in range(4)]
        for _ in range(WALLS_A_LAYOUT):
            candidate = replace(scene, obstacles=(_obstacle(rng, a, b),))
            reason = _unfit(candidate, lines)
            if reason is None:
                return candidate
            rejected[reason] = rejected.get(reason, 0) + 1


def _layout(cell: Cell, rng: np.random.Generator, gap: float) -> tuple[Placed, Placed]:
    while True:
        sides = rng.permutation([-1.0, 1.0])
        first, second = rng.permutation(len(cell.boards))[:2]
        placed = [
            _board(cell, rng, cell.boards[i], s, gap) for i, s in zip((first, second), sides, strict=True)
        ]
        if gap_between(*placed).width >= gap:
            return placed[0], placed[1]


def _board(cell: Cell, rng: np.random.Generator, board: Board, side: float, gap: float) -> Placed:
    while True:
        x = rng.uniform(0.34, 0.64)
        y = -0.015 + side * rng.uniform(0.095 + gap / 2, 0.15 + gap / 2)
        yaw = np.radians(rng.uniform(-180, 180))
        tilt, azimuth = np.radians([rng.choice(TILTS_DEG), rng.uniform(-180, 180)])
        centre = np.array([x, y, rng.uniform(0.03, HIGHEST)])
        placed = Placed(board, frozen(board_placement(centre, yaw, tilt, azimuth)))
        low = placed.outline()[:, 2].min() - PLATE_SIZE[2]
        if (
            low > cell.table_z + 0.003
            and placed.outline()[:, 2].max() <= HIGHEST + 0.03
            and _seen(cell, placed)
        ):
            return placed


def _seen(cell: Cell, placed: Placed) -> bool:
    """Whether markers and cubes are inside the camera's image."""
    half = POCKET_MOUTH / 2
    square = np.array([[i * half, j * half, z] for i in (-1, 1) for j in (-1, 1) for z in (0.0, _CUBE_TOP)])
    mouths = (placed.board.holes[:, None] + square).reshape(-1, 3)
    marks = (placed.board.marker_corners() * np.array([1.0, 1.0, 0.0])).reshape(-1, 3)
    pixels = cell.camera.project_base(apply(placed.T_base_board, np.concatenate([marks, mouths])))
    return bool(np.all(pixels > MARGIN_PX) and np.all(pixels < np.array(cell.camera.size) - MARGIN_PX))


def _obstacle(rng: np.random.Generator, a: Placed, b: Placed) -> Body:
    """A wall or a box in the gap between the boards."""
    gap = gap_between(a, b)
    if rng.random() < 0.6:
        kind, size = "wall", (rng.uniform(0.01, 0.02), rng.uniform(0.25, 0.6), rng.uniform(0.2, 0.6))
    else:
        kind, size = "box", (rng.uniform(0.02, gap.width), rng.uniform(0.1, 0.3), rng.uniform(0.2, 0.6))
    rounded = tuple(float(np.round(s, 3)) for s in size)
    room = max(gap.width - rounded[0], 0.0) / 2
    along = np.array([-gap.normal[1], gap.normal[0]])
    x, y = gap.middle + rng.uniform(-room, room) * gap.normal + rng.uniform(-0.1, 0.1) * along
    pose = transform(rot_z(float(np.arctan2(gap.normal[1], gap.normal[0]))), (x, y, rounded[2] / 2))
    return Body(kind, Box((rounded[0], rounded[1], rounded[2])), frozen(pose), "wall")


def _unfit(scene: BenchScene, lines: list[FreeLines]) -> str | None:
    """Why an obstacle does not make a hard scene, or None; `lines` are free without it."""
    if _overlaps(scene):
        return "obstacle overlaps"
    left = []
    for index, free in enumerate(lines):
        query = scene.query(index)
        still = _past(query, scene.obstacles, free)
        start = World(query.scene.robot_open, scene.obstacles)
        if not still.picks or not still.places or not _clear(start, query.q_start[None]):
            return "obstacle blocks a line"
        if not _turns_past(start, query.q_start, still):
            return "the arm cannot turn past the obstacle"
        left.append(still)
    if not all(_blocked(scene.query(i), free) for i, free in enumerate(left)):
        return "a straight move is free"
    return None


def _turns_past(world: World, q_start: Array, lines: FreeLines) -> bool:
    """Whether turret and shoulder, which only joint 1 moves, keep the clearance from the start to some grips.

    The shoulder is a cylinder about axis 2. Joint 1 goes through all values on the way, whatever the others do.
    """
    bodies = {"turret", "shoulder"}
    pairs = np.flatnonzero([bool(bodies & set(world.pair_names(i))) for i in range(len(world.pairs))])

    def reached(q: Array) -> bool:
        turns = np.linspace(q_start[0], q[0], 2 + int(abs(q[0] - q_start[0]) / np.radians(0.5)))
        at = np.tile(q_start, (len(turns), 1))
        at[:, 0] = turns
        return all(float(world.pair_distances(x, pairs).min()) >= CLEARANCE for x in at)

    return all(any(reached(grip.q[-1]) for grip in side) for side in (lines.picks, lines.places))


def _past(query: Query, obstacles: Sequence[Body], lines: FreeLines) -> FreeLines:
    """The lines that keep clear of obstacles too."""
    scene, transfer = query.scene, query.transfers[0]
    cube = scene.cube(transfer.cube)
    in_tool = frozen(mul(inverse(transfer.pick.T_base_tool[0]), cube.T_base_body))
    worlds = (World(scene.robot_open, obstacles), World(scene.robot_holding, obstacles, cube, in_tool))

    def past(found: list[GripLine]) -> list[GripLine]:
        return [g for g in found if all(_clear(w, g.q) for w in worlds)]

    return FreeLines(past(lines.picks), past(lines.places))


def _overlaps(scene: BenchScene) -> bool:
    """Whether an obstacle cuts a board, a stand, a cube or the post ."""
    cell = cell_file()
    standing = scene_of(cell, scene.a, scene.b, (), 0)
    cubes_on_b = scene_of(cell, scene.a, scene.b, (), 4).cubes
    request, result = coal.CollisionRequest(), coal.CollisionResult()
    for obstacle in scene.obstacles:
        for body in (*standing.bodies, *standing.cubes, *cubes_on_b):
            if body.kind == "table":
                continue
            result.clear()
            if coal.collide(*_coal_box(obstacle), *_coal_box(body), request, result):
                return True
    return False


def _coal_box(body: Body) -> tuple[coal.Box, coal.Transform3s]:
    T = body.T_base_body
    return coal.Box(*box_size(body)), coal.Transform3s(np.array(T[:3, :3]), np.array(T[:3, 3]))


@dataclass(frozen=True)
class FreeLines:
    """Lines of one query that keep clear of what stands, and the cube in the tool for each yaw of the pick."""

    picks: list[GripLine]
    places: list[GripLine]


def free_lines(scene: BenchScene, index: int) -> FreeLines:
    """Lines of query `index` that keep `CLEARANCE` to all that may not be touched."""
    return lines_that_are_free(scene.query(index))


def lines_that_are_free(query: Query) -> FreeLines:
    """Lines of a query's first transfer that keep `CLEARANCE` to all that may not be touched."""
    scene, transfer = query.scene, query.transfers[0]
    cube = scene.cube(transfer.cube)
    others = tuple(c for c in scene.cubes if c.name != cube.name)
    still = (*scene.bodies, *others)
    open_before = World(scene.robot_open, (*still, cube))

    def holding(T_tool_cube: Array, touches: frozenset[str]) -> World:
        allowed = [frozenset((cube.name, n)) for n in touches]
        return World(scene.robot_holding, still, cube, T_tool_cube, allowed)

    in_tool = [frozen(mul(inverse(T), cube.T_base_body)) for T in transfer.pick.T_base_tool]
    lifting = [holding(T, transfer.pick.touches) for T in in_tool]
    lowering = holding(in_tool[0], transfer.place.touches)  # a quarter turn changes no cube
    placed = cube.at(mul(transfer.place.T_base_tool[0], in_tool[0]))
    open_after = World(scene.robot_open, (*still, placed))
    robot = scene.robot_open
    return FreeLines(
        [
            g
            for g in grip_lines(robot, transfer.pick, query.limits)
            if _clear(open_before, g.q) and _clear(lifting[g.yaw], g.q)
        ],
        [
            g
            for g in grip_lines(robot, transfer.place, query.limits)
            if _clear(lowering, g.q) and _clear(open_after, g.q)
        ],
    )


def _clear(world: World, q: Array) -> bool:
    return not any(world.in_collision(x, CLEARANCE) for x in q)


def _served(scene: BenchScene) -> bool:
    for i in range(4):
        query = scene.query(i)
        bodies = (*query.scene.bodies, *query.scene.cubes)
        if not _clear(World(query.scene.robot_open, bodies), query.q_start[None]):
            return False
        lines = lines_that_are_free(query)
        if not lines.picks or not lines.places:
            return False
    return True


def _blocked(query: Query, lines: FreeLines) -> bool:
    """Whether all straight moves collide from each yaw's grip nearest the start to the nearest grip of each yaw.

    What is left are moves that turn the arm over to another branch; no one wall stops all of them.
    """
    scene, transfer = query.scene, query.transfers[0]
    cube = scene.cube(transfer.cube)
    still = (*scene.bodies, *(c for c in scene.cubes if c.name != cube.name))
    T = frozen(mul(inverse(transfer.pick.T_base_tool[0]), cube.T_base_body))
    world = World(scene.robot_holding, still, cube, T)
    pairs = []
    for pick in {g.yaw: g for g in reversed(by_distance(lines.picks, query.q_start))}.values():
        ends = by_distance(lines.places, pick.q_offset)
        nearest = {end.yaw: end for end in reversed(ends)}
        pairs += [(pick.q_offset, end.q_offset) for end in nearest.values()]
    pairs.sort(key=lambda pair: float(np.abs(pair[1] - pair[0]).max()))
    return all(straight_hits(world.in_collision, *pair) for pair in pairs)


def straight_hits(hit: Callable[[Array], bool], q_from: Array, q_to: Array) -> bool:
    """Whether a straight joint move collides, looked at from coarse to fine down to `_STEP`."""
    count = max(2, int(np.ceil(np.abs(q_to - q_from).max() / _STEP)))
    # bit-reversed order finds a hit after a few looks
    order = sorted(range(count + 1), key=lambda i: int(f"{i:016b}"[::-1], 2))
    return any(hit(q_from + (q_to - q_from) * (i / count)) for i in order)


def offset_pose(T_base_tool: Array) -> Array:
    """The offset point of a station's tool pose."""
    return frozen(line_poses(T_base_tool, 2)[-1])
