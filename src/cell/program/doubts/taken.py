"""Where a part is taken from the air: nothing is below it, and the jaws would close beside or above it."""

from __future__ import annotations

from collections.abc import Iterator

from arm.se3 import Array
from cell.program.parts.handled import CONTACT, parts_of
from cell.program.program_file import ProgramTask
from plan.collision.world import distance_of


def taken_from_air(task: ProgramTask, T_base_work: Array) -> Iterator[str]:
    """Say of each step whose first part stands on nothing where it is taken, by how much.

    A feeder that is in no file holds parts too, so this is no error.
    """
    parts = parts_of(task.part, task.steps, task.repeat, T_base_work)
    body_of = {body.name: body for body in parts.bodies}
    around = (*task.cell.fixed, *task.bodies_at(T_base_work))
    told = set[str]()
    for one in parts.handled:
        if one.put or one.key in told:
            continue
        told.add(one.key)
        alike = next((supply for supply in parts.supplies if one.part in supply), ())
        others = [body for name, body in body_of.items() if name not in alike]
        away = min(
            (distance_of(body_of[one.part], other).value for other in (*around, *others)), default=None
        )
        if away is not None and away > CONTACT:
            yield (
                f"{task.file.name}: {one.key}: where {one.part} is taken, it is {1e3 * away:.0f} mm above or beside "
                "all that the files have: is at_mm that of its middle, and is what carries it in [[bodies]]?"
            )
