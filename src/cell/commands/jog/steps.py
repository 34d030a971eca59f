"""Steps of a jog: straight in joint space, inside the limits, and each with its own certificate of clearance.

Where two bodies are nearer than the clearance already, such as after a stop, the steps are those that lead these two
apart and keep the clearance of all others. Without them nothing would lead the arm away.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.controller.segments import CountPath, Segment
from arm.errors import ImpossibleError
from arm.numerics.products import norm
from arm.se3 import Array
from cell.accuracy.arm_errors import arm_errors
from cell.commands.jog.keys import JOINTS
from cell.config.cell import Cell
from plan.collision.certificate import ArmErrors, ClearanceCertificate, certify_move
from plan.collision.world import World
from plan.failure import nearness
from plan.kinematics.numeric_ik import solutions_near
from plan.scene import Scene

MOST_TURN = np.radians(5.0)  # of any joint in one step of the tool; more only near a singularity
_MS = 100  # the duration does not matter for a certificate
APART = 1e-5  # m that a step leads two bodies apart at least, which are nearer than the clearance
_SLACK = 1e-4  # m; a distance is not proved more exactly where a step begins with it


@dataclass(frozen=True)
class JogStep:
    """A certified step.

    Attributes:
        by: displacement of the axes, counts.
        tool_m: distance that the tool moves, m.
    """

    by: tuple[int, ...]
    tool_m: float


class StepMaker:
    """Makes steps in a scene that does not change.

    Args:
        cell: clearance, limits and errors of the arm.
        scene: what surrounds the arm, with its jaws as they are.
    """

    def __init__(self, cell: Cell, scene: Scene) -> None:
        self._cell, self._robot = cell, scene.robot_open
        self._present = scene.present
        self._world = World(scene.robot_open, scene.present)
        self._errors = arm_errors(cell)
        self._led: tuple[tuple[int, ...], Array] | None = (
            None  # counts, and where steps of the tool have led it
        )
        self._made: dict[tuple[tuple[int, ...], str, float], JogStep | ImpossibleError] = {}

    def distance(self, counts: tuple[int, ...]) -> float:
        """Return the distance of the nearest two bodies at a configuration, m."""
        return float(self._world.distance(self._cell.unit.positions(counts)).value)

    def step(self, start: tuple[int, ...], axis: str, by: float) -> JogStep:
        """Return the step from a configuration at rest.

        Args:
            start: (6,) counts.
            axis: joint; or x, y, z (of the base frame) or along (the tool's own z axis).
            by: rad, or m.

        Raises:
            ImpossibleError: it leaves a limit, comes nearer to something than the clearance (or does not lead away from
                what is nearer already), or no configuration leads the tool there.
        """
        key = (start, axis, by)
        if key not in self._made:
            try:
                self._made = {key: self._certified(start, *self._target(start, axis, by))}
            except ImpossibleError as error:
                self._made = {key: error}
        made = self._made[key]
        if isinstance(made, ImpossibleError):
            raise made
        return made

    def took(self, start: tuple[int, ...], axis: str, by: float, end: tuple[int, ...]) -> None:
        """Note that the step was sent: the next step of the tool goes on from where this one leads it exactly."""
        self._led = None if axis in JOINTS else (end, self._led_to(start, axis, by))

    def _led_to(self, start: tuple[int, ...], axis: str, by: float) -> Array:
        q = self._cell.unit.positions(start)
        known = self._led is not None and self._led[0] == start
        T = np.array(self._led[1] if known and self._led is not None else self._robot.T_base_tool(q))
        along = T[:3, 2] if axis == "along" else np.eye(3)["xyz".index(axis)]
        T[:3, 3] += by * along
        return T

    def _target(self, start: tuple[int, ...], axis: str, by: float) -> tuple[Array, Array]:
        """Configurations (6,) of the start and the target."""
        q, limits = self._cell.unit.positions(start), self._cell.limits
        if axis in JOINTS:
            target = q.copy()
            target[JOINTS.index(axis)] += by
        else:
            T = self._led_to(start, axis, by)
            found, met = solutions_near(self._robot, q[None], T[None], limits.lower, limits.upper)
            if not met[0] or np.abs(found[0] - q).max() > MOST_TURN:
                raise ImpossibleError("the tool cannot be led there with its orientation", axis=axis)
            target = found[0]
        over = np.maximum(limits.lower - target, target - limits.upper)
        joint = int(np.argmax(over))
        if over[joint] > 0.0 and over[joint] >= np.maximum(limits.lower - q, q - limits.upper)[joint]:
            low, high = np.degrees([limits.lower[joint], limits.upper[joint]])
            why = f"{JOINTS[joint]} is at its limit (from {low:.1f} to {high:.1f} deg)"
            raise ImpossibleError(why, joint=JOINTS[joint])
        return q, target

    def _certified(self, start: tuple[int, ...], q: Array, target: Array) -> JogStep:
        cell = self._cell
        by = tuple(int(b) - a for a, b in zip(start, cell.unit.counts(target), strict=True))
        path = CountPath(start, (Segment(_MS, (by,)),))
        for least, errors, whose in self._required():
            self._require(path, least, errors, whose)
        end = cell.unit.positions(path.end)
        moved = self._robot.T_base_tool(end)[:3, 3] - self._robot.T_base_tool(q)[:3, 3]
        return JogStep(by, float(norm(moved)))

    def too_near(self, start: tuple[int, ...]) -> list[str]:
        """Return which bodies are nearer than the clearance while the arm rests at counts (6,), a phrase a pair."""
        return [
            f"{self._nearness(pair, seen, least)}{whose}"
            for least, errors, whose in self._required()
            for pair, seen in self._near(start, least, errors).items()
        ]

    def _required(self) -> list[tuple[float, ArmErrors | None, str]]:
        """What every step has to keep, m; for which errors; and these in words."""
        cell, errors = self._cell, self._errors
        required: list[tuple[float, ArmErrors | None, str]] = [(cell.clearance, None, "")]
        if errors is not None:
            required.append((cell.erring_clearance, errors, " for all likely errors of the arm"))
        return required

    def _require(self, path: CountPath, least: float, errors: ArmErrors | None, whose: str) -> None:
        found = self._certificate(self._world, path, least, errors)
        if found.proved:
            return
        near = self._near(path.start, least, errors)
        if near:
            for pair, seen in near.items():
                self._require_apart(path, pair, f"{self._nearness(pair, seen, least)}{whose}")
            others = World(self._robot, self._present, allowed=map(frozenset, near))
            found = self._certificate(others, path, least, errors)
            if found.proved:
                return
        words = self._nearness(found.pair, found.seen, least)
        raise ImpossibleError(f"{words}{whose}", pair=list(found.pair), distance_m=found.seen)

    def _nearness(self, pair: tuple[str, str], seen: float, least: float) -> str:
        return nearness(pair, min(seen, least), least)

    def _certificate(
        self, world: World, path: CountPath, least: float, errors: ArmErrors | None
    ) -> ClearanceCertificate:
        return certify_move(world, path, self._cell.unit, least, tight=False, errors=errors)

    def _near(
        self, start: tuple[int, ...], least: float, errors: ArmErrors | None
    ) -> dict[tuple[str, str], float]:
        """The pairs that are nearer than `least` (m) while the arm rests, and how near, m."""
        rest, near = CountPath(start, (Segment(_MS, ((0,) * len(start),)),)), dict[tuple[str, str], float]()
        while True:
            world = World(self._robot, self._present, allowed=map(frozenset, near))
            found = self._certificate(world, rest, least, errors)
            if found.proved:
                return near
            near[found.pair] = found.seen

    def _require_apart(self, path: CountPath, pair: tuple[str, str], now: str) -> None:
        """Require that a step leads two bodies apart, and never nearer; `now`: how near they are, in words.

        Raises:
            ImpossibleError: it does not, or they touch, so that nobody knows what leads them apart.
        """
        world, unit = self._world, self._cell.unit
        every = (frozenset(world.pair_names(index)) for index in range(len(world.pairs)))
        alone = World(self._robot, self._present, allowed=[one for one in every if one != frozenset(pair)])
        before, after = (alone.distance(unit.positions(counts)).value for counts in (path.start, path.end))
        if before <= 0.0:
            why = f"{now}, where the arm stands; move it by hand (a465 release)"
        elif after < before + APART or not self._certificate(alone, path, before - _SLACK, None).proved:
            why = f"{now} where the arm stands: only steps that lead them apart are made"
        else:
            return
        raise ImpossibleError(why, pair=list(pair), distance_m=before)
