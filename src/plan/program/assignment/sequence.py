"""A found assignment as goals in order, and the steps of its sequence."""

from __future__ import annotations

from dataclasses import dataclass

from arm.se3 import Array
from plan.options import PlanOptions
from plan.program.assignment.found import Found
from plan.program.assignment.worlds import TaskWorlds
from plan.program.goals.line_chains import LineChains, SequenceStep
from plan.program.goals.target import Target
from plan.scene import Station


@dataclass(frozen=True)
class Leg:
    """The leg of the search that a step belongs to: number of its stop, and ``out``, ``across`` or ``home``."""

    stop: int
    which: str


@dataclass(frozen=True)
class TaskSequence:
    """Goals of a task in order.

    Attributes:
        targets: for each stop the pick, the place and, if the arm returns, home.
        legs: the leg of each target.
    """

    targets: tuple[Target, ...]
    legs: tuple[Leg, ...]

    def leg(self, step: int, role: object) -> Leg:
        """Return the leg of a phase of a step; a retract belongs to the next leg."""
        return self.legs[min(step + (role == "retract"), len(self.legs) - 1)]


def task_sequence(
    found: Found, stages: TaskWorlds, q_home: Array, options: PlanOptions, first_cube: int = 0
) -> TaskSequence:
    """Return the goals of a found assignment.

    Args:
        found: the assignment.
        stages: transfers and places, by the numbers of the assignment.
        q_home: configuration at the start and end of the task, (n,) rad.
        options: lengths of lines, jaws, looks.
        first_cube: index of the first cube in the whole program.
    """
    targets: list[Target] = []
    legs: list[Leg] = []
    for number, stop in enumerate(found.stops):
        transfer, place = stages.transfers[stop.visit.pick], stages.places[stop.visit.place]
        for which, station, yaw in (("out", transfer.pick, stop.pick.yaw), ("across", place, stop.place.yaw)):
            cube = first_cube + number
            targets.append(_goal(station, yaw, transfer.cube, cube, which == "out", options))
            legs.append(Leg(number, which))
        if stop.home is not None:
            looks = options.look != "never"
            home = Target("home", q=q_home, role="home", look=looks, cube=cube, subject=transfer.cube)
            targets.append(home)
            legs.append(Leg(number, "home"))
    return TaskSequence(tuple(targets), tuple(legs))


def _goal(station: Station, yaw: int, cube: str, number: int, picks: bool, options: PlanOptions) -> Target:
    return Target(
        station.name,
        station.T_base_tool[yaw],
        approach=options.offset,
        retract=options.offset,
        attach=cube if picks else None,
        detach=not picks,
        allowed_collisions=[(cube, name) for name in sorted(station.touches)],
        jaws=options.fraction_closed if picks else 0.0,
        settle_s=options.settle_s,
        cube=number,
        subject=cube,
    )


def sequence_steps(found: Found, sequence: TaskSequence, chains: LineChains) -> list[SequenceStep]:
    """Return the steps of a found assignment: its transits, and the lines followed from its grasps."""
    parts: list[tuple[Array, str, Array]] = []
    for stop in found.stops:
        parts.append((stop.pick.q_hole, stop.pick.branch, stop.out))
        parts.append((stop.place.q_hole, stop.place.branch, stop.across))
        if stop.home is not None:
            parts.append((stop.home[-1], "", stop.home))
    return [
        SequenceStep(chains.chain(range(index, index + 1), q, branch), waypoints)
        for index, (q, branch, waypoints) in enumerate(parts)
    ]
