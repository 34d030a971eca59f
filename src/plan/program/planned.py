"""A planned program: its steps in order of time, with samples, cubics and the plan for a file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from importlib.metadata import version
from typing import Any

import numpy as np
import numpy.typing as npt

from arm.controller.unit import Limits, Unit
from arm.errors import ImpossibleError, InputError
from arm.plan_file import Move, Pause, Plan, Step, duration_of
from arm.robot.model import Robot
from arm.se3 import Array, frozen
from plan.budget import BudgetSpent, PlanningInterrupted, budget_words
from plan.options import PlanOptions
from plan.program.goals.attachments import AttachmentState
from plan.program.setting import Setting
from plan.program.stated_arm import arm_to_json
from plan.scene import Scene
from plan.trajectory.virtual_unit import is_virtual

_LIBRARIES = ("pin", "coal", "numpy", "scipy")


@dataclass(frozen=True, eq=False)
class Reached:
    """The arm at a target, at whole counts.

    Attributes:
        target: name of the target.
        q: (n,) rad.
        T_base_tool: (4, 4).
        branch: inverse kinematics branch at the first target of its chain; "" if the arm has no closed form.
    """

    target: str
    q: Array
    T_base_tool: Array
    branch: str


@dataclass(frozen=True, eq=False)
class Planned:
    """A planned program. Every move is certified: its `clearance` is a lower bound over the whole move.

    Attributes:
        setting: arm, unit and limits of the planning.
        q_start, q_end: (n,) rad.
        steps: in order (`arm.plan_file.Step`). Moves with no other step between them may meet at speed.
        reached: the arm at every target, in order; none of transfers.
        lower_bound_s: no motion through the solutions considered is faster, whatever its paths.
        above_bound_s: excess of the motion over that bound by cause, s (`plan.program.assignment.search.Gap`, and
            ``sent``: blends and rounding); of transfers only.
        state: the attached body at the end, and the poses of moved bodies.
        cubes: ``cube``, ``from`` and ``to`` of each cube that is moved, in order.
        skipped: ``cube``, ``from`` and ``reason`` of each cube that is not moved.
        touching: allowed collisions of the lines.
        candidates: number of solutions considered: 1 for the start, then of each chain.
        detours: number of paths around obstacles that were planned.
        near_ends: ends of transits with less than the required clearance (`PlanOptions.near_ends`): ``at``, ``pair``
            and ``distance_mm`` of each.
        stopped: message on why the search ended before the fastest sequence was known; "" if it is known.
        interrupted: whether Ctrl-C ended the search.
        provenance, task: see `plan.program.program.Program`.
    """

    setting: Setting
    q_start: Array
    q_end: Array
    steps: tuple[Step, ...]
    reached: tuple[Reached, ...]
    lower_bound_s: float
    state: AttachmentState
    cubes: tuple[dict[str, str], ...] = ()
    above_bound_s: Mapping[str, float] = field(default_factory=dict)
    skipped: tuple[dict[str, str], ...] = ()
    touching: frozenset[frozenset[str]] = frozenset()
    candidates: tuple[int, ...] = ()
    detours: int = 0
    near_ends: tuple[dict[str, Any], ...] = ()
    stopped: str = ""
    interrupted: bool = False
    provenance: Mapping[str, Any] = field(default_factory=dict)
    task: Mapping[str, Any] = field(default_factory=dict)

    @property
    def robot(self) -> Robot:
        """The arm."""
        return self.setting.robot

    @property
    def unit(self) -> Unit:
        """The unit of the moves' counts; that of `plan.trajectory.virtual_unit` if no controller was given."""
        return self.setting.unit

    def plan(self) -> Plan:
        """Return the plan for a file, which can be previewed, exported and verified.

        Tasks and lists of poses of the cell's arm can be executed too (`plan.program.grammar`).

        Raises:
            ImpossibleError: nothing moves.
        """
        if not self.moves:
            raise ImpossibleError("nothing moves: every goal is where the arm stands", moves=0)
        setting = self.setting
        stated = dict(self.provenance)
        stated_task: dict[str, Any] = {"cubes": [dict(cube) for cube in self.cubes], **self.task}
        if self.cubes:
            stated_task["no_plan_is_faster_than_s"] = self.lower_bound_s
            stated_task["above_that_s"] = dict(self.above_bound_s)
        skipped = [*stated_task.pop("skipped", ()), *map(dict, self.skipped)]
        if skipped:
            stated_task["skipped"] = skipped
        notes = stated.pop("notes", {})
        if self.stopped:
            notes = {**notes, "search": self.stopped}
        if self.near_ends:
            notes = {**notes, "near_ends": [dict(near) for near in self.near_ends]}
        scene = setting.scene.allowing(setting.scene.allowed | self.touching)
        registers = _registers(setting.unit, setting.limits)
        return Plan(
            task=stated_task,
            unit=setting.unit.name,
            speed=setting.options.speed,
            speed_registers=registers["speed"],
            acceleration_registers=registers["acceleration"],
            steps=self.steps,
            provenance={**stated, **resting_on(scene, setting.unit, setting.options)},
            scene=scene.to_json(),
            notes={**notes, "versions": dict(_versions())},
            arm=arm_to_json(scene, setting.limits) if is_virtual(setting.unit) else {},
        )

    @property
    def moves(self) -> tuple[Move, ...]:
        """Its moves in order."""
        return tuple(step for step in self.steps if isinstance(step, Move))

    @property
    def duration_s(self) -> float:
        """Duration with pauses, s."""
        return sum(map(duration_of, self.steps))

    @property
    def gap(self) -> float:
        """Relative excess of the duration over `lower_bound_s`."""
        return self.duration_s / self.lower_bound_s - 1.0 if self.lower_bound_s > 0.0 else float("inf")

    @property
    def clearance(self) -> float:
        """Least clearance of all moves, m; infinite if no pair of bodies is checked."""
        return min((move.clearance for move in self.moves), default=float("inf"))

    def begins(self) -> tuple[float, ...]:
        """Return the time at which each step begins, s."""
        lengths = [duration_of(step) for step in self.steps]
        return tuple(np.concatenate([[0.0], np.cumsum(lengths)])[:-1].tolist())

    def at(self, times: npt.ArrayLike) -> Array:
        """Return configurations (m, n) rad at times (m,) s from the start, clamped to the plan."""
        t = np.atleast_1d(np.asarray(times, dtype=float))
        q = np.tile(self.q_start, (len(t), 1))
        for step, begin in zip(self.steps, self.begins(), strict=True):
            rows = t >= begin
            if isinstance(step, Move) and rows.any():
                q[rows] = self.unit.positions(step.path.at(t[rows] - begin))
        return q

    def sample(self, step_s: float = 0.01) -> tuple[Array, Array]:
        """Return times (m,) s on a regular grid, the end included, and configurations (m, n) rad.

        Raises:
            InputError: the step is not positive.
        """
        if not step_s > 0.0:
            raise InputError(f"step = {step_s:g} s: must be positive", value=step_s)
        end = self.duration_s
        times = np.append(np.arange(0.0, end - 1e-9, step_s), end)
        return frozen(times), frozen(self.at(times))

    def cubics(self) -> Iterator[tuple[Move, Array, Array]]:
        """Yield each move with durations (k,) s and coefficients c (k, 4, n) rad of q = sum of c_i u^i, 0 <= u <= 1."""
        for move in self.moves:
            yield move, *self._cubics_of(move)

    def _cubics_of(self, move: Move) -> tuple[Array, Array]:
        knots = move.path.knots()
        c = np.zeros((len(move.path.segments), 4, knots.shape[1]))
        for k, segment in enumerate(move.path.segments):
            c[k, 0] = self.unit.positions(knots[k])
            rows = np.array(segment.coefficients, dtype=float)
            c[k, 1 : 1 + len(rows)] = rows / self.unit.counts_per_rad
        return np.array([s.duration_ms / 1e3 for s in move.path.segments]), c

    def rows(self, step_s: float = 0.01) -> Iterator[list[str | float]]:
        """Yield the rows of a CSV file: a header, then time in s and joint positions in rad (m)."""
        yield ["time_s", *self.robot.joint_names]
        times, q = self.sample(step_s)
        for t, row in zip(times.tolist(), q.tolist(), strict=True):
            yield [round(t, 6), *(round(x, 9) for x in row)]

    def to_json(self) -> dict[str, Any]:
        """Return the plan as JSON types: cubic segments in rad, certified clearances, pauses, targets."""
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
            durations, c = self._cubics_of(step)
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
            **({"near_ends": list(self.near_ends)} if self.near_ends else {}),
            **({"stopped": self.stopped} if self.stopped else {}),
        }


