"""Scenes, planners and the judge put together: one flat record per planner and query."""

from __future__ import annotations

import contextlib
import json
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from arm.errors import A465Error
from planning_bench.bounds import bounds
from planning_bench.grips import grip_lines, line_poses
from planning_bench.judge import Stage, control, judge
from planning_bench.ours import Ours
from planning_bench.query import PlannerFailed, PlannerUnderTest, Query
from planning_bench.scenes import BenchScene, draw, lines_that_are_free
from planning_bench.seed import Seed

Record = dict[str, Any]
Planner = PlannerUnderTest[Any]  # each has a form of plan of its own


def _roboplan(step: float, name: str, restarts: int = 1) -> Planner:
    from planning_bench.roboplan_peer import Roboplan

    return Roboplan(name, step, restarts)


def _ompl(fraction: float, name: str) -> Planner:
    from planning_bench.ompl_peer import Ompl

    return Ompl(name, fraction)


PLANNERS: dict[str, Callable[[], Planner]] = {
    "ours": Ours,
    "roboplan-native": lambda: _roboplan(0.05, "roboplan-native"),
    "roboplan-fine": lambda: _roboplan(0.01, "roboplan-fine"),
    "roboplan-fine-best-of-5": lambda: _roboplan(0.01, "roboplan-fine-best-of-5", 5),
    "ompl-default": lambda: _ompl(0.01, "ompl-default"),
    "ompl-fine": lambda: _ompl(0.002, "ompl-fine"),
    "seed": lambda: Seed(retract=False),
    "seed+retract": lambda: Seed(retract=True),
}
GROUPS = {
    "roboplan": ("roboplan-native", "roboplan-fine", "roboplan-fine-best-of-5"),
    "ompl": ("ompl-default", "ompl-fine"),
    "seed": ("seed", "seed+retract"),
}


@cache
def planner(name: str) -> Planner:
    """A planner, loaded and run once on a scene of no account, so that imports are not counted."""
    made = PLANNERS[name]()
    warm = draw("easy", 10_000).query(0)
    with contextlib.suppress(PlannerFailed, A465Error):
        made.answer(warm, made.plan(warm))
    return made


def run_scenes(
    kind: str, seeds: Iterable[int], names: tuple[str, ...], whole: bool, jobs: int, keep: Path | None = None
) -> list[Record]:
    """All records of scenes of one kind, in the order of seeds whatever the jobs.

    Args:
        keep: file of records, one line a scene; scenes of the same planners that are in it are not run again, so a
            campaign that was ended can go on.
    """
    done = {seed: records for (of, seed), records in kept(keep, names, whole).items() if of == kind}
    wanted = list(seeds)
    tasks = [(kind, seed, names, whole) for seed in wanted if seed not in done]
    with contextlib.ExitStack() as stack:
        if jobs == 1:
            finished: Iterator[tuple[int, list[Record]]] = ((task[1], run_scene(*task)) for task in tasks)
        else:
            pool = stack.enter_context(ProcessPoolExecutor(jobs))
            futures = {pool.submit(run_scene, *task): task[1] for task in tasks}
            finished = ((futures[future], future.result()) for future in as_completed(futures))
        for seed, records in finished:
            done[seed] = records
            print(progress(records), flush=True)
            if keep is not None:
                with keep.open("a") as file:
                    file.write(
                        json.dumps({"kind": kind, "seed": seed, "whole": whole, "records": records}) + "\n"
                    )
    return [record for seed in wanted for record in done[seed]]


def kept(keep: Path | None, names: tuple[str, ...], whole: bool) -> dict[tuple[str, int], list[Record]]:
    """Records of a file by kind and seed, of scenes in which all these planners were asked."""
    if keep is None or not keep.exists():
        return {}
    found = {}
    for line in keep.read_text().splitlines():
        entry = json.loads(line)
        asked = {record["planner"] for record in entry["records"]}
        if set(names) <= asked and entry["whole"] == whole:
            found[entry["kind"], entry["seed"]] = entry["records"]
    return found


