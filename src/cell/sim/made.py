"""Boards, cubes and prints as a workshop made them: the world file's standard deviations, drawn once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from arm.errors import FileInputError, InputError
from arm.numerics.products import norm
from arm.robot.gripper import Gripper
from arm.robot.tool import FixedTool
from arm.se3 import apply, frozen, rotation, transform
from cell.config.cell import Cell
from cell.files.task import Task
from cell.files.world import TrueBoard, World
from render.surface import Print, Texture

_BOARDS, _CUBES, _TARGET, _TABLE = 1, 2, 3, 4  # what a sequence of random numbers is for


def require_apart(world: World) -> None:
    """Refuse boards that cannot both be there: centres of plates nearer than half of the smaller one's shorter side.

    Raises:
        FileInputError: names both boards and the distance.
    """
    centres = [apply(one.T_base_board, (*one.board.plate.centre, 0.0)) for one in world.boards]
    for second, one in enumerate(world.boards):
        for first, other in enumerate(world.boards[:second]):
            distance = norm(centres[second] - centres[first])
            least = min(min(true.board.plate.size[:2]) for true in (one, other)) / 2.0
            if distance < least:
                rule = (
                    f"boards {other.board.name} (boards[{first}]) and {one.board.name} stand in one place: their "
                    f"centres are {1e3 * distance:.0f} mm apart, must be at least {1e3 * least:.0f}"
                )
                raise FileInputError(world.file, f"boards[{second}].centre_mm", None, rule)


def require_on_table(world: World, table_z: float) -> None:
    """Refuse boards whose plate reaches below the top of the table, at `table_z` m.

    Raises:
        FileInputError: names the board and how far it is below.
    """
    for number, one in enumerate(world.boards):
        plate = one.board.plate
        (x, y, thick), centre = plate.size, plate.centre
        ends = [(centre[0] + i * x / 2.0, centre[1] + j * y / 2.0, -thick) for i in (-1, 1) for j in (-1, 1)]
        below = table_z - float(apply(one.T_base_board, ends)[:, 2].min())
        if below > thick / 2.0:  # less may be a height by tape, or a tilt that is not quite the stand's
            rule = (
                f"puts the underside of board {one.board.name} {1e3 * below:.0f} mm below the top of the table "
                f"(table.top_z_mm = {1e3 * table_z:g} in the cell file)"
            )
            help = "centre_mm is the middle of the plate's top"
            raise FileInputError(world.file, f"boards[{number}].centre_mm", None, rule, help)


def require_boards_of(task: Task, world: World) -> None:
    """Refuse a world without a board of a task that is to be seen or carried out in it.

    Raises:
        FileInputError: names the board.
    """
    there = {one.board.marker_ids for one in world.boards}
    for board in task.boards:
        if board.marker_ids not in there:
            rule = f"have no board {board.name}, which {task.file} needs"
            raise FileInputError(world.file, "boards", None, rule, "--world WORLD gives another world file")


def made_board(world: World, board: TrueBoard, pocket: tuple[float, float]) -> TrueBoard:
    """A board with its true holes, pockets (nominal mouth and floor: `pocket`, m) and prints.

    What is drawn depends on `build_seed` and on the board's marker ids alone.
    """
    ids = board.board.marker_ids
    rng = np.random.default_rng([world.build_seed, _BOARDS, *ids])
    moved, wider = rng.standard_normal((len(board.board.holes), 2)), rng.standard_normal()
    holes = board.board.holes.copy()
    holes[:, :2] += world.made.hole * moved
    mouth, floor = (width + world.made.pocket * wider for width in pocket)
    prints = tuple(made_print(world, rng, (_BOARDS, *ids, number)) for number in range(2))
    truth = replace(board.board, holes=frozen(holes), pocket=(mouth, floor))
    return replace(board, board=truth, prints=(prints[0], prints[1]))


def made_print(world: World, rng: np.random.Generator | None, what: tuple[int, ...]) -> Print:
    """A print; `rng` draws how it was glued, None: it lies where it belongs. `what` tells one warp from another."""
    prints = world.prints
    x, y, turn = np.zeros(3) if rng is None else rng.standard_normal(3)
    return Print(
        black=prints.black,
        white=prints.white,
        spread=prints.spread,
        border=prints.border,
        scale=prints.print_scale,
        shift=(float(prints.glued * x), float(prints.glued * y)),
        turn=float(prints.glued_turn * turn),
        warp=prints.warp,
        seed=(world.build_seed, *what),
    )


def target_print(world: World) -> Print:
    """How calibration targets were printed."""
    return made_print(world, None, (_TARGET,))


def cube_sizes(world: World, count: int, size: float) -> list[float]:
    """True edges of the cubes of nominal `size`, m."""
    rng = np.random.default_rng([world.build_seed, _CUBES])
    return [size + world.made.cube * float(rng.standard_normal()) for _ in range(count)]


def true_tool(cell: Cell, world: World) -> Gripper | FixedTool:
    """Return the tool as it truly is on the flange.

    Raises:
        InputError: the world has another place for a tool with jaws.
    """
    errors, tool = world.tool, cell.tool
    if not (np.any(errors.tool_off) or np.any(errors.tool_turned)):
        return tool
    if not isinstance(tool, FixedTool):
        raise InputError(
            f"{world.file}: tool.off_mm, tool.turned_deg: are for tools without jaws", name="tool.off_mm"
        )
    return tool.moved(transform(rotation(errors.tool_turned), errors.tool_off))


def texture(world: World) -> Texture:
    """Texture of the table's top."""
    t = world.table
    seed = int(np.random.default_rng([world.build_seed, _TABLE]).integers(2**31))
    return Texture(t.grain, t.stain, t.specks, t.scratches, seed)
