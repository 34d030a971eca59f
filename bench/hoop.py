"""The hoop along the wires: how many possible placements are planned, how fast, how clear, and at what cost.

python bench/hoop.py --placements 40                # all wires, the fastest plans
python bench/hoop.py --placements 40 --clearance    # the clearest ones, of placements possible at 15 mm

A placement: the wire's board flat, wholly in the camera's view, x 375 to 555 mm, y within 180 mm, any yaw, its origin
33 mm high. `bench/hoop_bench/oracle.py` says, apart from the planner, whether it is possible with 3 mm (or 15 mm)
between ring, handle or wrist and the bar. Planned: by the program files of scenes/hoop with 3 mm required of every pair
of bodies; the plan is verified again as it would be sent. CPU: from the scene to the certified plan.

"over optimal": duration of the motions over the time that the library toppra needs for the same paths without a cap on
the tool. "over graph": time along the wire over that of the fastest chain in a graph with stations every 3 mm, tilts of
10, 20 and 30 degrees in six directions and turns of 20 degrees, for the same collisions; joints there keep their speed
limits only. With --clearance, the certified least distance of ring and bar along the wire.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from hoop_bench.oracle import Oracle
from run_conditions import run_conditions

import plan.curve.graph as graph_module
from arm.errors import A465Error
from arm.plan_file import Move, Plan
from arm.se3 import Array, apply, rot_z, transform
from cell.program.planning import plan_of_program, program_goals, program_options, program_scene
from cell.program.program_file import ProgramTask, read_program
from plan.collision.certificate import certify_move
from plan.collision.world import World
from plan.curve.graph import CurveGraph
from plan.program.setting import planned_limits
from plan.trajectory.second_opinion import time_again
from plan.verify import replay
from vision.observation import Observation

ROOT = Path(__file__).resolve().parents[1]
SPEED = 0.5
REQUIRED, MARGIN, WIDE = 0.003, 0.003, 0.015  # m: of the plans, of the oracle, and for the clearest plans
X, Y, Z = (0.375, 0.555), (-0.18, 0.18), 0.033
BOARD = 0.0625  # m, half of the board's edge


@dataclass(frozen=True)
class Tried:
    """One placement that is possible, and what became of it."""

    planned: bool
    cpu: float
    over_optimal: float = np.nan
    over_graph: float = np.nan
    clearance: float = np.nan
    duration: float = np.nan
    why: str = ""


def placements(task: ProgramTask, wire: str, count: int, seed: int) -> list[Array]:
    """Return T_base_work of placements in the camera's view."""
    rng = np.random.default_rng([seed, ord(wire)])
    corners = BOARD * np.array([(x, y, 0.0) for x in (-1, 1) for y in (-1, 1)])
    camera, found = task.cell.camera, list[Array]()
    while len(found) < count:
        T = transform(rot_z(rng.uniform(-np.pi, np.pi)), (rng.uniform(*X), rng.uniform(*Y), Z))
        pixels = camera.project_base(apply(T, corners))
        if (pixels > 0.0).all() and (pixels < np.array(camera.size)).all():
            found.append(T)
    return found


def ring_to_bar(plan: Plan, task: ProgramTask, move: Move) -> float:
    """Return the certified least distance of ring and bar on a move, m."""
    scene = program_scene(task, Observation())
    bars = [body for body in scene.bodies if body.name.startswith("bar")]
    world = World(scene.robot_open, bars).only(["ring 1", "ring 2"])
    seen = certify_move(world, move.path, task.cell.unit, 0.0).seen
    for asked in np.arange(seen - 5e-5, 0.0, -2e-4):
        if certify_move(world, move.path, task.cell.unit, float(asked), tight=False).proved:
            return float(asked)
    return 0.0


def graph_time(task: ProgramTask, move: Move, plan: Plan) -> float:
    """Return the time of the fastest chain along the wire in the dense graph, s."""
    scene, cell = program_scene(task, Observation()), task.cell
    goal = next(program_goals(task, task.T_on_work))
    curve = replace(goal.curve, freedom=replace(goal.curve.freedom, ranges={}))
    world = World(scene.robot_open, scene.bodies)
    limits = planned_limits(cell.limits, program_options(task, SPEED), cell.unit)
    step, graph_module.STEP = graph_module.STEP, 0.003
    try:
        chains = CurveGraph(scene.robot_open, curve, world, REQUIRED, limits).chains()
        return next((chain.time for chain in chains), np.inf)
    finally:
        graph_module.STEP = step


