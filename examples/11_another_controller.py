"""Execute a certified plan on another controller than the MARS-8 (`rows_over_a_socket.py`), which moves straight."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from rows_over_a_socket import RowsController, RowsServer

from a465 import Body, Box, Target, load_a465, plan_poses, rot_x, transform, urdf_limits, write_plan
from arm.controller.segments import CountPath, Segment
from arm.controller.unit import Unit
from arm.errors import ImpossibleError
from arm.plan_file import Step, read_plan
from driver.execution.execute import execute
from driver.line.clock import Clock
from plan.collision.certificate import certify_move
from plan.program.stated_arm import stated_arm
from plan.verify import move_scenes, replay

ROW_MS, CORNERS = 20, 1e-3  # between two rows; clearance that their straight lines may cost, m


def certified_rows(file: Path) -> tuple[Unit, list[Step]]:
    """Prove a plan again, and then its moves as the rows that are sent, with straight lines between them."""
    plan = read_plan(file)
    arm = stated_arm(file, plan)
    scene, unit, rows = arm.scene(plan), arm.unit, dict[int, Step]()
    replay(plan, scene, unit, arm.limits)
    for move, world, _ in move_scenes(plan, scene, unit):
        ms = round(1e3 * move.path.duration_s)
        times = np.rint(np.linspace(0, ms, max(ms // ROW_MS, 1) + 1)).astype(int)
        knots = np.rint(move.path.at(times / 1e3)).astype(int)
        lines = zip(np.diff(times).tolist(), np.diff(knots, axis=0).tolist(), strict=True)
        path = CountPath(move.path.start, tuple(Segment(t, (tuple(by),)) for t, by in lines))
        check = certify_move(world, path, unit, move.clearance - CORNERS)
        if not check.proved:
            raise ImpossibleError(f"{move.name!r} comes within {1e3 * check.seen:.2f} mm as rows")
        rows[id(move)] = replace(
            move, path=path, clearance=check.clearance, closest=check.pair, clearances=()
        )
    return unit, [rows.get(id(step), step) for step in plan.steps]


if __name__ == "__main__":
    robot = load_a465(tool_length=0.134112, jaw_opening=0.0)
    bodies = (
        Body("table", Box((1.2, 1.4, 0.04)), transform(t=(0.3, 0.0, -0.02)), "table"),
        Body("wall", Box((0.3, 0.04, 0.3)), transform(t=(0.45, 0.0, 0.15)), "wall"),
    )
    there = Target("there", transform(rot_x(np.pi), (0.42, 0.25, 0.1)), free="rz", approach=0.04)
    q = np.radians([-60, -40, -80, 0, -60, 0])
    planned = plan_poses(robot, bodies, [there], q, urdf_limits(robot, acceleration=4.0))
    write_plan(Path("plan.json"), planned.plan())

    unit, steps = certified_rows(Path("plan.json"))
    server, clock = RowsServer(q.tolist(), Clock()), Clock()
    with RowsController(server.address, unit, clock) as arm:  # leaving it by an error or a signal sends STOP
        arm.identify()
        done = execute(arm, steps, lambda step, index, total: print(f"{index + 1} of {total}: {step.name}"))
        off = unit.positions(arm.settled_counts()) - planned.q_end
    server.close()
    lasted = done[-1].end_s - done[0].start_s
    print(f"{len(done)} steps done in {lasted:.1f} s; {np.abs(off).max():.0e} rad off the end")
