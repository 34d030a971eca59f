"""The simulated cell with contact physics: what the jaws hold, push and release follows from forces and friction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from arm.board import plate_name
from arm.numerics.products import mul, norm
from arm.se3 import Array, apply, frozen, inverse
from cell.config.cell import Cell
from cell.contact.model import STEP_S
from cell.contact.physics import Physics
from cell.contact.resting import resting
from cell.contact.tool_track import NODE_MS, ToolTrack
from cell.files.world import TrueBoard, World
from cell.scene.bodies import stand_body
from cell.sim.cell import SimulatedCell
from cell.sim.cubes import SimulatedCube, cubes_on

NODE_STEPS = round(NODE_MS / 1e3 / STEP_S)
NEAR = 0.03  # m between the hand and cubes or plates from which on it is simulated: 60 ms at 0.5 m/s
HAND_CENTRE, HAND_RADIUS = (0.0, 0.0, -0.03), 0.06  # m, a ball around palm and fingers in the tool's frame
SETTLE_S = 3.0  # longest time that cubes get to come to rest
HALF_DIAGONAL = 0.87  # of a cube, over its edge
LEAST_PUSH = 2e-4  # m, below which the counters show nothing
SINGULAR = 0.02  # of the largest singular value: directions in which an arm cannot give way
MOVED = 5e-4  # m, of a cube that was pushed
SLIPPED = 3e-3  # m: jaws that are closer together than this below a cube's width no longer hold it


class ContactCell(SimulatedCell):
    """Ground truth by contact physics. Simulated when somebody asks, up to the present.

    Nothing is simulated while all is at rest, or while the empty hand is `NEAR` to nothing.

    Args:
        cell, world: as of `SimulatedCell`; `world.contact` has the physical constants.

    Raises:
        InputError: MuJoCo is not installed.
    """

    kind = "the simulated cell with contact physics"

    def __init__(self, cell: Cell, world: World) -> None:
        super().__init__(cell, world)
        stands = (
            stand_body(b.board.name, b.T_base_board, b.stand or cell.stand_size, cell.table_z)
            for b in self.world.boards
        )
        still = [*cell.fixed, *filter(None, stands)]
        self._physics = Physics(
            still, self.world.boards, self._cubes, self._robot, self._opening, self.world.contact
        )
        self._track = ToolTrack(self._true_tool)
        self._tool: Array | None = None  # where it is
        self._away = True  # the hand is near to nothing, and not simulated
        self._carried: int | None = None  # the cube that was gripped last, until the jaws open
        self._told = [
            c.T_base_cube for c in self._cubes
        ]  # where they were when they last were pushed or released
        self._read = 0  # steps after which the poses were taken over

    def cubes(self, counts: npt.ArrayLike) -> list[SimulatedCube]:
        self.catch_up()
        return list(self._cubes)

    def _close(self, T_base_tool: Array, target: float) -> float:
        self.catch_up()
        before = list(self._cubes)
        stop = self._move_jaws(T_base_tool, target)
        self._read_poses()
        if self._holding is not None:
            return stop
        for index, cube in enumerate(self._cubes):
            if self._physics.gripped(cube.name):
                x, y, _ = mul(inverse(T_base_tool), before[index].T_base_cube)[:3, 3]
                T_tool_cube = frozen(mul(inverse(T_base_tool), cube.T_base_cube))
                self._cubes[index] = replace(cube, where="jaws", T_tool_cube=T_tool_cube)
                self._carried = index
                detail = f"{1e3 * np.hypot(x, y):.2f} mm off the jaws' axis"
                self._record("gripped", cube.name, before[index].T_base_cube, detail)
                return stop
        if not self._tell_pushed() and target >= self.cell.gripper.fraction_closed(self.cell.cube_size):
            self._record("missed", "", None, "the jaws closed on nothing")
        return stop

    def _open(self, T_base_tool: Array, target: float) -> float:
        self.catch_up()
        index = self._carried
        T_released = None if index is None else self._cubes[index].T_base_cube
        stop = self._move_jaws(T_base_tool, target)
        self._settle(T_base_tool)
        self._read_poses()
        self._tell_pushed()
        if index is not None and not self._physics.gripped(self._cubes[index].name):
            cube = self._cubes[index]
            found = resting(cube.T_base_cube, cube.size, self.world.boards, self.cell.table_z)
            self._record(found.what, cube.name, T_released, found.detail)
            self._cubes[index] = replace(cube, where=found.where, T_tool_cube=None)
            self._carried, self._told[index] = None, cube.T_base_cube
        return stop

    def jaws_now(self, counts: tuple[int, ...], adc: int) -> int:
        """Where jaws that stopped at `adc` are now (`driver.emulator.unit.plant.ContactPlant`)."""
        with self._lock:
            if self._carried is None:
                return adc
            self.catch_up()
            self._opening = self._physics.opening
            return self.cell.unit.gripper.adc(self.cell.gripper.fraction_closed(self._opening))

    def pushed_back(self, counts: tuple[int, ...]) -> tuple[int, ...]:
        """How far contact holds each axis from `counts`, as its encoder reads it."""
        share = self.world.contact.servo_share
        if not share or self._away:
            return (0,) * len(counts)
        with self._lock:
            self.catch_up()
            twist = self._physics.pushed_back()
            if norm(twist[:3]) < LEAST_PUSH:  # the hand lags behind an arm that speeds up
                return (0,) * len(counts)
            J = self._robot.jacobian(self.positions(counts))
            q = np.linalg.lstsq(J, share * twist, rcond=SINGULAR)[0]
            return tuple(int(c) for c in np.round(q * self.cell.nominal_unit.counts_per_rad))

    @property
    def simulated_steps(self) -> int:
        """Number of steps of physics so far."""
        return self._physics.steps

    @property
    def _holding(self) -> int | None:
        held = [i for i, c in enumerate(self._cubes) if c.where == "jaws"]
        return held[0] if held else None

    def _move_jaws(self, T_base_tool: Array, target: float) -> float:
        """Move the jaws towards a fraction of their stroke; return the one where they stop."""
        gripper = self.cell.gripper
        if self._away:
            self._physics.put_hand(T_base_tool)
        stop = gripper.fraction_closed(self._physics.move_jaws(gripper.width(target), T_base_tool))
        return target if abs(gripper.width(stop) - gripper.width(target)) < 1e-4 else stop

    def _settle(self, T_base_tool: Array) -> None:
        for _ in range(round(1e3 * SETTLE_S / NODE_MS)):
            if self._physics.at_rest:
                break
            self._physics.follow(T_base_tool, NODE_STEPS)

    def _shift(self, board: TrueBoard, T_shift: Array) -> None:
        on_it = [self._cubes[number].name for number in cubes_on(board, self._cubes)]
        super()._shift(board, T_shift)
        self._physics.shift([plate_name(board.board.name), *on_it], T_shift)
        self._told = [
            c.T_base_cube if c.name in on_it else T for c, T in zip(self._cubes, self._told, strict=True)
        ]

    def _read_poses(self) -> None:
        """Take over where cubes and boards are, unless nothing was simulated."""
        if self._physics.steps == self._read:
            return
        self._read = self._physics.steps
        for index, cube in enumerate(self._cubes):
            self._cubes[index] = replace(cube, T_base_cube=frozen(self._physics.pose(cube.name)))
        boards = tuple(
            replace(b, T_base_board=frozen(self._physics.pose(plate_name(b.board.name))))
            for b in self.world.boards
        )
        self.world = replace(self.world, boards=boards)

    def catch_up(self) -> None:
        """Simulate the arm's motion up to the present."""
        with self._lock:
            self._play()

    def _play(self) -> None:
        samples, physics = self.record(self._track.at_ms), self._physics
        last_ms = int(samples.time_ms[-1]) if len(samples.time_ms) else 0
        now_ms = max(self.now_ms(), last_ms)
        arrived = None if now_ms == last_ms else np.sum(self._joint_errors.of_arrival(self.arrival()), axis=0)
        for T in self._track.new_poses(samples, now_ms, arrived):
            if T is self._tool and (self._away or (physics.at_rest and physics.hand_still)):
                continue
            self._tool = T
            if self._away:
                if not self._is_near(T):
                    continue
                physics.put_hand(T)
                self._away = False
            physics.follow(T, NODE_STEPS)
            if self._holding is not None:
                self._watch(self._holding)
            elif physics.at_rest and not self._is_near(T):
                self._away = True
        self._read_poses()
        self._tell_pushed()

    def _tell_pushed(self) -> bool:
        """Record the cubes that moved without being carried; return whether there were any."""
        pushed = False
        for index, (cube, before) in enumerate(zip(self._cubes, self._told, strict=True)):
            moved = norm(cube.T_base_cube[:3, 3] - before[:3, 3])
            if index != self._carried and moved > MOVED:
                self._record("pushed", cube.name, before, f"by {1e3 * moved:.1f} mm")
                self._told[index], pushed = cube.T_base_cube, True
        return pushed

    def _watch(self, index: int) -> None:
        """Notice that the held cube has slipped out of the jaws."""
        cube, T_base_cube = self._cubes[index], frozen(self._physics.pose(self._cubes[index].name))
        apart = norm(T_base_cube[:3, 3] - self._physics.pose("hand")[:3, 3])
        if apart > cube.size or self._physics.opening < cube.size - SLIPPED:
            self._record("lost", cube.name, T_base_cube, "it slipped out of the jaws")
            self._cubes[index] = replace(cube, where="pushed", T_base_cube=T_base_cube, T_tool_cube=None)

    def _true_tool(self, counts: npt.ArrayLike, arrived: Array, now_ms: int) -> Array:
        """True pose of the tool in motion, with errors between those of two arrivals."""
        read = self.cell.nominal_unit.positions(counts) + self.world.joint_offsets
        return self._robot.T_base_tool(read + self._joint_errors.steady(read, now_ms) + arrived)

    def _is_near(self, T_base_tool: Array) -> bool:
        """Whether the hand is within `NEAR` of a plate or a cube."""
        reach = NEAR + HAND_RADIUS
        centre = apply(T_base_tool, HAND_CENTRE)
        for b in self.world.boards:
            plate = b.board.plate
            from_plate = apply(inverse(b.T_base_board), centre) - plate.T_board_plate[:3, 3]
            if norm(np.maximum(np.abs(from_plate) - np.array(plate.size) / 2.0, 0.0)) < reach:
                return True
        return any(norm(c.T_base_cube[:3, 3] - centre) < reach + c.size * HALF_DIAGONAL for c in self._cubes)