def tried(task: ProgramTask, T: Array, widest: bool, graph: bool) -> Tried:
    """Plan one placement."""
    cell = replace(task.cell, least_clearance=REQUIRED)
    task = replace(task, cell=cell, T_on_work=T, clearance=REQUIRED, aim="clearance" if widest else "time")
    begin = time.process_time()
    try:
        plan = plan_of_program(task, Observation(), SPEED)
    except A465Error as error:
        return Tried(False, time.process_time() - begin, why=str(error).split(": ", 2)[-1][:110])
    cpu = time.process_time() - begin
    scene = program_scene(task, Observation())
    replay(plan, scene, cell.unit, cell.limits)
    along = next(move for move in plan.moves if move.threaded is not None)
    limits = planned_limits(cell.limits, program_options(task, SPEED), cell.unit)
    uncapped = [
        replace(motion, moves=tuple(replace(m, role="transit", name="transit") for m in motion.moves))
        for motion in plan.motions
    ]
    again = sum(time_again(motion, scene.robot_open, cell.unit, limits) for motion in uncapped)
    return Tried(
        True,
        cpu,
        plan.duration_s / again,
        along.path.duration_s / graph_time(task, along, plan) if graph else np.nan,
        ring_to_bar(plan, task, along),
        plan.duration_s,
    )


def main() -> None:
    """Draw, ask the oracle, plan, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--placements", type=int, default=40)
    parser.add_argument("--wires", default="abcde")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--clearance", action="store_true", help="the clearest plans instead of the fastest")
    parser.add_argument("--graph", action="store_true", help="the dense graph too")
    asked = parser.parse_args()
    print(f"{run_conditions()}; seed {asked.seed}; {'clearest' if asked.clearance else 'fastest'} plans\n")
    print(
        "| wire | placements | possible | planned of these | CPU s median, max | over optimal, max | over graph, "
        "median | ring to bar mm, median, least | duration s, median |\n|---|---|---|---|---|---|---|---|---|"
    )
    refused, all_cpu, all_drawn, all_planned = [], list[float](), 0, 0
    for wire in asked.wires:
        task = read_program(ROOT / "scenes" / "hoop" / f"{wire}.toml")
        oracle = Oracle(wire, task.cell.robot(), task.cell.limits)
        drawn = placements(task, wire, asked.placements, asked.seed)
        possible = [T for T in drawn if oracle.possible(T, WIDE if asked.clearance else MARGIN)]
        found = []
        for T in possible:
            found.append(tried(task, T, asked.clearance, asked.graph))
            print(f"\r{wire} {len(found)} of {len(possible)}", end="", file=sys.stderr)
        planned = [one for one in found if one.planned]
        refused += [f"{wire}: {one.why}" for one in found if not one.planned]
        cpu = [one.cpu for one in found] or [np.nan]
        all_cpu += [one.cpu for one in found]
        all_drawn, all_planned = all_drawn + len(drawn), all_planned + len(planned)

        def middle(name: str, some: list[Tried] = planned) -> float:
            return float(np.median([getattr(one, name) for one in some])) if some else np.nan

        optimal = max((one.over_optimal for one in planned), default=np.nan)
        least = 1e3 * min((one.clearance for one in planned), default=np.nan)
        print(
            f"| {wire.upper()} | {len(drawn)} | {len(possible)} | {len(planned)} | {np.median(cpu):.1f}, "
            f"{max(cpu):.1f} | {optimal:.3f} | {middle('over_graph'):.2f} | {1e3 * middle('clearance'):.1f}, "
            f"{least:.1f} | {middle('duration'):.1f} |",
            flush=True,
        )
    if all_cpu:
        print(
            f"\nAll wires: {len(all_cpu)} of {all_drawn} possible, {all_planned} planned; "
            f"CPU {np.median(all_cpu):.2f} s median, {max(all_cpu):.1f} s at most"
        )
    for line in refused:
        print(f"- {line}")


if __name__ == "__main__":
    main()