def unfinished(stop: BudgetSpent | KeyboardInterrupt, progress: str, **data: Any) -> BaseException:
    """Return the error of a search that ended before a plan was complete; `progress` says how far it came."""
    text = f"{budget_words(stop)}: no complete {progress}"
    if isinstance(stop, KeyboardInterrupt):
        return PlanningInterrupted(text)
    spent = {"budget": stop.by, "budget_s": stop.allowed_s, "effort_s": stop.effort_s}
    return ImpossibleError(text, **{**data, **spent})


def joined(before: Planned, after: Planned) -> Planned:
    """Return two planned programs as one; the second begins where the first ends."""
    return replace(
        before,
        q_end=after.q_end,
        steps=(*before.steps, *after.steps),
        reached=(*before.reached, *after.reached),
        lower_bound_s=before.lower_bound_s + after.lower_bound_s,
        state=after.state,
        cubes=(*before.cubes, *after.cubes),
        above_bound_s={
            cause: round(before.above_bound_s.get(cause, 0.0) + after.above_bound_s.get(cause, 0.0), 3)
            for cause in {**before.above_bound_s, **after.above_bound_s}
        },
        skipped=(*before.skipped, *after.skipped),
        touching=before.touching | after.touching,
        candidates=(*before.candidates, *after.candidates),
        detours=before.detours + after.detours,
        near_ends=(*before.near_ends, *after.near_ends),
        stopped="; ".join(filter(None, (before.stopped, after.stopped))),
    )


def resting_on(scene: Scene, unit: Unit, options: PlanOptions) -> dict[str, Any]:
    """Return the planner's own part of a plan's provenance, as JSON types.

    Args:
        scene: scene of the plan, with all its allowed collisions.
        unit: unit of its counts.
        options: options of the planning.
    """
    return {
        "scene": scene.digest,
        "robot_open": scene.robot_open.digest,
        "robot_holding": scene.robot_holding.digest,
        "unit": unit.digest,
        "options": options.to_json(),
    }


@cache
def _versions() -> dict[str, str]:
    return {name: version(name) for name in _LIBRARIES}


def _registers(unit: Unit, limits: Limits) -> dict[str, tuple[int, ...]]:
    """Return the controller's registers that correspond to `limits`."""
    scale = np.abs(unit.counts_per_rad) * 256.0
    return {
        "speed": tuple(int(v) for v in np.rint(limits.velocity * scale / 1e3)),
        "acceleration": tuple(int(v) for v in np.rint(limits.acceleration * scale / 1e6)),
    }
