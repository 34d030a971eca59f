"""Where to release a cube again that did not seat: measured corrections first, then a spiral.

A cube that did not seat was released beside its pocket. The look measures by how much, relative to the pocket
(`DisplacedCube.release_offset`). Both are seen in the same images, so the errors of camera and board cancel, and what
remains is the arm's error there.

The jaws centre the cube along their travel, in every grasp. So along it the cube is released again with the same error,
which the correction takes off. Along the fingers the cube stays in the jaws as it was gripped. Its first grasp was
elsewhere, but the next one is beside the pocket: from there the arm moves it by a few mm, with an error that cancels.
Only what a second look still measures along the fingers is taken off, too.

If the measured offset does not explain why the cube did not seat, it is released there once more, then at the points
of a spiral.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from arm.se3 import Array, frozen, inverse
from cell.scene.displaced import shifted
from plan.scene import Station

EXPLAINS = 0.5e-3  # m; a smaller offset does not explain why a cube did not seat
PITCH = 0.7e-3  # m, radius of the spiral's first point, a third of a pocket's capture
GOLDEN = np.pi * (3.0 - np.sqrt(5.0))  # rad between successive points, so that they fill a disc evenly
ALIGNED = 0.7  # least cosine between an axis of the jaws and of the place


@dataclass(frozen=True)
class Search:
    """Releases of one cube at one place.

    Attributes:
        shift: of the next release in the plane of the place, (2,) m.
        tried: releases that did not seat the cube.
        spiral: points of the spiral that were used.
        along: axis of the place, 0 or 1, along which the jaws travelled at the last release.
    """

    shift: tuple[float, float] = (0.0, 0.0)
    tried: int = 0
    spiral: int = 0
    along: int = 0

    def after(self, T_base_place: Array, T_base_tool: Array, offset: Array | None) -> Search:
        """Return the search after a release that did not seat the cube.

        Args:
            T_base_place: pose of the place.
            T_base_tool: pose of the tool at the release.
            offset: of that release from the axis of the place, (2,) m; None: unknown.
        """
        jaws = T_base_place[:3, :2].T @ T_base_tool[:3, 1]
        along = int(np.argmax(np.abs(jaws)))
        shift, spiral = np.array(self.shift), self.spiral
        if offset is not None and float(np.hypot(*offset)) >= EXPLAINS:
            both = self.tried > 0 and along == self.along
            shift -= offset if both else offset * (np.arange(2) == along)
        elif offset is not None and self.tried > 0:
            shift += spiral_point(spiral + 1) - spiral_point(spiral)
            spiral += 1
        return Search((float(shift[0]), float(shift[1])), self.tried + 1, spiral, along)

    def station(self, station: Station, T_base_place: Array) -> Station:
        """Return the station of the next release: shifted, with the jaws' travel as at the last one."""
        if not self.tried:
            return station
        shift = frozen(np.array(self.shift))
        grips = tuple(
            shifted(T, T_base_place, shift)
            for T in station.T_base_tool
            if abs(float((inverse(T_base_place) @ T)[self.along, 1])) > ALIGNED
        )
        return replace(station, T_base_tool=grips)


def spiral_point(number: int) -> Array:
    """Return point `number` of the spiral, (2,) m; 0 is its middle."""
    radius = PITCH * np.sqrt(number)
    return frozen(radius * np.array([np.cos(GOLDEN * number), np.sin(GOLDEN * number)]))
