"""A planned list of poses: its moves and pauses in order of time, and what can be asked of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from arm.controller.unit import Unit
from arm.errors import InputError
from arm.plan_file import Move, Pause, Step, duration_of
from arm.robot.model import Robot
from arm.se3 import Array, frozen
from plan.trajectory.virtual_unit import is_virtual


@dataclass(frozen=True, eq=False)
class Reached:
    """The arm at a target, as whole counts give it.

    Attributes:
        target: its name.
        q: (n,) rad.
        T_base_tool: (4, 4).
        branch: of the first target that it hangs on by lines; "" where the arm has none.
    """

    target: str
    q: Array
    T_base_tool: Array
    branch: str


@dataclass(frozen=True, eq=False)
class PosePlan:
    """What `plan.program.pose_lists.plan_poses` returns. Every move is certified: its `clearance` is proved
    over all of it.

    Attributes:
        robot: the arm.
        unit: whose counts the moves are in; `plan.trajectory.virtual_unit.virtual_unit` where no controller was given.
        q_start: (n,) rad.
        steps: moves (`arm.plan_file.Move`) and pauses, in order. Moves with no pause between them may meet at speed.
        reached: every target.
        lower_bound_s: no motion through the solutions that were looked at is faster, whatever its ways.
        candidates: solutions looked at, per place: the start, each group of targets, the end.
        detours: ways around that were made.
        stopped: why the search ended before the fastest way was known, for people; "" if it is known.
    """

    robot: Robot
    unit: Unit
    q_start: Array
    steps: tuple[Step, ...]
    reached: tuple[Reached, ...]
    lower_bound_s: float
    candidates: tuple[int, ...]
    detours: int
    stopped: str = ""

    @property
    def moves(self) -> tuple[Move, ...]:
        """Its moves in order."""
        return tuple(step for step in self.steps if isinstance(step, Move))

    @property
    def duration_s(self) -> float:
        """With pauses, s."""
        return sum(map(duration_of, self.steps))

    @property
    def gap(self) -> float:
        """How much longer it takes than `lower_bound_s`, as a part of it."""
        return self.duration_s / self.lower_bound_s - 1.0 if self.lower_bound_s > 0.0 else float("inf")

    @property
    def clearance(self) -> float:
        """Of all moves, m; infinite where nothing can touch."""
        return min((move.clearance for move in self.moves), default=float("inf"))

    def begins(self) -> tuple[float, ...]:
        """Time at which each step begins, s."""
        lengths = [duration_of(step) for step in self.steps]
        return tuple(np.concatenate([[0.0], np.cumsum(lengths)])[:-1].tolist())

    def at(self, times: npt.ArrayLike) -> Array:
        """Configurations (m, n) rad at times (m,) s from the start, clamped to the plan."""
        t = np.atleast_1d(np.asarray(times, dtype=float))
        q = np.tile(self.q_start, (len(t), 1))
        for step, begin in zip(self.steps, self.begins(), strict=True):
            rows = t >= begin
            if isinstance(step, Move) and rows.any():
                q[rows] = self.unit.positions(step.path.at(t[rows] - begin))
        return q

    def sample(self, step_s: float = 0.01) -> tuple[Array, Array]:
        """Times (m,) s on a regular grid, the end included, and configurations (m, n) rad.

        Raises:
            InputError: the step is not positive.
        """
        if not step_s > 0.0:
            raise InputError(f"step = {step_s:g} s: must be positive", value=step_s)
        end = self.duration_s
        times = np.append(np.arange(0.0, end - 1e-9, step_s), end)
        return frozen(times), frozen(self.at(times))

    def cubics(self) -> Iterator[tuple[Move, Array, Array]]:
        """Per move its durations (k,) s and coefficients (k, 4, n) of q = sum of c_i u^i, u from 0 to 1, rad."""
        for move in self.moves:
            knots = move.path.knots()
            c = np.zeros((len(move.path.segments), 4, knots.shape[1]))
            for k, segment in enumerate(move.path.segments):
                c[k, 0] = self.unit.positions(knots[k])
                rows = np.array(segment.coefficients, dtype=float)
                c[k, 1 : 1 + len(rows)] = rows / self.unit.counts_per_rad
            yield move, np.array([s.duration_ms / 1e3 for s in move.path.segments]), c

    def rows(self, step_s: float = 0.01) -> Iterator[list[str | float]]:
        """Rows of a CSV file: a header, then time in s and joint positions in rad (m)."""
        yield ["time_s", *self.robot.joint_names]
        times, q = self.sample(step_s)
        for t, row in zip(times.tolist(), q.tolist(), strict=True):
            yield [round(t, 6), *(round(x, 9) for x in row)]

    def to_json(self) -> dict[str, Any]:
        """All of it as JSON types: cubic segments in rad with their proved clearances, pauses, targets."""
        cubics = {id(move): (durations, c) for move, durations, c in self.cubics()}
        steps: list[dict[str, Any]] = []
        for step in self.steps:
            if isinstance(step, Pause):
                steps.append(
                    {
                        "pause": step.name,
                        "dwell_s": step.dwell_s,
                        "attached": step.attached,
                        "detached": step.detached,
                    }
                )
            if not isinstance(step, Move):
                continue
            durations, c = cubics[id(step)]
            steps.append(
                {
                    "move": step.name,
                    "role": step.role,
                    "held": step.held,
                    "clearance_m": step.clearance if np.isfinite(step.clearance) else None,
                    "closest": list(step.closest),
                    "segments": [
                        {"duration_s": float(d), "coefficients_rad": np.round(rows, 12).tolist()}
                        for d, rows in zip(durations, c, strict=True)
                    ],
                }
            )
        return {
            "format": "a465-poses/1",
            "robot": self.robot.digest,
            "joints": list(self.robot.joint_names),
            "counts": None if is_virtual(self.unit) else self.unit.name,
            "duration_s": self.duration_s,
            "lower_bound_s": self.lower_bound_s,
            "targets": [
                {"name": r.target, "q": r.q.tolist(), "T_base_tool": np.round(r.T_base_tool, 12).tolist()}
                for r in self.reached
            ],
            "steps": steps,
            **({"stopped": self.stopped} if self.stopped else {}),
        }
