"""Feasible calibration poses of a held target: entirely in view, collision-free and in reach."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from arm.controller.unit import Limits
from arm.errors import ImpossibleError
from arm.numerics.products import mul
from arm.robot.model import Robot
from arm.robot.shapes import Body, convex
from arm.se3 import Array, frozen, inverse, transform
from cell.files.hand_target import PLATE, HandTarget
from cell.sim.target_photos import target_pose
from plan.collision.world import World
from plan.kinematics.ik import Branches, inverse_kinematics
from vision.camera.model import Camera

DISTANCES = (0.35, 1.0)  # from the camera, m
TILT = np.radians(50.0)  # largest angle between the target's normal and the line of sight
UNSURE_PX = 60.0  # margin to the edge of the image while the poses of camera and mount are approximate
LIMIT_MARGIN = np.radians(3.0)  # margin to the joint limits, rad
TOO_NEAR, HIDDEN = "too near something", "hidden by the arm"
_BATCH, _MOST_BATCHES = 200, 60  # poses drawn at a time


@dataclass(eq=False)
class HandView:
    """Visibility of a held target. The poses of the camera and of the mount are approximate.

    Attributes:
        robot: arm with the plate (`HandTarget.carried_by`).
        bodies: obstacles.
        limits: joint limits.
        camera: camera with its approximate pose.
        hand: target with its approximate mount.
        clearance: smallest distance from all bodies, m.
    """

    robot: Robot
    bodies: tuple[Body, ...]
    limits: Limits
    camera: Camera
    hand: HandTarget
    clearance: float

    def __post_init__(self) -> None:
        robot, limits = self.robot, self.limits
        self.lower, self.upper = limits.lower + LIMIT_MARGIN, limits.upper - LIMIT_MARGIN
        self._T_target_tool = mul(inverse(self.hand.T_flange_target), robot.T_end_tool)
        self._world = World(robot, self.bodies)
        self._bare = replace(robot, bodies=tuple(b for b in robot.bodies if b.name != PLATE))

    def T_base_target(self, q: Array) -> Array:
        """Return the pose (4, 4) of the target at a configuration (6,), rad."""
        return np.asarray(mul(self.robot.T_base_tool(q), inverse(self._T_target_tool)))

    def ik_solutions(self, T_base_target: Array) -> Branches:
        """Return the configurations that hold the target at each pose (n, 4, 4)."""
        return inverse_kinematics(self.robot, mul(T_base_target, self._T_target_tool), self.lower, self.upper)

    def in_image(self, T_camera_target: Array) -> bool:
        """Whether all corners of a target at a pose are well inside the image."""
        points = mul(self.hand.target.points(), T_camera_target[:3, :3].T) + T_camera_target[:3, 3]
        if (points[:, 2] <= 0.0).any():
            return False
        pixels, last = self.camera.project(points), np.array(self.camera.size) - 1.0
        return bool(((pixels >= UNSURE_PX) & (pixels <= last - UNSURE_PX)).all())

    def obstacle(self, q: Array) -> str | None:
        """Return why a configuration with the target in view is not feasible; None if it is."""
        if self._world.in_collision(q, self.clearance):
            return TOO_NEAR
        return HIDDEN if self._hidden(q) else None

    def shows(self, q: Array) -> bool:
        """Whether a configuration is within limits, clear, and shows the target tilted by less than `TILT`."""
        if (q < self.lower).any() or (q > self.upper).any():
            return False
        T = mul(inverse(self.camera.T_base_camera), self.T_base_target(q))
        facing = float(T[2, 2]) >= np.cos(TILT)  # z goes into the plate
        return facing and self.in_image(T) and self.obstacle(q) is None

    def _hidden(self, q: Array) -> bool:
        """Whether the arm blocks the line of sight between camera and target."""
        sight = self.hand.sight(self.camera.T_base_camera, self.T_base_target(q))
        middle = sight.mean(axis=0)
        seen = Body("sight", convex(sight - middle), transform(t=middle), "sight")
        return World(self._bare, (seen,)).in_collision(q)


def hand_pool(
    view: HandView, count: int, seed: int, progress: Callable[[float], None] = lambda part: None
) -> Array:
    """Draw configurations (n, 6), rad, in which the camera sees the whole held target.

    Target poses are drawn anywhere in the image, at a distance within `DISTANCES` and with any rotation. For each pose
    one solution of the inverse kinematics is drawn, so that all joints vary.

    Args:
        view: visibility of the target.
        count: number of configurations.
        seed: seed of the draws.
        progress: called with the fraction found.

    Raises:
        ImpossibleError: fewer than a tenth were found; data: tried, found, and the reasons for the others.
    """
    rng = np.random.default_rng(seed)
    found: list[Array] = []
    why = {"out of the image": 0, "out of reach": 0, TOO_NEAR: 0, HIDDEN: 0}
    tried = 0
    for _ in range(_MOST_BATCHES):
        drawn = (_held(view, rng) for _ in range(_BATCH))
        seen = [T for T in drawn if view.in_image(T)]
        tried += _BATCH
        why["out of the image"] += _BATCH - len(seen)
        branches = view.ik_solutions(mul(view.camera.T_base_camera, np.array(seen).reshape(-1, 4, 4)))
        why["out of reach"] += len(seen) - len(np.unique(branches.pose))
        for pose in np.unique(branches.pose):
            q = branches.q[rng.choice(np.flatnonzero(branches.pose == pose))]
            obstacle = view.obstacle(q)
            if obstacle is not None:
                why[obstacle] += 1
                continue
            found.append(q)
            progress(len(found) / count)
            if len(found) == count:
                return frozen(np.array(found))
    if len(found) < count / 10:
        shown = ", ".join(f"{number} {reason}" for reason, number in why.items())
        raise ImpossibleError(
            f"of {tried} poses of the target only {len(found)} are feasible ({shown}): is the camera about where "
            "its file says, can the printed side face it, and is the zone no higher than the boards?",
            tried=tried,
            found=len(found),
            reasons=why,
        )
    return frozen(np.array(found))


def _held(view: HandView, rng: np.random.Generator) -> Array:
    """Draw a T_camera_target with the target's centre in the image."""
    angle = rng.uniform(0.0, 2.0 * np.pi)
    return target_pose(
        view.camera,
        view.hand.target,
        rng.uniform(0.1, 0.9, 2) * np.array(view.camera.size),
        rng.uniform(*DISTANCES),
        rng.uniform(0.0, TILT) * np.array([np.cos(angle), np.sin(angle)]),
        rng.uniform(-np.pi, np.pi),
    )


def nearest_order(q_from: Array, q: Array) -> list[int]:
    """Return the order in which to visit configurations (n, 6): always the nearest of the rest, by its largest joint
    motion."""
    left, order, now = set(range(len(q))), [], q_from
    while left:
        best = min(left, key=lambda i: float(np.abs(q[i] - now).max()))
        left.remove(best)
        order.append(best)
        now = q[best]
    return order
