"""Scenes described as URDF."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import coal
import numpy as np
import pinocchio as pin

from cell.export.folder import write_folder
from cell.export.urdf import Surroundings, describe
from plan.collision.pair_geometry import GJK_TOLERANCE


class Exported:
    """A folder as Pinocchio reads it; the arm's joints first among its six and two."""

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
        self.states = {s.attrib["name"]: s for s in ElementTree.parse(srdf).iter("group_state")}
        self.data, self.distances = self.model.createData(), pin.GeometryData(self.geometry)
        request = coal.DistanceRequest()
        request.gjk_tolerance = request.epa_tolerance = GJK_TOLERANCE
        for i in range(len(self.geometry.collisionPairs)):
            self.distances.distanceRequests[i] = request

    def q(self, q: np.ndarray, jaw_opening: float) -> np.ndarray:
        assert list(self.model.names)[1:] == [*(f"J{n}" for n in range(1, 7)), "jaw_l", "jaw_r"]
        return np.array([*q, jaw_opening / 2.0, jaw_opening / 2.0])

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


def written(there: Surroundings, folder: Path) -> Exported:
    write_folder(folder, describe(there).files)
    return Exported(folder)
