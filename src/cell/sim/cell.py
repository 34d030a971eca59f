"""The simulated cell: ground truth of cubes, boards and jaws, with a synthetic camera.

It is the plant of the emulated controller, and the source of images. Planning never reads it. Only the report does: it
compares each released cube with its target.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from arm.board import CAPTURE_TILT, seat_depth
from arm.former import former_names
from arm.numerics.products import mul, norm
from arm.robot.dh import A465
from arm.robot.link_errors import with_link_errors
from arm.robot.model import Robot
from arm.robot.shapes import Body
from arm.robot.tool import FixedTool
from arm.se3 import Array, apply, frozen, inverse, rot_z, transform
from cell.config.cell import Cell
from cell.files.hand_target import HandTarget
from cell.files.world import TrueBoard, World
from cell.scene.bodies import T_hole_cube, cube_body, plate_body, stand_body
from cell.sim.arm import Arrival, JointErrors
from cell.sim.cubes import SimulatedCube, shifting_after, with_shifted
from cell.sim.grip import angle_to_jaws, between_jaws
from cell.sim.made import cube_sizes, made_board, target_print, true_tool
from cell.sim.release_faults import PUSH, T_hole_released
from cell.sim.touches import Touches, TouchJudge, TrueWire
from driver.emulator.unit.record import Record, no_record
from plan.kinematics.product_of_exponentials import product_of_exponentials
from render.light import Light
from render.target import TargetSolid

GRIP_OFFSET = 3e-3  # largest offset between jaws and cube in a grip, m
GRIP_ANGLE = np.radians(3.0)  # largest angle between the jaws' travel and a cube's face in a grip
LEAST_GRIP = 5e-3  # least depth of the finger tips below the cube's top in a grip, m
DROP = 0.010  # largest height, m, from which a released cube lands upright
UPRIGHT = np.radians(4.0)  # a cube that is set down on a flat place with more tilt falls over


@dataclass(frozen=True)
class CellEvent:
    """An event of a cube.

    Attributes:
        what: gripped, pushed, missed, placed or unseated in a pocket, set down, fallen; with contact physics also lost.
        cube: its name, or "" if the jaws found none.
        T_base_cube: pose of its centre at the event.
        message: one line for people.
    """

    what: str
    cube: str
    T_base_cube: Array | None
    message: str


@dataclass(frozen=True)
class CellState:
    """Cubes and jaws from a time until the next state; a held cube moves with the tool.

    Attributes:
        time_ms: emulated time.
        cubes: all of them.
        jaw_opening: distance of the fingers, m.
    """

    time_ms: int
    cubes: tuple[SimulatedCube, ...]
    jaw_opening: float


class SimulatedCell:
    """Ground truth, changed by the jaws. Thread-safe: used by the threads of controller and camera.

    Args:
        cell: the user's data (sizes, fixed bodies, nominal arm).
        world: ground truth.
        work: bodies on the workpiece of a program, where it truly is.
        wires: those of them that a ring is threaded on.

    Attributes:
        tool: as it truly is on the flange.
        in_hand: calibration target in the gripper, or None.
        events: of cubes, in order.
        history: states, in order, to judge a run afterwards.
        now_ms: returns the emulated time; set by the owner of the controller.
        arrival: returns how the arm came to where it is; see `follow`.
        record: returns where the arm was since a time in ms; set by the owner of the controller.
    """

    kind = "the simulated cell"

    def __init__(
        self, cell: Cell, world: World, work: Sequence[Body] = (), wires: Sequence[TrueWire] = ()
    ) -> None:
        self.cell, self.tool = cell, true_tool(cell, world)
        self.work, self._wires = tuple(work), tuple(wires)
        pocket = cell.boards[0].pocket  # one for all boards of a cell file
        boards = tuple(made_board(world, b, pocket) for b in world.boards)
        self.world = replace(world, boards=boards)
        self.in_hand: HandTarget | None = None
        self.events: list[CellEvent] = []
        self.now_ms: Callable[[], int] = lambda: 0
        self.arrival: Callable[[], Arrival] = Arrival
        self.record: Callable[[int], Record] = no_record
        self._grasps = 0  # that held a cube
        self._judged: tuple[int, tuple[Touches, ...]] = (-1, ())  # up to which sample, and what was found
        self._joint_errors = JointErrors(world)
        self._lock = threading.RLock()
        self._robot = self.true_robot(cell.jaw_opening)
        self._opening = cell.jaw_opening
        self._release_faults, self._grasp_faults = list(world.releases), list(world.grasps)
        places = [(b, hole) for b in boards for hole in b.cubes]
        self._cubes = [
            SimulatedCube(f"cube {n}", _seated(b, hole, size), "pocket", size)
            for n, ((b, hole), size) in enumerate(
                zip(places, cube_sizes(world, len(places), cell.cube_size), strict=True), start=1
            )
        ]
        self.history = [CellState(0, tuple(self._cubes), self._opening)]

    def cubes(self, counts: npt.ArrayLike) -> list[SimulatedCube]:
        """The present cubes, a held one at its pose with the arm at `counts`."""
        with self._lock:
            T_base_tool = self.T_base_tool(counts)
            return [
                c
                if c.T_tool_cube is None
                else replace(c, T_base_cube=frozen(mul(T_base_tool, c.T_tool_cube)))
                for c in self._cubes
            ]

    def catch_up(self) -> None:
        """Bring the truth up to the present: here nothing moves but the arm, and the jaws when they are told to."""

    def hold(self, hand: HandTarget) -> None:
        """Put a target into the gripper, with the mounting error of a person."""
        self.in_hand = hand.roughly_mounted(self.world.seed)

    def follow(self, last_motion: Callable[[], tuple[int, tuple[int, ...]]]) -> None:
        """Take arrivals from a unit; `last_motion` returns the ms of the arm's last motion and its signs in counts."""
        senses = np.sign(self.cell.nominal_unit.counts_per_rad)

        def arrival() -> Arrival:
            time_ms, signs = last_motion()
            return Arrival(
                time_ms, tuple(int(sign * sense) for sign, sense in zip(signs, senses, strict=True))
            )

        self.arrival = arrival

    def true_robot(self, jaw_opening: float) -> Robot:
        """The true arm, jaws at an opening in m."""
        tool = self.tool
        nominal = tool.robot() if isinstance(tool, FixedTool) else tool.robot(jaw_opening)
        return with_link_errors(nominal, A465, self.world.links)

    def positions(self, counts: npt.ArrayLike) -> Array:
        """True joint positions at encoder counts, (6,) rad."""
        read = self.cell.nominal_unit.positions(counts) + self.world.joint_offsets
        errors = self._joint_errors
        arrival = self.arrival() if errors.depends_on_arrival else Arrival()
        return np.asarray(read + errors.at(read, arrival, self.now_ms()))

    def T_base_tool(self, counts: npt.ArrayLike) -> Array:
        """True pose of the tool at encoder counts."""
        return self._robot.T_base_tool(self.positions(counts))

    def touches(self) -> tuple[Touches, ...]:
        """Return what a graded run would have recorded until now, for each wire that a ring is threaded on."""
        tool, record = self.tool, self.record(-1)
        if not isinstance(tool, FixedTool) or not self._wires:
            return ()
        if len(record.time_ms) == self._judged[0]:
            return self._judged[1]
        q = self.cell.nominal_unit.positions(record.counts) + self.world.joint_offsets
        q += self._joint_errors.along(q, record.time_ms)
        T_base_tool = product_of_exponentials(self._robot).tool_poses(q)
        ring = None if self.world.tool.ring is None else self.world.tool.ring.tolist()
        judges = [TouchJudge(tool, ring, wire) for wire in self._wires]
        touches = tuple(judge.judged(T_base_tool, record.time_ms) for judge in judges)
        self._judged = len(record.time_ms), touches
        return touches

    def targets(self, counts: npt.ArrayLike) -> list[TargetSolid]:
        """Calibration targets with the arm at `counts`."""
        if self.in_hand is None:
            return []
        T_base_flange = mul(self.T_base_tool(counts), inverse(self._robot.T_end_tool))
        T_base_target = mul(T_base_flange, self.in_hand.T_flange_target)
        return [TargetSolid(self.in_hand.target, T_base_target, Light(), how=target_print(self.world))]

    def bodies(self, counts: npt.ArrayLike, robot: Robot) -> list[Body]:
        """All visible bodies with the arm at `counts`."""
        self.catch_up()
        found = [*self.cell.fixed, *self.work]
        for b in self.world.boards:
            found.append(plate_body(b.board.name, b.T_base_board, b.board.plate))
            footprint = b.stand or self.cell.stand_size
            stand = stand_body(
                b.board.name, b.T_base_board, footprint, self.cell.table_z, plate=b.board.plate
            )
            found += [stand] if stand else []
        found += [cube_body(c.name, c.size, c.T_base_cube) for c in self.cubes(counts)]
        return found + robot.bodies_at(self.positions(counts))

    def jaws(self, counts: tuple[int, ...], from_adc: int, to_adc: int) -> int:
        """Move the jaws from one ADC position towards another; return where they stop (`driver.emulator.Plant`)."""
        gripper = self.cell.unit.gripper
        if not gripper.fitted:
            return to_adc
        with self._lock:
            T_base_tool = self.T_base_tool(counts)
            before, target = (min(max(gripper.fraction_closed(a), 0.0), 1.0) for a in (from_adc, to_adc))
            stop = self._close(T_base_tool, target) if target > before else self._open(T_base_tool, target)
            self._opening = self.cell.gripper.width(stop)
            self.history.append(CellState(self.now_ms(), tuple(self._cubes), self._opening))
            return gripper.adc(stop)

    @property
    def jaw_opening(self) -> float:
        """Present distance of the fingers, m."""
        return self._opening

    def _close(self, T_base_tool: Array, target: float) -> float:
        for cube in self._cubes:
            if cube.T_tool_cube is not None:
                return min(target, self.cell.gripper.fraction_closed(cube.size))
        for index, cube in enumerate(self._cubes):
            on_cube = self.cell.gripper.fraction_closed(cube.size)
            if target < on_cube:
                continue
            T_tool_cube = mul(inverse(T_base_tool), cube.T_base_cube)
            x, y, z = T_tool_cube[:3, 3]
            if max(abs(x), abs(y)) > self.cell.gripper.opening / 2.0 or abs(z) > cube.size:
                continue
            depth = cube.size / 2.0 - z  # of the tips below the cube's top
            offset, angle = float(np.hypot(x, y)), angle_to_jaws(T_tool_cube[:3, :3])
            if offset <= GRIP_OFFSET and angle <= GRIP_ANGLE and depth >= LEAST_GRIP:
                fault = self._grasp_faults.pop(0) if self._grasp_faults and cube.where == "pocket" else "held"
                if fault != "held":
                    self._cubes[index] = self._not_held(fault, cube)
                    return target
                held = between_jaws(T_tool_cube)
                self._cubes[index] = replace(cube, where="jaws", T_tool_cube=held)
                detail = f"{1e3 * offset:.2f} mm off the jaws' axis"
                self._record("gripped", cube.name, cube.T_base_cube, detail)
                return on_cube
            if depth >= 0.0:
                self._cubes[index] = replace(cube, where="pushed")
                detail = f"{1e3 * offset:.1f} mm and {np.degrees(angle):.1f} deg off the jaws, "
                detail += f"tips {1e3 * depth:.1f} mm below its top"
                self._record("pushed", cube.name, cube.T_base_cube, detail)
                return target
        if target >= self.cell.gripper.fraction_closed(self.cell.cube_size):
            self._record("missed", "", None, "the jaws closed on nothing")
        return target

    def _not_held(self, fault: str, cube: SimulatedCube) -> SimulatedCube:
        """The cube after a grasp with a fault of the world file."""
        if fault == "missed":
            self._record(
                "missed", cube.name, cube.T_base_cube, "the jaws did not hold it; it stays in its pocket"
            )
            return cube
        b, hole = min(
            ((b, hole) for b in self.world.boards for hole in range(len(b.board.holes))),
            key=lambda at: norm(_seated(at[0], at[1], cube.size)[:3, 3] - cube.T_base_cube[:3, 3]),
        )
        where = self.T_base_left(fault, b, hole, cube.size)
        self._record("pushed", cube.name, where, f"{fault}, the jaws did not hold it")
        return replace(cube, T_base_cube=where)

    def T_base_left(self, fault: str, b: TrueBoard, hole: int, size: float) -> Array:
        """Pose of a cube of edge `size` m that a fault leaves at a hole."""
        T_base_hole = mul(b.T_base_board, b.board.T_board_hole(hole))
        return frozen(mul(T_base_hole, T_hole_released(fault, size, seat_depth(size, b.board.pocket))))

    def _open(self, T_base_tool: Array, target: float) -> float:
        for index, cube in enumerate(self._cubes):
            if cube.T_tool_cube is not None and target < self.cell.gripper.fraction_closed(cube.size):
                self._cubes[index] = self._released(cube, frozen(mul(T_base_tool, cube.T_tool_cube)))
        return target

    def _released(self, cube: SimulatedCube, T_base_cube: Array) -> SimulatedCube:
        name, half = cube.name, cube.size / 2.0
        for b in self.world.boards:
            for hole in range(len(b.board.holes)):
                T_base_hole = mul(b.T_base_board, b.board.T_board_hole(hole))
                T_hole_cube_now = mul(inverse(T_base_hole), T_base_cube)
                x, y, z = T_hole_cube_now[:3, 3]
                tilt = float(np.arccos(np.clip(T_hole_cube_now[2, 2], -1.0, 1.0)))
                sides, capture = max(abs(x), abs(y)), (b.board.pocket[0] - cube.size) / 2.0
                if sides <= capture and tilt <= CAPTURE_TILT and abs(z - half) <= 2 * DROP:
                    quarter = np.round(np.arctan2(T_hole_cube_now[1, 0], T_hole_cube_now[0, 0]) / (np.pi / 2))
                    turned = transform(rot_z(quarter * np.pi / 2))
                    seat = frozen(mul(_seated(b, hole, cube.size), turned))
                    into = f"into {b.board.name}/{hole + 1}, {1e3 * sides:.2f} mm off its axis"
                    fault = self._release_faults.pop(0) if self._release_faults else "seated"
                    if fault != "seated":
                        return self._unseated(fault, cube, T_base_cube, b, hole, into)
                    self._record("placed", name, T_base_cube, into)
                    return SimulatedCube(name, seat, "pocket", cube.size)
        beside = self._on_plate(cube, T_base_cube)
        if beside is not None:
            return beside
        bottom = float(apply(T_base_cube, (0.0, 0.0, -half))[2]) - self.cell.table_z
        upright = T_base_cube[2, 2] > np.cos(UPRIGHT)
        if upright and -1e-3 <= bottom <= DROP and not self._over_plate(T_base_cube):
            yaw = float(np.arctan2(T_base_cube[1, 0], T_base_cube[0, 0]))
            x, y = T_base_cube[:2, 3]
            self._record("set down", name, T_base_cube, f"on the table from {1e3 * bottom:.1f} mm")
            return SimulatedCube(
                name, transform(rot_z(yaw), (x, y, self.cell.table_z + half)), "table", cube.size
            )
        self._record("fallen", name, T_base_cube, f"{1e3 * bottom:.0f} mm above the table, over no free hole")
        return SimulatedCube(name, T_base_cube, "fallen", cube.size)

    def _on_plate(self, cube: SimulatedCube, T_base_cube: Array) -> SimulatedCube | None:
        """The cube after a release over a plate, but beside its pockets: flat on the plate; None elsewhere.

        A real one may also lean into a pocket.
        """
        half = cube.size / 2.0
        for b in self.world.boards:
            T = mul(inverse(b.T_base_board), T_base_cube)
            over = (b.board.plate.edge_distances(T[:3, 3]) > 0.0).all()
            if over and T[2, 2] > np.cos(UPRIGHT) and abs(T[2, 3] - half) <= DROP:
                yaw = float(np.arctan2(T[1, 0], T[0, 0]))
                flat = mul(b.T_base_board, transform(rot_z(yaw), (*T[:2, 3], half)))
                self._record(
                    "unseated", cube.name, T_base_cube, f"flat on board {b.board.name}, over no free hole"
                )
                return SimulatedCube(cube.name, frozen(flat), "pocket", cube.size)
        return None

    def _unseated(
        self, fault: str, cube: SimulatedCube, T_base_cube: Array, b: TrueBoard, hole: int, into: str
    ) -> SimulatedCube:
        """The cube after a release with a fault of the world file; a pushed board moves with its cubes."""
        name, where = cube.name, self.T_base_left(fault, b, hole, cube.size)
        self._record("placed" if fault == "pushed" else "unseated", name, T_base_cube, f"{fault}, {into}")
        if fault == "pushed":
            push = transform(t=PUSH)
            self._shift(b, push)
            where = frozen(mul(push, where))
        return SimulatedCube(name, where, "pocket", cube.size)

    def _shift(self, board: TrueBoard, T_shift: Array) -> None:
        """Move a board in the base frame, with the cubes that rest on it."""
        self.world, self._cubes = with_shifted(self.world, self._cubes, board, T_shift)

    def _over_plate(self, T_base_cube: Array) -> bool:
        return any(
            bool(
                (b.board.plate.edge_distances(apply(inverse(b.T_base_board), T_base_cube[:3, 3])) > 0.0).all()
            )
            for b in self.world.boards
        )

    def _record(self, what: str, cube: str, T_base_cube: Array | None, detail: str) -> None:
        self.events.append(CellEvent(what, cube, T_base_cube, f"{cube or 'no cube'} {what}: {detail}"))
        if what == "gripped":
            self._grasps += 1
            for board in shifting_after(self.world, self._grasps):
                self._shift(board, board.T_shift)


def _seated(board: TrueBoard, hole: int, size: float) -> Array:
    """Pose of a cube of edge `size` m that is seated in a hole."""
    T_base_hole = mul(board.T_base_board, board.board.T_board_hole(hole))
    return frozen(mul(T_base_hole, T_hole_cube(size, seat_depth(size, board.board.pocket))))


former_names(__name__, "cell.sim.camera", "SimulatedCamera")
