"""Motions of a threaded ring that are wrong on purpose, made from a right one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from arm.controller.segments import CountPath, Segment
from arm.plan_file import Move, Plan
from arm.se3 import inverse, rotation, transform
from cell.program.planning import plan_of_program, program_options, program_scene
from cell.program.program_file import ProgramTask
from hoop_bench.thread_oracle import ThreadOracle
from plan.kinematics.ik import inverse_kinematics
from plan.scene import Scene
from vision.observation import Observation

Array = npt.NDArray[np.float64]
Rng = np.random.Generator

SPEED = 0.5
STEP = 0.006  # m between poses of straight parts
JUMP = 0.4  # rad, largest motion of a joint between two poses that are followed
APART = 0.05  # rad, of way-points of the right motion
GRAZES = (2e-4, 4e-3)  # m that a grazing motion lacks


@dataclass(frozen=True, eq=False)
class Right:
    """A right motion along a wire, to its foot, and what it moves through.

    Attributes:
        task, plan, scene: the program, its plan and its scene.
        q: (k, 6) way-points of the way to the foot, straight in the joints between.
        T: (k, 4, 4) of the ring there.
        ahead: (3,) direction of the wire at its free end.
        oracle: of its wire.
    """

    task: ProgramTask
    plan: Plan
    scene: Scene
    q: Array
    T: Array
    ahead: Array
    oracle: ThreadOracle

    @property
    def wire(self) -> str:
        """Name of the wire."""
        return self.task.threads[0].name


def right_motion(task: ProgramTask) -> Right:
    """Plan a program of one wire.

    Raises:
        ImpossibleError: there is no plan.
    """
    plan = plan_of_program(task, Observation(), SPEED)
    scene, unit = program_scene(task, Observation()), task.cell.unit
    along = next(move for move in plan.moves if move.threaded is not None)
    every, kept = unit.positions(along.path.sample(0.01)), [0]
    for k, q in enumerate(every):
        if np.abs(q - every[kept[-1]]).max() >= APART or k == len(every) - 1:
            kept.append(k)
    q = every[kept]
    T = np.array([scene.robot_open.T_base_tool(one) for one in q])
    line = scene.threads[0].line
    ahead = (line[-1] - line[-2]) / np.linalg.norm(line[-1] - line[-2])
    return Right(task, plan, scene, q, T, ahead, ThreadOracle(scene, scene.threads[0].name))


def plan_with(of: Right, q: Array, threaded: str | None) -> Plan:
    """Return the plan with straight joint motions through q (k, 6) instead of its own way along the wire and back.

    They are two moves, as many as the program has along its wire, each with the clearance that the program asks for.
    """
    if len(q) == 2:
        q = np.array([q[0], (q[0] + q[1]) / 2.0, q[1]])
    middle = len(q) // 2
    there, back = (move for move in of.plan.moves if move.threaded is not None)
    parts = ((there, q[: middle + 1]), (back, q[middle:]))
    return replace(of.plan, steps=tuple(_move(of, move, some, threaded) for move, some in parts))


def _move(of: Right, move: Move, q: Array, threaded: str | None) -> Move:
    clearance, unit = of.task.required, of.task.cell.unit
    limits = of.task.cell.limits.scaled(program_options(of.task, SPEED).speed)
    counts = unit.counts(q)
    segments = []
    for step in np.diff(counts, axis=0):
        turn = np.abs(step / unit.counts_per_rad)
        lasts = max((1.5 * turn / limits.velocity).max(), np.sqrt((6.0 * turn / limits.acceleration).max()))
        rows = (np.zeros(6, dtype=np.int64), 3 * step, -2 * step)
        segments.append(
            Segment(int(np.ceil(1050.0 * lasts)) + 2, tuple(tuple(map(int, row)) for row in rows))
        )
    path = CountPath(tuple(map(int, counts[0])), tuple(segments))
    return replace(
        move, path=path, threaded=threaded, clearance=clearance, clearances=(clearance,) * len(segments)
    )


def over_the_end(of: Right, rng: Rng) -> Array | None:
    """Off the wire over its free end, aside, and down beside it; every other time back the same way, and on again.

    Mostly the ring moves towards its handle, so that neither handle nor wrist come near the wire.
    """
    begin = int(rng.integers(1, len(of.q)))
    out = of.q[begin::-1]
    aside = _across(of.ahead, rng)
    if rng.random() < 0.8:
        angle = rng.uniform(-1.0, 1.0)
        aside = -np.cos(angle) * of.T[0][:3, 0] + np.sin(angle) * of.T[0][:3, 1]
    beyond, away, down = rng.uniform(0.0, 0.08), rng.uniform(0.09, 0.17), rng.uniform(0.05, 0.25)
    way = [beyond * of.ahead, away * aside, -down * of.ahead]
    beside = _led(of, of.T[0], way, of.q[0])
    if beside is None:
        return None
    whole = np.concatenate([out, beside])
    if rng.random() < 0.5:
        whole = np.concatenate([whole, beside[-2::-1], of.q[: begin + 1]])
    return whole


def sideways(of: Right, rng: Rng) -> Array | None:
    """Off the wire through the bar, in one straight motion of the joints between two way-points."""
    k = int(rng.integers(len(of.q) // 3, len(of.q)))
    T = transform(t=rng.uniform(0.07, 0.15) * _across(of.T[k][:3, 2], rng)) @ of.T[k]
    beside = _reached(of, T, of.q[k], 1.5)
    return None if beside is None else np.concatenate([of.q[: k + 1], [beside]])


def beside(of: Right, rng: Rng) -> Array | None:
    """The right motion beside the wire, all along."""
    return _shifted(of, rng.uniform(0.07, 0.14) * _across(of.ahead, rng))


def shifted(of: Right, rng: Rng) -> Array | None:
    """The right motion, too far to one side."""
    return _shifted(of, rng.uniform(0.012, 0.05) * _across(of.ahead, rng))


def grazing(of: Right, rng: Rng) -> Array | None:
    """The right motion, shifted until it lacks little of the clearance."""
    way, wanted = _across(of.ahead, rng), of.task.required - rng.uniform(*GRAZES)
    low, high, found = 0.0, 0.03, None
    for _ in range(7):
        middle = 0.5 * (low + high)
        q = _shifted(of, middle * way)
        if q is None or (judged := of.oracle.judge(q, wanted)).least < wanted:
            high = middle
        else:
            low = middle
            if judged.least < of.task.required:
                found = q
    return found


def turned(of: Right, rng: Rng) -> Array | None:
    """The right motion to a way-point, and there a turn about a diameter of the ring."""
    k = int(rng.integers(len(of.q) // 3, len(of.q)))
    axis = np.array([*_unit(rng.normal(size=2)), 0.0])
    T = [of.T[k] @ transform(rotation(a * axis)) for a in np.arange(0.05, rng.uniform(0.9, 2.5), 0.05)]
    last = _followed(of, np.array(T), of.q[k])
    return None if last is None else np.concatenate([of.q[: k + 1], last])


def swapped(of: Right, rng: Rng) -> Array | None:
    """The right motion with two of its way-points swapped."""
    i, j = sorted(rng.choice(len(of.q), 2, replace=False).tolist())
    if j - i < len(of.q) // 6:
        return None
    q = of.q.copy()
    q[[i, j]] = q[[j, i]]
    return q


def short_cut(of: Right, rng: Rng) -> Array | None:
    """The right motion without the way-points between two."""
    i, j = sorted(rng.choice(len(of.q), 2, replace=False).tolist())
    return None if j - i < len(of.q) // 4 else np.concatenate([of.q[: i + 1], of.q[j:]])


def too_deep(of: Right, rng: Rng) -> Array | None:
    """The right motion, and further down, into the board."""
    deeper = _led(of, of.T[-1], [np.array([0.0, 0.0, -rng.uniform(0.025, 0.06)])], of.q[-1])
    return None if deeper is None else np.concatenate([of.q, deeper])


def other_wire(of: Right, rng: Rng, others: list[Right]) -> Array | None:
    """The right motion of another wire."""
    other = others[int(rng.integers(len(others)))]
    if other.wire == of.wire:
        return None
    T_here_there = of.task.T_on_work @ inverse(other.task.T_on_work)
    first = _reached(of, T_here_there @ other.T[0], other.q[0], np.pi)
    return None if first is None else _followed(of, np.array([T_here_there @ T for T in other.T]), first)


Maker = Callable[[Right, Rng], Array | None]
OTHERS: dict[str, Maker] = {
    "through the bar sideways": sideways,
    "beside the wire all along": beside,
    "shifted": shifted,
    "grazing": grazing,
    "turned about a diameter": turned,
    "way-points swapped": swapped,
    "way-points left out": short_cut,
    "too deep": too_deep,
}


def _across(ahead: Array, rng: Rng) -> Array:
    """Return a unit vector (3,) normal to one."""
    some = rng.normal(size=3)
    return _unit(some - (some @ ahead) * ahead)


def _unit(v: Array) -> Array:
    return np.asarray(v / np.linalg.norm(v))


def _shifted(of: Right, way: Array) -> Array | None:
    T = np.array([transform(t=way) @ T for T in of.T])
    first = _reached(of, T[0], of.q[0], 1.5)
    return None if first is None else _followed(of, T, first)


def _led(of: Right, T: Array, ways: list[Array], q: Array) -> Array | None:
    """Return joints along straight ways (3,) m of the tool, one after the other, from T (4, 4) and q (6,)."""
    poses, at = [], np.array(T)
    for way in ways:
        count = max(1, int(np.ceil(np.linalg.norm(way) / STEP)))
        for part in np.linspace(0.0, 1.0, count + 1)[1:]:
            poses.append(transform(t=part * way) @ at)
        at = poses[-1]
    return _followed(of, np.array(poses), q)


def _followed(of: Right, T: Array, q: Array) -> Array | None:
    found = []
    for pose in T:
        after = _reached(of, pose, q, JUMP)
        if after is None:
            return None
        q = after
        found.append(q)
    return np.array(found)


def _reached(of: Right, T: Array, near: Array, most: float) -> Array | None:
    """Return the solution (6,) nearest to another configuration; None if no joint may move so far."""
    limits = of.task.cell.limits
    every = inverse_kinematics(of.scene.robot_open, T, limits.lower, limits.upper).q
    if len(every) == 0:
        return None
    best = every[int(np.argmin(np.abs(every - near).max(axis=1)))]
    return best if np.abs(best - near).max() <= most else None
