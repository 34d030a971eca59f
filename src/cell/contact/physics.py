"""The moving bodies of a cell in MuJoCo: step by step, the hand pulled to where the arm has its tool."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm.board import plate_name
from arm.errors import A465Error
from arm.numerics.products import mul
from arm.robot.model import Robot
from arm.robot.shapes import Body
from arm.se3 import Array, transform
from cell.contact.model import HAND_INERTIA, HAND_MASS, STEP_S, Builder, load_mujoco
from cell.files.world import TrueBoard
from cell.files.world_errors import ContactKeys
from cell.sim.cubes import SimulatedCube

JAW_SPEED = 0.12  # m/s of the opening
STILL_JAWS = 5e-4  # m/s
STILL_STEPS = 15  # in a row, for which jaws must be still
MOST_CLOSING_S = 2.0
LEVER = 0.1  # m: the hand's stiffness against rotation is that against force at this distance


def _ignored(_: str) -> None:
    """What MuJoCo warns of stays in its counters."""


class Physics:
    """Cubes, plates and hand of a cell.

    Args:
        still: bodies that never move.
        boards: true boards.
        cubes: true cubes.
        robot: the true arm with its jaws at `opening` m.
        opening: of the jaws at the start, m.
        keys: physical constants.

    Attributes:
        steps: number of steps so far.

    Raises:
        InputError: MuJoCo is not installed.
    """

    def __init__(
        self,
        still: Sequence[Body],
        boards: Sequence[TrueBoard],
        cubes: Sequence[SimulatedCube],
        robot: Robot,
        opening: float,
        keys: ContactKeys,
    ) -> None:
        self._mj = load_mujoco()
        self._mj.set_mju_user_warning(_ignored)  # else it writes a file here; `follow` raises instead
        builder = Builder(self._mj, keys)
        builder.add_still(still)
        for board in boards:
            builder.add_plate(plate_name(board.board.name), board)
        for cube in cubes:
            builder.add_cube(cube)
        builder.add_hand(robot, opening)
        self._model = builder.spec.compile()
        self._data = self._mj.MjData(self._model)
        self._hand = int(self._model.body("hand").id)
        self._trees = [i for i in range(self._model.ntree) if i != self._model.body_treeid[self._hand]]
        joints = [self._model.joint(j) for j in range(self._model.njnt)]
        self._free = int(self._model.body("hand").jntadr[0])
        self._at = int(joints[self._free].qposadr[0])
        self._moves = int(joints[self._free].dofadr[0])
        self._jaws = [int(j.qposadr[0]) for j in joints if j.name.startswith("finger")]
        self._geoms = {self._model.geom(i).name: i for i in range(self._model.ngeom)}
        self._fingers = [self._geoms[j.name] for j in joints if j.name.startswith("finger")]
        stiffness, turning = keys.hand_stiffness, keys.hand_stiffness * LEVER**2
        self._pull = stiffness, 2.0 * np.sqrt(stiffness * HAND_MASS)
        self._turn = turning, 2.0 * np.sqrt(turning * HAND_INERTIA)
        self._target: tuple[Array, Array] | None = None
        self.steps = 0
        self._data.ctrl[0] = opening
        self._data.qpos[self._jaws] = opening / 2.0
        self._mj.mj_forward(self._model, self._data)

    @property
    def opening(self) -> float:
        """Distance of the fingers, m."""
        return float(self._data.qpos[self._jaws].sum())

    @property
    def at_rest(self) -> bool:
        """Whether cubes and plates sleep."""
        return bool((self._data.tree_asleep[self._trees] >= 0).all())

    @property
    def hand_still(self) -> bool:
        """Whether the hand rests."""
        return bool(np.abs(self._data.qvel[self._moves : self._moves + 6]).max() < 1e-4)

    def pose(self, name: str) -> Array:
        """Present pose of a cube, a plate (its board's frame) or the hand (its tool's)."""
        body = self._data.body(name)
        return transform(body.xmat.reshape(3, 3), body.xpos)

    def pushed_back(self) -> Array:
        """How far contact holds the hand from where it is pulled: twist (6,) in m and rad, in the hand's axes."""
        twist, data = np.zeros(6), self._data
        if self._target is not None:
            position, quat = data.qpos[self._at : self._at + 3], data.qpos[self._at + 3 : self._at + 7]
            hand = np.zeros(9)
            self._mj.mju_quat2Mat(hand, self._target[1])
            twist[:3] = mul(hand.reshape(3, 3).T, position - self._target[0])
            self._mj.mju_subQuat(twist[3:], quat, self._target[1])
        return twist

    def shift(self, names: Sequence[str], T_shift: Array) -> None:
        """Move bodies by T_shift (4, 4) in the base frame; they are at rest then."""
        for name in names:
            body = self._model.body(name)
            at, moves = (
                int(of[int(body.jntadr[0])]) for of in (self._model.jnt_qposadr, self._model.jnt_dofadr)
            )
            position, quat = self._pose(mul(T_shift, self.pose(name)))
            self._data.qpos[at : at + 3], self._data.qpos[at + 3 : at + 7] = position, quat
            self._data.qvel[moves : moves + 6] = 0.0
        self._mj.mj_forward(self._model, self._data)

    def gripped(self, cube: str) -> bool:
        """Whether both fingers touch a cube."""
        pairs, index = self._data.contact.geom, self._geoms[cube]
        mine = pairs[(pairs == index).any(axis=1)]
        return all(bool((mine == finger).any()) for finger in self._fingers)

    def put_hand(self, T_base_hand: Array) -> None:
        """Put the hand somewhere, at rest."""
        at, moves = self._at, self._moves
        self._target = position, quat = self._pose(T_base_hand)
        self._data.qpos[at : at + 3], self._data.qpos[at + 3 : at + 7] = position, quat
        self._data.qvel[moves : moves + 6] = 0.0
        self._mj.mj_forward(self._model, self._data)

    def follow(self, T_base_hand: Array, steps: int) -> None:
        """Take some steps of `STEP_S` while what pulls the hand, by springs and dampers, moves to a pose.

        Raises:
            A465Error: the simulation became unstable.
        """
        mj, data, at = self._mj, self._data, self._at
        target = self._pose(T_base_hand)
        begin = self._target or target
        self._target = target
        way, turn, off = target[0] - begin[0], np.zeros(3), np.zeros(3)
        mj.mju_subQuat(turn, target[1], begin[1])
        velocity, rate = way / (steps * STEP_S), turn / (steps * STEP_S)
        (k, c), (k_turn, c_turn) = self._pull, self._turn
        now, quat = begin[0].copy(), begin[1].copy()
        force, position = data.qfrc_applied[self._moves : self._moves + 6], data.qpos[at : at + 3]
        turned, speed = data.qpos[at + 3 : at + 7], data.qvel[self._moves : self._moves + 6]
        for _ in range(steps):
            now += velocity * STEP_S
            mj.mju_quatIntegrate(quat, rate, STEP_S)
            mj.mju_subQuat(off, quat, turned)
            force[:3] = k * (now - position) + c * (velocity - speed[:3])
            force[3:] = k_turn * off + c_turn * (rate - speed[3:])
            mj.mj_step(self._model, data)
        self.steps += steps
        if data.warning.number.any():
            why = f"contact physics became unstable after {1e3 * data.time:.0f} ms of simulation; no result is valid"
            raise A465Error(f"{why}: change [contact] of the world file", steps=self.steps)

    def move_jaws(self, opening: float, T_base_hand: Array) -> float:
        """Move the jaws towards an opening, m, until they stop; return where they do."""
        ramp, still, left = self.opening, 0, round(MOST_CLOSING_S / STEP_S)
        while still < STILL_STEPS and left:
            ramp += float(np.clip(opening - ramp, -JAW_SPEED * STEP_S, JAW_SPEED * STEP_S))
            self._data.ctrl[0] = ramp
            before = self.opening
            self.follow(T_base_hand, 1)
            left -= 1
            moved = abs(self.opening - before) > STILL_JAWS * STEP_S
            still = 0 if moved or ramp != opening else still + 1
        return self.opening

    def _pose(self, T: Array) -> tuple[Array, Array]:
        quat = np.zeros(4)
        self._mj.mju_mat2Quat(quat, np.ascontiguousarray(T[:3, :3]).ravel())
        return T[:3, 3], quat
