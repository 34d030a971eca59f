"""The configuration within the joint limits that comes nearest to a pose, for poses that are out of reach."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from arm.numerics.products import mul, solve_positive
from arm.robot.model import Robot
from arm.se3 import Array, frozen
from plan.kinematics.freedom import Freedom, coordinates_of
from plan.kinematics.product_of_exponentials import product_of_exponentials

_LEVER = 0.5  # m for each rad of turn: the tool keeps its direction, so that the miss says how far off the place is
_STARTS = 12  # random ones, besides those that are given
_ROUNDS = 150
_STEP = 1e-7  # rad, for slopes
_LEAST = 1e-9  # of a slope's square
_ALIKE = (
    0.02  # share by which others may be further away; of these the one nearest to the first start is taken
)
_TURNS = 4.0 * np.pi


@dataclass(frozen=True, eq=False)
class AskedPose:
    """A pose of the tool with what is free about it.

    Attributes:
        T_base_tool: 4x4.
        freedom: limits of what is free within limits.
        free: names of directions without limits (`plan.kinematics.numeric_ik.FREE`).
    """

    T_base_tool: Array
    freedom: Freedom = field(default_factory=lambda: Freedom({}))
    free: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Return it as JSON types, as data of a refusal."""
        ranges = {name: list(values) for name, values in self.freedom.ranges.items()}
        T = np.round(self.T_base_tool, 12).tolist()
        return {"T_base_tool": T, "free": list(self.free), "ranges": ranges, "tilt_rad": self.freedom.tilt}


def asked_pose_from_json(value: Mapping[str, Any]) -> AskedPose:
    """Invert `AskedPose.to_json`."""
    ranges = {name: (low, high) for name, (low, high) in value["ranges"].items()}
    freedom = Freedom(ranges, value["tilt_rad"])
    return AskedPose(frozen(np.array(value["T_base_tool"], dtype=float)), freedom, tuple(value["free"]))


@dataclass(frozen=True, eq=False)
class Nearest:
    """A configuration, and by how much the tool misses a pose there.

    Attributes:
        q: (n,) rad.
        away: m, beyond what is free.
        turned: rad, beyond what is free.
    """

    q: Array
    away: float
    turned: float


def nearest_configuration(
    robot: Robot, pose: AskedPose, lower: Array, upper: Array, starts: Iterable[Array] = (), seed: int = 0
) -> Nearest:
    """Return the best configuration that damped least squares find from several starts.

    It minimises the distance from the pose, in which 1 rad counts as 0.5 m. The same input gives the same result.

    Args:
        robot: the arm.
        pose: what the tool should reach.
        lower, upper: limits (n,) rad.
        starts: configurations (n,) rad, brought within the limits.
        seed: of further starts.
    """
    arm = product_of_exponentials(robot)
    lower, upper = np.maximum(lower, -_TURNS), np.minimum(upper, _TURNS)  # joints may turn without end

    def off(q: Array) -> Array:
        return _beyond(pose, arm.tool_poses(q.reshape(-1, q.shape[-1]))).reshape(*q.shape[:-1], 6)

    tried = np.random.default_rng(seed).uniform(lower, upper, (_STARTS, len(lower)))
    q = np.clip(np.stack([*starts, 0.5 * (lower + upper), *tried]), lower, upper)
    reference = q[0]
    now, damping = off(q), np.full(len(q), 1e-3)
    for _ in range(_ROUNDS):
        slope = np.swapaxes((off(q[:, None] + _STEP * np.eye(len(lower))) - now[:, None]) / _STEP, 1, 2)
        down = -mul(np.swapaxes(slope, 1, 2), now[..., None])[..., 0]
        # a joint at a limit stays there if it would leave it
        free = ~(((q <= lower) & (down < 0.0)) | ((q >= upper) & (down > 0.0)))
        slope = slope * free[:, None]
        square = mul(np.swapaxes(slope, 1, 2), slope)
        size = damping * (np.trace(square, axis1=1, axis2=2) + _LEAST)
        step = solve_positive(square + size[:, None, None] * np.eye(len(lower)), down * free)
        there = np.clip(q + step, lower, upper)
        then = off(there)
        better = (then**2).sum(axis=1) < (now**2).sum(axis=1)
        q, now = np.where(better[:, None], there, q), np.where(better[:, None], then, now)
        damping = np.clip(damping * np.where(better, 0.3, 4.0), 1e-12, 1e6)
    off_by = np.sqrt((now**2).sum(axis=1))
    alike = q[off_by <= off_by.min() * (1.0 + _ALIKE) + _LEAST]
    best = alike[int(np.argmin(np.round(np.abs(alike - reference).max(axis=1), 6)))]
    away, turned = pose.freedom.excess(pose.T_base_tool, arm.tool_poses(best[None])[0], pose.free)
    return Nearest(frozen(best), float(away), float(turned))


def _beyond(pose: AskedPose, T_now: Array) -> Array:
    """Return how far tools (k, 4, 4) are beyond what is free, (k, 6) m; angles times `_LEVER`."""
    now, (low, high) = coordinates_of(pose.T_base_tool, T_now), pose.freedom.box(pose.free)
    beyond = now - np.clip(now, low, high)
    if pose.freedom.tilt > 0.0:
        size = np.sqrt((now[:, 3:5] ** 2).sum(axis=1, keepdims=True))
        beyond[:, 3:5] = now[:, 3:5] * (1.0 - np.minimum(1.0, pose.freedom.tilt / np.maximum(size, 1e-12)))
    beyond[:, 3:] *= _LEVER
    return beyond
