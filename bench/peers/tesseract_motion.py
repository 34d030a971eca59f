"""Tesseract 0.5: the continuous check of Bullet's cast shapes, along straight motions of joints."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from tesseract_robotics.tesseract_collision import ContactRequest, ContactResultMap, ContactResultVector
from tesseract_robotics.tesseract_collision import ContactTestType_CLOSEST as CLOSEST
from tesseract_robotics.tesseract_collision import ContactTestType_FIRST as FIRST
from tesseract_robotics.tesseract_common import GeneralResourceLocator
from tesseract_robotics.tesseract_environment import Environment

from arm.se3 import Array
from peers.scene_text import scene_srdf

PLUGINS = """contact_manager_plugins:
  search_libraries: [tesseract_collision_bullet_factories]
  continuous_plugins:
    default: BulletCastBVHManager
    plugins:
      BulletCastBVHManager: {class: BulletCastBVHManagerFactory}
"""


class Casts:
    """One arm among bodies."""

    def __init__(
        self, urdf: str, links: Sequence[str], allowed: Iterable[frozenset[str]], folder: Path
    ) -> None:
        plugins = folder / "contact_managers.yaml"
        plugins.write_text(PLUGINS)
        self._environment = Environment()
        if not self._environment.init(
            urdf, scene_srdf(links, allowed, str(plugins)), GeneralResourceLocator()
        ):
            raise ValueError("Tesseract does not read the scene")
        self._group = self._environment.getJointGroup("arm")
        self._moving = list(self._group.getActiveLinkNames())
        self._manager = self._environment.getContinuousContactManager()
        self._manager.setActiveCollisionObjects(self._moving)
        self._objects = [n for n in self._manager.getActiveCollisionObjects() if n in self._moving]

    def touches(self, q: Array, clearance: float, longest: float) -> bool:
        """Return whether anything is found nearer than a clearance, m, along way-points (m, n), rad.

        Args:
            longest: of the steps between which shapes are cast, rad (m) of the joint that moves most.
        """
        self._manager.setDefaultCollisionMarginData(clearance)
        return any(not found.empty() for found in self._contacts(q, longest, FIRST))

    def least(self, q: Array, limit: float, longest: float) -> float:
        """Return the least distance that is found, at most `limit`, m."""
        self._manager.setDefaultCollisionMarginData(limit)
        least = limit
        for found in self._contacts(q, longest, CLOSEST):
            results = ContactResultVector()
            found.flattenMoveResults(results)
            least = min(least, *(results[k].distance for k in range(len(results))), limit)
        return least

    def _contacts(self, q: Array, longest: float, kind: int) -> Iterable[ContactResultMap]:
        for a, b in pairwise(q):
            steps = max(1, int(np.ceil(np.abs(b - a).max() / longest)))
            begin = self._group.calcFwdKin(a)
            for u in np.linspace(0.0, 1.0, steps + 1)[1:]:
                end = self._group.calcFwdKin(a + u * (b - a))
                for name in self._objects:
                    self._manager.setCollisionObjectsTransform(name, begin[name], end[name])
                found = ContactResultMap()
                self._manager.contactTest(found, ContactRequest(kind))
                yield found
                begin = end
