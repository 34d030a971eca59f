"""A cell with contact physics whose tool is moved along straight lines, without arm and controller."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from arm.io.storage import data_file
from arm.se3 import Array, rot_x, rotation, rotation_vector, transform
from cell.config.cell import Cell
from cell.config.cell_file import read_cell
from cell.contact.cell import ContactCell
from cell.files.world import World, read_world
from driver.emulator.unit.record import Record

OVER = transform(rot_x(np.pi), (0.0, 0.0, 0.015))  # T_hole_tool of jaws around a seated cube
SHUT = 0.9  # of the stroke
LIFT = 0.12  # m
START = transform(rot_x(np.pi), (0.3, 0.4, 0.4))  # far from all boards


def world_of(name: str = "scenes/task2.world.toml", contact: Mapping[str, float] | None = None) -> World:
    """A world file, with some constants of contact physics replaced."""
    world = read_world(data_file(name), 0.036)
    keys: Mapping[str, float] = {**vars(world.contact), **(contact or {})}
    return replace(world, contact=type(world.contact)(**keys))


class PosedCell(ContactCell):
    """A cell whose "counts" are indices of tool poses."""

    def __init__(self, cell: Cell, world: World) -> None:
        super().__init__(cell, world)
        self.poses: list[Array] = [START]

    def T_base_tool(self, counts: npt.ArrayLike) -> Array:
        return self.poses[int(np.asarray(counts)[0])]

    def _true_tool(self, counts: npt.ArrayLike, arrived: Array, now_ms: int) -> Array:
        return self.T_base_tool(counts)


class DrivenContact:
    """A cell with contact physics, and the record of its tool.

    Attributes:
        cell: the simulated cell.
        ms: the time.
    """

    def __init__(self, world: World | None = None) -> None:
        self.cell = PosedCell(read_cell(data_file("scenes/cell.toml")), world or world_of())
        self.ms = 0
        self._times: list[int] = []
        self._adc = self.cell.cell.unit.gripper.adc(0.0)
        self.cell.now_ms = lambda: self.ms
        self.cell.record = self._record

    @property
    def counts(self) -> tuple[int, ...]:
        """Where the tool is."""
        return (len(self.cell.poses) - 1, 0, 0, 0, 0, 0)

    def line(self, T_base_tool: Array, seconds: float = 1.0) -> None:
        """Move the tool along a straight line."""
        begin, steps = self.cell.poses[-1], round(1e3 * seconds)
        turn = rotation_vector(T_base_tool[:3, :3] @ begin[:3, :3].T)
        for share in np.arange(1, steps + 1) / steps:
            at = (1.0 - share) * begin[:3, 3] + share * T_base_tool[:3, 3]
            self.cell.poses.append(transform(rotation(share * turn) @ begin[:3, :3], at))
            self.ms += 1
            self._times.append(self.ms)

    def wait(self, seconds: float) -> None:
        """Let time pass with the arm at rest."""
        self.ms += round(1e3 * seconds)

    def jaws(self, fraction: float) -> float:
        """Move the jaws to a fraction of their stroke; return the opening where they stop, m."""
        gripper = self.cell.cell.unit.gripper
        self._adc = self.cell.jaws(self.counts, self._adc, gripper.adc(fraction))
        return self._width()

    def reading(self) -> float:
        """The opening that the jaws read now, m."""
        self._adc = self.cell.jaws_now(self.counts, self._adc)
        return self._width()

    def T_base_hole(self, board: int, hole: int) -> Array:
        """True pose of a hole."""
        b = self.cell.world.boards[board]
        return np.asarray(b.T_base_board @ b.board.T_board_hole(hole))

    def fetch(self, hole: int, aside: Array | None = None) -> float:
        """Close the jaws on the cube of a hole of the first board and lift it by `LIFT`; return their opening, m.

        `aside` (4, 4) is an error in the tool's frame.
        """
        grip = self.T_base_hole(0, hole) @ OVER @ (transform() if aside is None else aside)
        above = grip @ transform(t=(0.0, 0.0, -LIFT))
        self.line(above)
        self.line(grip)
        self.wait(0.1)
        opening = self.jaws(SHUT)
        self.line(above)
        return opening

    def place(self, hole: int, aside: tuple[float, float] = (0.0, 0.0), lean: Array | None = None) -> None:
        """Put the held cube into a hole of the second board, off by `aside`, m, and retract.

        The tool leans about the hole's middle by `lean`, a rotation vector (2,) rad in the plate's plane.
        """
        error = transform(rotation((*lean, 0.0)) if lean is not None else None, (*aside, 0.0))
        at = self.T_base_hole(1, hole) @ error @ OVER
        above = at @ transform(t=(0.0, 0.0, -LIFT))
        self.line(above)
        self.line(at)
        self.wait(0.1)
        self.jaws(0.0)
        self.line(above)

    def _width(self) -> float:
        gripper = self.cell.cell.unit.gripper
        return self.cell.cell.gripper.width(gripper.fraction_closed(self._adc))

    def _record(self, after_ms: int) -> Record:
        first = int(np.searchsorted(self._times, after_ms, side="right"))
        counts = np.zeros((len(self._times) - first, 6), dtype=np.int64)
        counts[:, 0] = np.arange(first, len(self._times)) + 1
        return Record(np.array(self._times[first:], dtype=np.int64), counts)
