"""Noise models of pairs of poses: covariances with unknown sizes (variance components) for camera and arm.

A pose from an image is less accurate along the line of sight and in tilt than across it and in roll, above all if the
target appears small. A pose from a tracker may scatter isotropically. Angular errors of an arm act about the flange.
Wrong lengths and joint offsets add an error that varies smoothly with the pose. Equal weights cost up to a factor of
five in accuracy (docs/sources.md, "Pose pairs"), and so does a wrong model. Therefore the data decide on the
model and on the sizes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from arm.se3 import Array, cross

Shape = Literal["axes", "image"]

FLOOR = 1e-8  # m and rad: no measurement is better
_SIZES = (np.log(1e-7), np.log(0.5))
_TYPICAL_SD = 3.0  # of a log size about its typical value: too wide to matter once there are measurements
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
_TARGET, _TARGET_SD = 0.06, 1.0  # half the size of a target, m, and the standard deviation of its logarithm
_CORNERS = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
_STEP = 1e-6


@dataclass(frozen=True, eq=False)
class Linearised:
    """Pairs of poses linearised about an estimate; errors are measured minus predicted target poses in the camera.

    Attributes:
        residuals: (n, 6): translation in the camera frame in m, then rotation in the target frame in rad.
        by_unknowns: (n, 6, 12): derivative of the predicted pose by the twists of the two unknown poses.
        by_arm: (n, 6, 6): derivative of the predicted pose by a twist of the flange.
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
        """Smallest depth of the target, m."""
        return float(self.T_camera_target[:, 2, 3].min())


@dataclass(frozen=True)
class NoiseModel:
    """A noise model.

    Attributes:
        shape: "axes": camera errors have one size across the line of sight, one along it and one in rotation;
            "image": they follow from image noise at the points of a flat target of unknown size.
        off_centre: whether the target's origin may differ from its centre ("image" only).
        geometry: whether the arm also has errors that vary smoothly with its pose.
        freedom: degrees of freedom of Student's t, for heavy tails; None for normal errors.
    """

    shape: Shape = "axes"
    off_centre: bool = False
    geometry: bool = False
    freedom: float | None = None

    @property
    def names(self) -> list[str]:
        """Names of the sizes, in order; those of the arm's geometry come last."""
        camera = ["camera across", "camera along", "camera turn"] if self.shape == "axes" else ["image"]
        target = ["target", *(["middle x", "middle y"] if self.off_centre else [])]
        names = [*camera, "arm shift", "arm turn", *(target if self.shape == "image" else [])]
        return [*names, *(["arm geometry shift", "arm geometry turn"] if self.geometry else [])]


@dataclass(frozen=True, eq=False)
class Covariances:
    """Covariances of linearised pairs, for given sizes.

    Attributes:
        scatter: noise model.
        at: the pairs.
    """

    scatter: NoiseModel
    at: Linearised

    @cached_property
    def parts(self) -> Array:
        """Covariances per squared standard deviation, (sizes, n, 6, 6)."""
        n = len(self.at.residuals)
        groups = ((0, 1), (2,), (3, 4, 5)) if self.scatter.shape == "axes" else ()
        camera = [np.broadcast_to(np.diag(np.isin(range(6), of).astype(float)), (n, 6, 6)) for of in groups]
        shift, turn = self.at.by_arm[:, :, :3], self.at.by_arm[:, :, 3:]
        return np.array([*camera, shift @ shift.transpose(0, 2, 1), turn @ turn.transpose(0, 2, 1)])

    @cached_property
    def smooth(self) -> Array:
        """Effects of the arm's geometry, (n, 6, effects): translations, then rotations of the flange in the base.

        They are linear in the position and the rotation of the flange.
        """
        if not self.scatter.geometry:
            return np.zeros((len(self.at.residuals), 6, 0))
        R, p = self.at.T_base_gripper[:, :3, :3], self.at.T_base_gripper[:, :3, 3]
        off = p - p.mean(axis=0)
        reach = float(np.sqrt((off**2).sum(axis=1).mean())) or 1.0
        features = np.concatenate([off / reach, R.reshape(-1, 9) / np.sqrt(3.0)], axis=1)
        in_base = [self.at.by_arm[:, :, k : k + 3] @ R.transpose(0, 2, 1) for k in (0, 3)]
        return np.concatenate(
            [np.einsum("nij,nf->nijf", G, features).reshape(len(p), 6, -1) for G in in_base], axis=2
        )

    def prior(self) -> Array:
        """Mean, standard deviation and bounds of the prior on each size, (sizes, 4)."""
        # a larger target would reach behind the camera
        largest = float(np.log(0.15 * max(self.at.nearest, 0.05)))
        special = {
            "target": (min(np.log(_TARGET), largest - 1.0), _TARGET_SD, np.log(2e-3), largest),
            "middle x": (0.0, 2.0, -2.0, 2.0),
            "middle y": (0.0, 2.0, -2.0, 2.0),
        }
        usual = {name: (np.log(size), _TYPICAL_SD, *_SIZES) for name, size in _TYPICAL.items()}
        return np.array([(usual | special)[name] for name in self.scatter.names])

    def __call__(self, sizes: Array) -> tuple[Array, Array]:
        """Covariances (n, 6, 6) for sizes, and their derivatives (all sizes but the geometry's, n, 6, 6)."""
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
        """Covariances of poses from the corners of a square, for unit error in normalised coordinates."""
        middle = target[1:] if len(target) > 1 else 0.0
        points = np.zeros((len(_CORNERS), 3))
        points[:, :2] = np.exp(target[0]) * (_CORNERS + middle)
        R, t = self.at.T_camera_target[:, :3, :3], self.at.T_camera_target[:, :3, 3]
        in_camera = points @ R.transpose(0, 2, 1) + t[:, None]
        z = np.maximum(in_camera[..., 2], 1e-3)
        by_point = np.zeros((*z.shape, 2, 3))
        by_point[..., 0, 0] = by_point[..., 1, 1] = 1.0 / z
        by_point[..., :, 2] = -in_camera[..., :2] / z[..., None] ** 2
        turned = -R[:, None] @ skews(points)
        by_pose = np.concatenate([by_point, by_point @ turned], axis=-1).reshape(len(R), -1, 6)
        return np.asarray(np.linalg.inv(by_pose.transpose(0, 2, 1) @ by_pose))


def skews(v: Array) -> Array:
    """Cross product matrices (..., 3, 3) of vectors (..., 3)."""
    return cross(np.eye(3), v[..., None, :])
