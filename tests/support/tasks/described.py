"""Scenes described as URDF."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

import coal
import numpy as np
import pinocchio as pin
import pytest

from arm.robot.model import Robot
from cell.export.folder import write_folder
from cell.export.urdf import Surroundings, describe
from plan.collision.narrow.coal_shapes import GJK_TOLERANCE
from plan.collision.world import World

COUNT = 50  # configurations that are compared


class Exported:
    """A folder as Pinocchio reads it."""

    def __init__(self, folder: Path) -> None:
        urdf, srdf = str(folder / "cell.urdf"), str(folder / "cell.srdf")
        self.model = pin.buildModelFromUrdf(urdf)
        self.geometry = pin.buildGeomFromUrdf(
            self.model, urdf, pin.GeometryType.COLLISION, package_dirs=[str(folder)]
        )
        for thing in self.geometry.geometryObjects:
            if type(thing.geometry).__name__.startswith("BVHModel"):
                thing.geometry.buildConvexHull(True, "Qt")
                thing.geometry = thing.geometry.convex
        self.geometry.addAllCollisionPairs()
        pin.removeCollisionPairs(self.model, self.geometry, srdf)
        pin.loadReferenceConfigurations(self.model, srdf)
        tip = ElementTree.parse(srdf).find("group[@name='arm']/chain")
        self.tool = "" if tip is None else tip.attrib["tip_link"]
        self.states = {s.attrib["name"]: s for s in ElementTree.parse(srdf).iter("group_state")}
        self.data, self.distances = self.model.createData(), pin.GeometryData(self.geometry)
        request = coal.DistanceRequest()
        request.gjk_tolerance = request.epa_tolerance = GJK_TOLERANCE
        for i in range(len(self.geometry.collisionPairs)):
            self.distances.distanceRequests[i] = request

    def q(self, q: np.ndarray, robot: Robot) -> np.ndarray:
        """All joints of the file: those of the arm, and those that are locked."""
        at = dict(zip(robot.joint_names, q.tolist(), strict=True)) | dict(robot.locked)
        assert set(at) == set(list(self.model.names)[1:])
        return np.array([at[name] for name in list(self.model.names)[1:]])

    def link(self, index: int) -> str:
        return str(self.model.frames[self.geometry.geometryObjects[index].parentFrame].name)

    def pair_distances(self, q: np.ndarray) -> dict[frozenset[str], float]:
        """Of pairs of links that are still checked: the least over their parts."""
        pin.updateGeometryPlacements(self.model, self.data, self.geometry, self.distances, q)
        found: dict[frozenset[str], float] = {}
        for i, pair in enumerate(self.geometry.collisionPairs):
            names = frozenset((self.link(pair.first), self.link(pair.second)))
            value = pin.computeDistance(self.geometry, self.distances, i).min_distance
            found[names] = min(value, found.get(names, np.inf))
        return found

    def T_base(self, frame: str, q: np.ndarray) -> np.ndarray:
        pin.framesForwardKinematics(self.model, self.data, q)
        return np.array(self.data.oMf[self.model.getFrameId(frame)].homogeneous)


def require_same(there: Surroundings, folder: Path, seed: int, error: float = 1e-6) -> None:
    """What Pinocchio reads from an export is what it was made from, to an error of distances, m."""
    described = describe(there)
    write_folder(folder, described.files)
    require_read(there, described.links, Exported(folder), seed, error)


def require_read(
    there: Surroundings, links: Mapping[str, str], exported: Exported, seed: int, error: float = 1e-6
) -> None:
    """Kinematics to 1e-9, the same pairs, the same distances to `error` m where bodies are apart; overlaps in both."""
    links = {body.name: body.link for body in there.robot.bodies if body.link} | dict(links)
    world = World(there.robot, there.bodies, there.held, there.T_tool_held, there.allowed)
    pairs = [frozenset(links[name] for name in world.pair_names(i)) for i in range(len(world.pairs))]
    assert len(pairs) > 0
    rng = np.random.default_rng(seed)
    apart = 0
    for q in rng.uniform(there.limits.lower, there.limits.upper, size=(COUNT, len(there.limits.lower))):
        full = exported.q(q, there.robot)
        assert np.abs(exported.T_base(exported.tool, full) - there.robot.T_base_tool(q)).max() < 1e-9
        ours: dict[frozenset[str], float] = {}
        for pair, value in zip(
            pairs, world.pair_distances(q, np.arange(len(pairs))) + world.paddings, strict=True
        ):
            ours[pair] = min(value, ours.get(pair, np.inf))
        found = exported.pair_distances(full)
        assert set(found) == set(ours)
        for pair, value in ours.items():
            if value > 10.0 * error:
                apart += 1
                assert found[pair] == pytest.approx(value, abs=error), (pair, q)
            else:
                assert found[pair] < 20.0 * error, (pair, q)
    assert apart > COUNT * len(set(pairs)) / 2
