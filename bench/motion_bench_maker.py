"""Transits of a Panda in narrow places: problems of MotionBenchMaker, against roboplan, judged by coal.

python bench/motion_bench_maker.py FOLDER --problems 40

FOLDER has one JSON file for each set, and VAMP's Panda of spheres with its SRDF. Both planners get the same spheres,
bodies, starts and goals. Ours certifies every path at 0 clearance; roboplan checks steps of 0.01 rad. roboplan is of
the extra `bench`; --no-peer does without it.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from narrow_bench.conditions import conditions, timed
from narrow_bench.judge import Judge
from narrow_bench.panda import SETS, Problem, panda, problems

from arm.controller.unit import Limits
from arm.errors import ImpossibleError
from arm.robot.model import Robot
from arm.se3 import Array
from plan.budget import SearchBudget, allowed
from plan.collision.world import World
from plan.trajectory.time_estimates import path_time
from plan.transit.planner import plan_transit

TOUCHING = 1e-6  # m, depth up to which the judge calls bodies touching


@dataclass
class Row:
    """What one planner did on one set; CPU in s, path times in s, least distance in m."""

    cpu: list[float] = field(default_factory=list)
    first: list[float] = field(default_factory=list)
    worlds: list[float] = field(default_factory=list)
    effort: list[float] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    least: float = np.inf
    hits: int = 0
    unsolved: list[int] = field(default_factory=list)

    def add(self, problem: Problem, path: Array | None, judge: Judge, limits: Limits) -> None:
        """Judge a path."""
        if path is None:
            self.unsolved.append(problem.number)
            return
        if not np.array_equal(path[[0, -1]], [problem.q_start, problem.q_goal]):
            raise ValueError(f"problem {problem.number}: the path has other ends")
        self.times.append(path_time(path, limits))
        least = judge.least_distance(path)
        self.hits += least < -TOUCHING
        self.least = min(self.least, least)


def main() -> None:
    """Plan, judge, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="the data")
    parser.add_argument("--problems", type=int, default=40, help="of each set")
    parser.add_argument("--sets", nargs="+", default=list(SETS), choices=SETS)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--no-peer", action="store_true")
    options = parser.parse_args()
    print(conditions(f"{options.problems} problems of each set, seed {options.seed}, 0 clearance asked"))
    print(
        "  CPU: from world (scene) in memory to the certified path, broadphase included; roboplan: to the shortened "
        "path, and to its first path\n"
        "  path: estimated duration at the limits of the data's SOURCES.md; judge: coal, steps of 0.002 rad"
    )
    print(
        "\n| set | planner | solved | CPU ms median, p95, max | world ms | effort s max | path s median | hits "
        "| least mm |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    robot, limits = panda(options.folder)
    peer: Any = None
    if not options.no_peer:
        from narrow_bench.roboplan_peer import RoboplanFine

        peer = RoboplanFine(options.folder)
    for name in options.sets:
        ours, theirs = Row(), Row()
        for problem in problems(options.folder, name, options.problems):
            judge = Judge(robot, problem.bodies)
            ours.add(problem, _ours(ours, problem, robot, limits, options.seed), judge, limits)
            if peer is not None:
                theirs.add(problem, _theirs(theirs, peer, problem, options.seed), judge, limits)
        _print(name, "ours", ours, ours.cpu)
        if peer is not None:
            _print(name, "roboplan-fine", theirs, theirs.cpu)
            _print(name, "its first path", Row(), theirs.first)


def _ours(row: Row, problem: Problem, robot: Robot, limits: Limits, seed: int) -> Array | None:
    with timed(row.worlds):
        world = World(robot, problem.bodies)
    with allowed(SearchBudget()) as meter, timed(row.cpu):
        try:
            path: Array | None = plan_transit(world, problem.q_start, problem.q_goal, limits, 0.0, seed)
        except ImpossibleError:
            path = None
    row.effort.append(meter.effort_s)
    return path


def _theirs(row: Row, peer: Any, problem: Problem, seed: int) -> Array | None:
    with timed(row.worlds):
        peer.load(problem.bodies)
    peer.in_collision(problem.q_start)
    with timed(row.cpu):
        with timed(row.first):
            path, straight = peer.path(problem.q_start, problem.q_goal, seed)
        if path is not None and not straight:
            path = peer.shortened(seed)
    return None if path is None else np.asarray(path)


def _print(name: str, planner: str, row: Row, cpu: list[float]) -> None:
    ms = np.array(cpu) * 1e3
    spent = f"{np.median(ms):.0f}, {np.percentile(ms, 95):.0f}, {ms.max():.0f}"
    if not row.cpu:
        print(f"| {name} | {planner} | | {spent} | | | | | |", flush=True)
        return
    solved = f"{len(row.times)} of {len(row.cpu)}"
    effort = f"{max(row.effort):.2f}" if row.effort else "-"
    print(
        f"| {name} | {planner} | {solved} | {spent} | {np.median(row.worlds) * 1e3:.0f} | {effort} "
        f"| {np.median(row.times):.2f} | {row.hits} | {row.least * 1e3:.2f} |",
        flush=True,
    )
    if row.unsolved:
        print(f"  {name}, {planner}, not solved: {row.unsolved}", flush=True)


if __name__ == "__main__":
    main()