def progress(records: list[Record]) -> str:
    """One line for a scene that is done."""
    parts = []
    for name in dict.fromkeys(r["planner"] for r in records if r["planner"] != "control"):
        rows = [r for r in records if r["planner"] == name and not r["whole"]]
        parts.append(f"{name} {sum(r['clean'] for r in rows)}/{len(rows)}")
    caught = [r for r in records if r["planner"] == "control"]
    parts.append(f"controls {sum(r['caught'] for r in caught)}/{len(caught)}")
    return f"{records[0]['scene']}: clean " + ", ".join(parts)


def run_scene(kind: str, seed: int, names: tuple[str, ...], whole: bool) -> list[Record]:
    """Draw a scene, ask every planner every query of it, judge all answers, run the controls."""
    scene = draw(kind, seed)
    records = controls(scene)
    queries = [scene.query(i) for i in range(4)] + ([scene.whole()] if whole else [])
    for query in queries:
        bound = bounds(query)
        for name in names:
            records.append(
                {
                    "scene": scene.name,
                    "query": query.name,
                    "whole": len(query.transfers) > 1,
                    "planner": name,
                    "LB": bound.LB,
                    "LB0": bound.LB0,
                    "LB1": bound.LB1,
                    **run_query(planner(name), query),
                }
            )
    return records


def run_query(made: Planner, query: Query) -> Record:
    """One planner, one query; a planner that fails is a record with its reason."""
    began = time.process_time()
    try:
        planned = made.plan(query)
    except (PlannerFailed, A465Error) as error:
        return {"cpu": time.process_time() - began, "returned": False, "clean": False, "reason": str(error)}
    except Exception as error:  # noqa: BLE001  a peer may raise anything; it is counted, with its type
        reason = f"{type(error).__name__}: {error}"
        return {"cpu": time.process_time() - began, "returned": False, "clean": False, "reason": reason}
    cpu = time.process_time() - began
    answer = made.answer(query, planned)
    try:
        verdict = judge(query, answer)
    except ValueError as error:
        return {"cpu": cpu, "returned": True, "clean": False, "reason": f"judge: {error}"}
    record = {k: v for k, v in asdict(verdict).items() if k != "hits"}
    reason = "; ".join(f"stretch {i} {n} {d * 1e3:.1f} mm" for n, i, d in verdict.hits[:3])
    return {
        "cpu": cpu,
        "returned": True,
        "clean": verdict.clean,
        "certified": answer.certified,
        "reason": reason,
        "notes": answer.notes,
        **record,
    }


def controls(scene: BenchScene) -> list[Record]:
    """What the judge must catch: fingers 5 mm deep in a plate; on hard scenes also a straight move to the place."""
    query = scene.query(0)
    robot, limits = query.scene.robot_open, query.limits
    station = query.transfers[0].place
    down = []
    for T in station.T_base_tool:
        # the release is 1 mm above the grip's 15 mm: 21 mm down puts the tips 5 mm under the plate's top
        deeper = line_poses(T, 2, -0.021)[-1]
        lines = grip_lines(robot, type(station)("down", (deeper,)), limits, count=23, offset=0.022)
        down += [g.q[::-1] for g in lines]
    found = control(query, down[0]) if down else None
    base = {"scene": scene.name, "query": query.name, "whole": False, "planner": "control", "clean": False}
    records = []
    if found is not None:
        records.append({**base, "caught": found.ok, "depth": found.depth})
    if scene.obstacles:
        free = lines_that_are_free(query)
        pick = min(free.picks, key=lambda g: float(np.linalg.norm(g.q_offset - query.q_start)))
        place = min(free.places, key=lambda g: float(np.linalg.norm(g.q_offset - pick.q_offset)))
        cube = query.scene.cube(query.transfers[0].cube)
        apart = robot.disabled_collisions
        stage = Stage([*query.scene.bodies, *query.scene.cubes], apart)
        flange = stage.place(pick.q_station)
        held = (cube, np.linalg.inv(flange) @ cube.T_base_body)
        others = [c for c in query.scene.cubes if c.name != cube.name]
        stage = Stage([*query.scene.bodies, *others], apart, held)
        deepest = 0.0
        for f in np.linspace(0.0, 1.0, 2000):
            stage.place(pick.q_offset + f * (place.q_offset - pick.q_offset))
            deepest = max([deepest, *(d for _, _, d in stage.contacts())])
        records.append({**base, "caught": deepest > 1e-4, "depth": deepest})
    return records
