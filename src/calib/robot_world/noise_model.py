"""How pairs of poses scatter: covariances with unknown sizes, for the camera's share and for the arm's.

A pose that comes from an image is worse along the line of sight and in tilt than across and in roll, more so the
smaller the target is in the image; one from a tracker may scatter the same everywhere. An arm's errors turn what it
holds about the flange, and its wrong lengths and zeros add an error that changes smoothly from pose to pose. Weighing
all of that alike costs up to a factor of five (fact sheet of calibration, section 1), and so does the wrong shape, so
the sizes are estimated and the shape is chosen from the data.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from arm.se3 import Array

Shape = Literal["axes", "image"]

FLOOR = 1e-8  # m and rad: nothing is measured better
_SIZES = (np.log(1e-7), np.log(0.5))
_TYPICAL_SD = (
    3.0  # of the logarithm of a size about its typical value: it decides nothing that is measured at all
)
_TYPICAL = {
    "camera across": 1e-3,
    "camera along": 3e-3,
    "camera turn": 3e-3,
    "image": 5e-4,
    "arm shift": 3e-4,
    "arm turn": 5e-4,
    "arm geometry shift": 3e-4,
    "arm geometry turn": 3e-4,
}
_TARGET, _TARGET_SD = 0.06, 1.0  # m, half the size of a target, and of its logarithm
_CORNERS = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
_STEP = 1e-6


@dataclass(frozen=True, eq=False)
class Linearised:
    """Pairs of poses about an estimate; errors are measured minus predicted poses of the target in the camera.

    Attributes:
        residuals: (n, 6): shift in the camera frame in m, then turn in the target frame in rad.
        by_unknowns: (n, 6, 12): of the predicted pose by the twists of the two unknown poses.
        by_arm: (n, 6, 6): of the predicted pose by a twist of the flange.
        T_camera_target: (n, 4, 4) predicted.
        T_base_gripper: (n, 4, 4) from the arm.
    """

    residuals: Array
    by_unknowns: Array
    by_arm: Array
    T_camera_target: Array
    T_base_gripper: Array

    @property
    def nearest(self) -> float:
        """Least depth of the target, m."""
        return float(self.T_camera_target[:, 2, 3].min())


@dataclass(frozen=True)
class Scatter:
    """A shape of scatter.

    Attributes:
        shape: "axes": the camera's errors have one size across the line of sight, one along it, and one in turn;
            "image": they are those of a flat target's points in the image, of unknown size.
        off_centre: whether the target's origin may lie beside its middle ("image" only).
        geometry: whether the arm has errors that change smoothly with its pose too.
        freedom: of Student's t, for pairs that stray; None for a bell curve.
    """

    shape: Shape = "axes"
    off_centre: bool = False
    geometry: bool = False
    freedom: float | None = None

    @property
    def names(self) -> list[str]:
        """Of the sizes, in order; those of the arm's geometry come last."""
        camera = ["camera across", "camera along", "camera turn"] if self.shape == "axes" else ["image"]
        target = ["target", *(["middle x", "middle y"] if self.off_centre else [])]
        return [
            *camera,
            "arm shift",
            "arm turn",
            *(target if self.shape == "image" else []),
            *(["arm geometry shift", "arm geometry turn"] if self.geometry else []),
        ]


