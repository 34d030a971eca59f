"""Scenes that cannot be done, and whether the planner refuses them for the right reason."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from arm.errors import ImpossibleError
from arm.robot.shapes import Body, Box
from arm.se3 import frozen, rotation, transform
from planning_bench.ours import Ours
from planning_bench.placed import Placed
from planning_bench.query import Query
from planning_bench.scenes import BenchScene, draw, lines_that_are_free
from planning_bench.tables import markdown

_DRAWS = 100


def infeasible_row(count: int, first_seed: int) -> str:
    """Refusals of `count` scenes of each kind; the reason is right if it names what was put in the way."""
    planner = Ours()
    rows = []
    for name, make, wanted in KINDS:
        refused, right, other = 0, 0, []
        for seed in range(first_seed, first_seed + count):
            query = make(draw("easy", seed), np.random.default_rng([seed, 14]))
            try:
                planner.plan(query)
            except ImpossibleError as error:
                refused += 1
                if wanted(str(error), query):
                    right += 1
                else:
                    other.append(str(error)[:300])
            else:
                other.append(f"seed {seed}: a plan came out")
        rows.append([name, str(count), str(refused), str(right), " / ".join(dict.fromkeys(other)) or "-"])
    return markdown(["scene", "n", "refused", "with the right reason", "others"], rows)


def blocked(scene: BenchScene, rng: np.random.Generator) -> Query:
    """A slab hangs 30 to 80 mm above the cube's hole on B: no line fits under it, whatever the yaw."""
    query = scene.query(0)
    T = query.holes[0][1]
    slab = T @ transform(t=(0.0, 0.0, float(rng.uniform(0.07, 0.12)) + 0.01))
    body = Body("slab", Box((0.03, 0.03, 0.02)), frozen(slab), "wall")
    return replace(query, scene=replace(query.scene, bodies=(*query.scene.bodies, body)))


def out_of_reach(scene: BenchScene, rng: np.random.Generator) -> Query:
    """Board B stands 1.0 to 1.3 m away."""
    away = transform(t=(float(rng.uniform(0.6, 0.9)), 0.0, 0.0))
    far = replace(scene, b=Placed(scene.b.board, frozen(away @ scene.b.T_base_board)))
    return far.query(0)


def table_under_the_tool(scene: BenchScene, rng: np.random.Generator) -> Query:
    """Board B stands on its edge, its normal level towards the arm, one hole 25 to 40 mm above the table.

    The tool must come in along the table, where palm and wrist have no room. Board A stands on the other side. Drawn
    again until both holes can be served where there is no table, so that the table alone is the reason.
    """
    for _ in range(_DRAWS):
        query = _on_its_edge(scene, rng)
        free = tuple(b for b in query.scene.bodies if b.kind != "table")
        lines = lines_that_are_free(replace(query, scene=replace(query.scene, bodies=free)))
        if lines.picks and lines.places:
            return query
    raise RuntimeError(f"no board on its edge that only the table blocks in {_DRAWS} draws")


def _on_its_edge(scene: BenchScene, rng: np.random.Generator) -> Query:
    side = float(np.sign(scene.a.T_base_board[1, 3]))
    a = np.array(scene.a.T_base_board)
    a[1, 3] += side * rng.uniform(0.0, 0.12)
    hole = scene.b.board.T_board_hole(0)
    at = np.array([rng.uniform(0.55, 0.65), -side * rng.uniform(0.2, 0.25), rng.uniform(0.025, 0.04)])
    T = transform(rotation(np.array([0.0, -np.pi / 2, 0.0])))
    T = np.array(T)
    T[:3, 3] = at - (T @ hole)[:3, 3]
    query = replace(scene, a=Placed(scene.a.board, frozen(a)), b=Placed(scene.b.board, frozen(T))).query(0)
    # a plate on its edge has no stand under it; what of it is below the table's top touches nothing that moves
    stand = f"stand {scene.b.board.name}"
    kept = tuple(b for b in query.scene.bodies if b.name != stand)
    return replace(query, scene=replace(query.scene, bodies=kept))


def _names(*words: str) -> Callable[[str, Query], bool]:
    return lambda text, query: all(w in text for w in words)


def _reach(text: str, query: Query) -> bool:
    return query.transfers[0].place.name in text and (
        "reach" in text or "workspace" in text or "limit" in text
    )


KINDS: tuple[
    tuple[str, Callable[[BenchScene, np.random.Generator], Query], Callable[[str, Query], bool]], ...
] = (
    ("hole blocked", blocked, _names("slab")),
    ("board out of reach", out_of_reach, _reach),
    ("table under the tool", table_under_the_tool, _names("table")),
)


def truly_infeasible(query: Query) -> bool:
    """Whether no line at the place keeps its clearance (the scenes' own test)."""
    return not lines_that_are_free(query).places
