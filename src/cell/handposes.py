"""Where the arm may hold a target for its calibration: seen whole, clear of everything, and in reach."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from arm.bodies import Body, Convex, convex
from arm.errors import ImpossibleError
from arm.robot import Robot
from arm.se3 import Array, frozen, inverse
from arm.unit import Limits
from cell.handtarget import PLATE, HandTarget
from cell.targetviews import held
from plan.ik import inverse_kinematics
from plan.world import World
from vision.camera import Camera

DISTANCES = (0.35, 1.0)  # from the camera, m
TILT = np.radians(50.0)  # most, between the target's normal and the line of sight
UNSURE_PX = (
    60.0  # how far the target must appear inside the image while camera and arm are only roughly known
)
LIMIT_MARGIN = np.radians(3.0)  # rad, from the limits of the joints
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


def hand_pool(
    robot: Robot,
    bodies: tuple[Body, ...],
    limits: Limits,
    camera: Camera,
    hand: HandTarget,
    clearance: float,
    count: int,
    seed: int,
    progress: Callable[[float], None] = lambda part: None,
) -> HandPool:
    """Configurations in which the camera sees the whole target in the hand.

    Targets are held anywhere in the image, at any distance and turn; of the arm's ways to hold one there, one is
    taken by chance, so that all joints turn.

    Args:
        robot: the arm with the plate (`HandTarget.carried_by`).
        bodies: around it.
        limits: of the joints.
        camera: about where it stands.
        hand: about how the target is held.
        clearance: from all bodies, m.
        count: configurations wanted.
        seed: of the choice.
        progress: told what part is there.

    Raises:
        ImpossibleError: fewer than a tenth of them can be had; data: tried, found, and why the others cannot.
    """
    rng = np.random.default_rng(seed)
    world = World(robot, bodies)
    lower, upper = limits.lower + LIMIT_MARGIN, limits.upper - LIMIT_MARGIN
    T_target_tool = inverse(hand.T_flange_target) @ robot.T_end_tool
    found: list[Array] = []
    why = {"out of the image": 0, "out of reach": 0, "too near something": 0, "hidden by the arm": 0}
    tried = 0
    for _ in range(_MOST_BATCHES):
        seen = [T for T in (_held(camera, hand, rng) for _ in range(_BATCH)) if T is not None]
        tried += _BATCH
        why["out of the image"] += _BATCH - len(seen)
        T_base_target = camera.T_base_camera @ np.array(seen).reshape(-1, 4, 4)
        branches = inverse_kinematics(robot, T_base_target @ T_target_tool, lower, upper)
        why["out of reach"] += len(seen) - len(np.unique(branches.pose))
        for pose in np.unique(branches.pose):
            q = branches.q[rng.choice(np.flatnonzero(branches.pose == pose))]
            if world.in_collision(q, clearance):
                why["too near something"] += 1
            elif _hidden(robot, camera, hand, T_base_target[pose], q):
                why["hidden by the arm"] += 1
            else:
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


def _held(camera: Camera, hand: HandTarget, rng: np.random.Generator) -> Array | None:
    """T_camera_target somewhere, or None if not all of its corners are in the image."""
    size = np.array(camera.size)
    turn = rng.uniform(0.0, TILT) * _direction(rng)
    T = held(
        camera,
        hand.target,
        rng.uniform(0.1, 0.9, 2) * size,
        rng.uniform(*DISTANCES),
        turn,
        rng.uniform(-np.pi, np.pi),
    )
    pixels = camera.project(hand.target.points() @ T[:3, :3].T + T[:3, 3])
    inside = ((pixels >= UNSURE_PX) & (pixels <= size - 1.0 - UNSURE_PX)).all()
    return T if bool(inside) else None


def _direction(rng: np.random.Generator) -> Array:
    angle = rng.uniform(0.0, 2.0 * np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


def _hidden(robot: Robot, camera: Camera, hand: HandTarget, T_base_target: Array, q: Array) -> bool:
    """Whether the arm reaches into the sight between camera and target."""
    sight = hand.sight(camera.T_base_camera, T_base_target)
    middle = sight.mean(axis=0)
    shape: Convex = convex(sight - middle)
    T = np.eye(4)
    T[:3, 3] = middle
    bodies = tuple(b for b in robot.bodies if b.name != PLATE)
    bare = replace(robot, bodies=bodies)
    return World(bare, (Body("sight", shape, frozen(T), "sight"),)).in_collision(q)


def nearest_order(q_from: Array, q: Array) -> list[int]:
    """An order of configurations (n, 6) in which each is the nearest of those left, by its largest joint motion."""
    left, order, now = set(range(len(q))), [], q_from
    while left:
        best = min(left, key=lambda i: float(np.abs(q[i] - now).max()))
        left.remove(best)
        order.append(best)
        now = q[best]
    return order
