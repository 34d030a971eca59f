"""Cast rays at convex hulls."""

from __future__ import annotations

import numpy as np

from arm.robot.shapes import Convex, hull_faces
from arm.se3 import Indices, frozen
from render.rays import Bundle, Floats

_SAME_PLANE = 1e-7  # m and rad; triangles of one flat face differ by less


class Hull:
    """The faces of a convex body: points p inside have normals @ p <= offsets.

    Attributes:
        normals: (m, 3), unit, outwards.
        offsets: (m,) m.
    """

    def __init__(self, shape: Convex) -> None:
        faces = hull_faces(shape)
        planes = np.column_stack([faces.normals, faces.offsets])
        _, first = np.unique(np.round(planes / _SAME_PLANE), axis=0, return_index=True)
        self.normals = frozen(planes[np.sort(first), :3])
        self.offsets = frozen(planes[np.sort(first), 3])

    def enter(self, rays: Bundle, seam: float) -> tuple[Floats, Indices]:
        """Return the depth at which rays from outside enter (infinite for misses), and the number of the face.

        A ray is inside between the last face that it crosses inwards and the first that it crosses outwards; it may
        miss by `seam` m between two faces.
        """
        entry = np.full(rays.dx.shape, -np.inf, dtype=np.float32)
        leave = np.full(rays.dx.shape, np.inf, dtype=np.float32)
        face = np.zeros(rays.dx.shape, dtype=np.intp)
        for number, (normal, offset) in enumerate(zip(self.normals, self.offsets, strict=True)):
            nx, ny, nz = normal.astype(np.float32)
            along = nx * rays.dx + ny * rays.dy + nz * rays.dz
            height = np.float32(offset - normal @ rays.origin)  # of the face above the ray's origin
            with np.errstate(divide="ignore", invalid="ignore"):  # rays along the face
                t = height / along
            inwards = along < 0.0
            later = inwards & (t > entry)
            np.copyto(entry, t, where=later)
            face[later] = number
            np.copyto(leave, np.minimum(leave, t), where=along > 0.0)
            leave[(along == 0.0) & (height < 0.0)] = -np.inf
        met = (entry > 0.0) & (entry <= leave + np.float32(seam))
        return np.where(met, entry, np.float32(np.inf)), face