@dataclass(frozen=True, eq=False)
class Covariances:
    """Covariances of pairs about an estimate, for given sizes.

    Attributes:
        scatter: shape.
        at: the pairs.
    """

    scatter: Scatter
    at: Linearised
    parts: Array = field(init=False)  # (sizes, n, 6, 6) of the sizes that are standard deviations
    smooth: Array = field(init=False)  # (n, 6, effects) of the arm's geometry, half shifts and half turns

    def __post_init__(self) -> None:
        n = len(self.at.residuals)
        parts = []
        if self.scatter.shape == "axes":
            parts = [
                np.broadcast_to(np.diag([float(k in chosen) for k in range(6)]), (n, 6, 6))
                for chosen in ((0, 1), (2,), (3, 4, 5))
            ]
        shift, turn = self.at.by_arm[:, :, :3], self.at.by_arm[:, :, 3:]
        parts += [shift @ shift.transpose(0, 2, 1), turn @ turn.transpose(0, 2, 1)]
        object.__setattr__(self, "parts", np.array(parts))
        object.__setattr__(self, "smooth", self._smooth() if self.scatter.geometry else np.zeros((n, 6, 0)))

    def _smooth(self) -> Array:
        """Shifts and turns of the flange in the base that are linear in where it is and how it is turned."""
        R, p = self.at.T_base_gripper[:, :3, :3], self.at.T_base_gripper[:, :3, 3]
        off = p - p.mean(axis=0)
        reach = float(np.sqrt((off**2).sum(axis=1).mean())) or 1.0
        features = np.concatenate([off / reach, R.reshape(-1, 9) / np.sqrt(3.0)], axis=1)
        in_base = [self.at.by_arm[:, :, k : k + 3] @ R.transpose(0, 2, 1) for k in (0, 3)]
        return np.concatenate(
            [np.einsum("nij,nf->nijf", G, features).reshape(len(p), 6, -1) for G in in_base], axis=2
        )

    def typical(self) -> tuple[Array, Array]:
        """Where the sizes are looked for first, and how far from it they may well be."""
        means, sds = [], []
        for name in self.scatter.names:
            if name.startswith("middle"):
                means.append(0.0)
                sds.append(2.0)
            elif name == "target":
                means.append(min(np.log(_TARGET), self._largest() - 1.0))
                sds.append(_TARGET_SD)
            else:
                means.append(np.log(_TYPICAL[name]))
                sds.append(_TYPICAL_SD)
        return np.array(means), np.array(sds)

    def bounds(self) -> list[tuple[float, float]]:
        """Of the sizes."""
        found = []
        for name in self.scatter.names:
            if name.startswith("middle"):
                found.append((-2.0, 2.0))
            elif name == "target":
                found.append((np.log(2e-3), self._largest()))
            else:
                found.append(_SIZES)
        return found

    def _largest(self) -> float:
        """A target so large that a part of it would come behind the camera tells nothing of its points."""
        return float(np.log(0.15 * max(self.at.nearest, 0.05)))

    def __call__(self, sizes: Array) -> tuple[Array, Array]:
        """Covariances (n, 6, 6) for sizes, and their derivatives (sizes but for the geometry, n, 6, 6)."""
        first = 0 if self.scatter.shape == "axes" else 1
        count = len(self.parts)
        squares = np.exp(2.0 * sizes[first : first + count])
        S = np.tensordot(squares, self.parts, 1) + FLOOR**2 * np.eye(6)
        derivatives = list(2.0 * squares[:, None, None, None] * self.parts)
        if first:
            target = sizes[1 + count : 1 + count + (3 if self.scatter.off_centre else 1)]
            scale = np.exp(2.0 * sizes[0])
            unit = self._image(target)
            S = S + scale * unit
            derivatives.insert(0, 2.0 * scale * unit)
            for step in _STEP * np.eye(len(target)):
                derivatives.append(scale * (self._image(target + step) - unit) / _STEP)
        return S, np.array(derivatives)

    def _image(self, target: Array) -> Array:
        """Covariances of poses from the corners of a square, with unit error in normalised coordinates."""
        middle = target[1:] if len(target) > 1 else 0.0
        points = np.zeros((len(_CORNERS), 3))
        points[:, :2] = np.exp(target[0]) * (_CORNERS + middle)
        R, t = self.at.T_camera_target[:, :3, :3], self.at.T_camera_target[:, :3, 3]
        seen = points @ R.transpose(0, 2, 1) + t[:, None]
        z = np.maximum(seen[..., 2], 1e-3)
        by_point = np.zeros((*z.shape, 2, 3))
        by_point[..., 0, 0] = by_point[..., 1, 1] = 1.0 / z
        by_point[..., :, 2] = -seen[..., :2] / z[..., None] ** 2
        turned = -R[:, None] @ skews(points)
        by_pose = np.concatenate([by_point, by_point @ turned], axis=-1).reshape(len(R), -1, 6)
        return np.asarray(np.linalg.inv(by_pose.transpose(0, 2, 1) @ by_pose))


def skews(v: Array) -> Array:
    """Matrices (..., 3, 3) with which vectors (..., 3) are multiplied from the left in a cross product."""
    zero = np.zeros(v.shape[:-1])
    rows = [[zero, -v[..., 2], v[..., 1]], [v[..., 2], zero, -v[..., 0]], [-v[..., 1], v[..., 0], zero]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
