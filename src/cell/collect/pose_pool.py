"""Where the arm may hold a target for its calibration: seen whole, clear of everything, and in reach."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from arm.controller.unit import Limits
from arm.errors import ImpossibleError
from arm.numerics.products import mul
from arm.robot.model import Robot
from arm.robot.shapes import Body, convex
from arm.se3 import Array, frozen, inverse
from cell.files.hand_target import PLATE, HandTarget
from cell.sim.target_photos import held
from plan.collision.world import World
from plan.kinematics.ik import Branches, inverse_kinematics
from vision.camera.model import Camera

DISTANCES = (0.35, 1.0)  # from the camera, m
TILT = np.radians(50.0)  # most, between the target's normal and the line of sight
UNSURE_PX = (
    60.0  # how far the target must appear inside the image while camera and arm are only roughly known
)
LIMIT_MARGIN = np.radians(3.0)  # rad, from the limits of the joints
TOO_NEAR, HIDDEN = "too near something", "hidden by the arm"
_BATCH, _MOST_BATCHES = 200, 60


@dataclass(frozen=True, eq=False)
class HandPool:
    """Configurations that may be used.

    Attributes:
        q: (n, 6) rad.
        tried: poses of the target that were looked at.
    """

    q: Array
    tried: int


class HandView:
    """What the camera sees of a target in the hand, as far as place and mount are known.

    Args:
        robot: the arm with the plate (`HandTarget.carried_by`).
        bodies: around it.
        limits: of the joints.
        camera: about where it stands.
        hand: about how the target is held.
        clearance: from all bodies, m.
    """

    def __init__(
        self,
        robot: Robot,
        bodies: tuple[Body, ...],
        limits: Limits,
        camera: Camera,
        hand: HandTarget,
        clearance: float,
    ) -> None:
        self.robot, self.camera, self.hand = robot, camera, hand
        self.lower, self.upper = limits.lower + LIMIT_MARGIN, limits.upper - LIMIT_MARGIN
        self._clearance = clearance
        self._T_target_tool = mul(inverse(hand.T_flange_target), robot.T_end_tool)
        self._world = World(robot, bodies)
        self._bare = replace(robot, bodies=tuple(b for b in robot.bodies if b.name != PLATE))

    def T_base_target(self, q: Array) -> Array:
        """Where the target is at a configuration (6,) rad, 4x4."""
        return np.asarray(mul(self.robot.T_base_tool(q), inverse(self._T_target_tool)))

    def ways(self, T_base_target: Array) -> Branches:
        """Configurations that hold targets at poses (n, 4, 4)."""
        return inverse_kinematics(self.robot, mul(T_base_target, self._T_target_tool), self.lower, self.upper)

    def in_image(self, T_camera_target: Array) -> bool:
        """Whether all corners of a target at a pose appear well inside the image."""
        points = mul(self.hand.target.points(), T_camera_target[:3, :3].T) + T_camera_target[:3, 3]
        if (points[:, 2] <= 0.0).any():
            return False
        pixels, last = self.camera.project(points), np.array(self.camera.size) - 1.0
        return bool(((pixels >= UNSURE_PX) & (pixels <= last - UNSURE_PX)).all())

    def obstacle(self, q: Array) -> str | None:
        """Why a configuration that holds the target in view cannot be used; None if it can."""
        if self._world.in_collision(q, self._clearance):
            return TOO_NEAR
        return HIDDEN if self._hidden(q) else None

    def shows(self, q: Array) -> bool:
        """Whether a configuration is within limits, clear, and shows the target not too obliquely."""
        if (q < self.lower).any() or (q > self.upper).any():
            return False
        T = mul(inverse(self.camera.T_base_camera), self.T_base_target(q))
        facing = float(T[2, 2]) >= np.cos(TILT)  # z goes into the plate
        return facing and self.in_image(T) and self.obstacle(q) is None

    def _hidden(self, q: Array) -> bool:
        """Whether the arm reaches into the sight between camera and target."""
        sight = self.hand.sight(self.camera.T_base_camera, self.T_base_target(q))
        middle = sight.mean(axis=0)
        T = np.eye(4)
        T[:3, 3] = middle
        seen = Body("sight", convex(sight - middle), frozen(T), "sight")
        return World(self._bare, (seen,)).in_collision(q)


def hand_pool(
    view: HandView, count: int, seed: int, progress: Callable[[float], None] = lambda part: None
) -> HandPool:
    """Configurations in which the camera sees the whole target in the hand.

    Targets are held anywhere in the image, at any distance and turn; of the arm's ways to hold one there, one is
    taken by chance, so that all joints turn.

    Args:
        view: of the target in the hand.
        count: configurations wanted.
        seed: of the choice.
        progress: told what part is there.

    Raises:
        ImpossibleError: fewer than a tenth of them can be had; data: tried, found, and why the others cannot.
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
        branches = view.ways(mul(view.camera.T_base_camera, np.array(seen).reshape(-1, 4, 4)))
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
                return HandPool(frozen(np.array(found)), tried)
    if len(found) < count / 10:
        shown = ", ".join(f"{number} {reason}" for reason, number in why.items())
        raise ImpossibleError(
            f"of {tried} places for the target only {len(found)} can be used ({shown}): is the camera about where "
            "its file says, can the printed side face it, and is the zone no higher than boards stand?",
            tried=tried,
            found=len(found),
            reasons=why,
        )
    return HandPool(frozen(np.array(found)), tried)


def _held(view: HandView, rng: np.random.Generator) -> Array:
    """T_camera_target with the target's middle somewhere in the image."""
    angle = rng.uniform(0.0, 2.0 * np.pi)
    return held(
        view.camera,
        view.hand.target,
        rng.uniform(0.1, 0.9, 2) * np.array(view.camera.size),
        rng.uniform(*DISTANCES),
        rng.uniform(0.0, TILT) * np.array([np.cos(angle), np.sin(angle)]),
        rng.uniform(-np.pi, np.pi),
    )


def nearest_order(q_from: Array, q: Array) -> list[int]:
    """An order of configurations (n, 6) in which each is the nearest of those left, by its largest joint motion."""
    left, order, now = set(range(len(q))), [], q_from
    while left:
        best = min(left, key=lambda i: float(np.abs(q[i] - now).max()))
        left.remove(best)
        order.append(best)
        now = q[best]
    return order
