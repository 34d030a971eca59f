"""A found assignment as goals in order, and the steps of its sequence."""

from __future__ import annotations

from arm.se3 import Array
from plan.options import PlanOptions
from plan.program.assignment.found import Found
from plan.program.assignment.worlds import TaskWorlds
from plan.program.goals.line_chains import LineChains, SequenceStep
from plan.program.goals.target import Target


def task_targets(
    found: Found, worlds: TaskWorlds, q_home: Array, options: PlanOptions, first_cube: int = 0
) -> list[Target]:
    """Return the goal of each leg of a found assignment: the source, the place and, if the arm returns, home.

    Args:
        found: the assignment.
        worlds: transfers and places, by the numbers of the assignment.
        q_home: configuration at the start and end of the task, (n,) rad.
        options: lengths of lines, jaws, looks.
        first_cube: index of the first cube in the whole program.
    """
    targets: list[Target] = []
    number, cube, look_before = first_cube - 1, "", 0.0
    for planned in found.legs:
        site, grasp = planned.leg.goal.site, planned.grasp
        if grasp is None:
            looks = options.look != "never"
            targets.append(Target("home", q=q_home, role="home", look=looks, cube=number, subject=cube))
            continue
        station, picks = worlds.station(site), not site.placed
        if picks:
            transfer = worlds.transfers[site.number]
            number, cube, look_before = number + 1, transfer.cube, transfer.look_before
        targets.append(
            Target(
                station.name,
                station.T_base_tool[grasp.yaw],
                approach=options.offset,
                retract=options.offset,
                attach=cube if picks else None,
                detach=not picks,
                look_before=0.0 if picks else look_before,
                allowed_collisions=[(cube, name) for name in sorted(station.touches)],
                jaws=options.fraction_closed if picks else 0.0,
                settle_s=options.settle_s,
                cube=number,
                subject=cube,
            )
        )
    return targets


def sequence_steps(found: Found, chains: LineChains) -> list[SequenceStep]:
    """Return the steps of a found assignment: its transits, and the lines followed from its grasps."""
    steps = []
    for index, planned in enumerate(found.legs):
        grasp = planned.grasp
        q, branch = (planned.path[-1], "") if grasp is None else (grasp.q_hole, grasp.branch)
        steps.append(SequenceStep(chains.chain(range(index, index + 1), q, branch), planned.path))
    return steps
