"""roboplan: RRT-Connect at a step of 0.01 rad, then shortcuts, as `roboplan-fine` of bench/planning.py."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np
import roboplan.core as core
import roboplan.rrt as rrt

from arm.robot.shapes import Body, Box, Cylinder
from arm.se3 import Array
from narrow_bench.panda import SRDF, URDF

STEP = 0.01  # rad
RANGE, MAX_NODES, SHORTCUTS, ATTEMPTS = 0.3, 4000, 200, 3  # as in planning_bench.roboplan_peer
_GROUP, _BASE = "panda_arm", "panda_link0"
_GREY = np.array([0.5, 0.5, 0.5, 1.0])


class RoboplanFine:
    """One scene of roboplan for each problem."""

    def __init__(self, folder: Path) -> None:
        root = ElementTree.fromstring((folder / URDF).read_text())
        for link in root.findall("link"):
            for visual in link.findall("visual"):
                link.remove(visual)
        self.urdf, self.srdf = ElementTree.tostring(root, encoding="unicode"), (folder / SRDF).read_text()

    def load(self, bodies: tuple[Body, ...]) -> None:
        """Build the scene."""
        self.scene = core.Scene("panda", core.loadUrdfSceneDescriptionFromXml(self.urdf))
        self.scene.importSrdf(self.srdf)
        names = [body.name for body in bodies]
        for body in bodies:
            _add(self.scene, body)
        still = [_BASE, *names]
        self.scene.setCollisions([(a, b) for i, a in enumerate(still) for b in still[i + 1 :]], False)

    def in_collision(self, q: Array) -> bool:
        """Return roboplan's own verdict on a configuration."""
        return bool(self.scene.hasCollisions(np.array(q)))

    def path(self, start: Array, goal: Array, seed: int) -> tuple[Array | None, bool]:
        """Return the path of its RRT-Connect, and whether it is only the straight line."""
        if not core.hasCollisionsAlongPath(self.scene, np.array(start), np.array(goal), STEP, True, True):
            return np.stack([start, goal]), True
        names = list(self.scene.getJointGroupInfo(_GROUP).joint_names)
        self.names = names
        options = rrt.RRTOptions(
            group_name=_GROUP,
            max_nodes=MAX_NODES,
            max_connection_distance=RANGE,
            collision_check_step_size=STEP,
            rrt_connect=True,
        )
        ends = [core.JointConfiguration(names, np.array(q)) for q in (start, goal)]
        for attempt in range(ATTEMPTS):
            planner = rrt.RRT(self.scene, options)
            planner.setRngSeed(1000 * seed + attempt + 1)
            try:
                self.found: Any = planner.plan(*ends)
            except RuntimeError:
                continue
            return np.array(self.found.positions), False
        return None, False

    def shortened(self, seed: int) -> Array:
        """Return the last path after its shortcuts."""
        options = core.PathShortcuttingOptions(
            group_name=_GROUP, max_step_size=STEP, max_iters=SHORTCUTS, seed=seed + 1
        )
        return np.array(core.PathShortcutter(self.scene, options).shortcut(self.found).positions)


def _add(scene: Any, body: Body) -> None:
    T = np.asfortranarray(body.T_base_body)
    match body.shape:
        case Box(size):
            scene.addBoxGeometry(body.name, "universe", core.Box(*size), T, _GREY)
        case Cylinder(radius, length):
            scene.addCylinderGeometry(body.name, "universe", core.Cylinder(radius, length), T, _GREY)
        case other:
            raise ValueError(f"{body.name}: no shape for {type(other).__name__}")
