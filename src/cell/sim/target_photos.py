"""Images of a calibration target in front of a simulated camera."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import count

import numpy as np

from arm.errors import ImpossibleError
from arm.se3 import Array, rot_z, rotation, transform
from cell.files.world import World
from cell.sim.camera import TrueCamera
from cell.sim.made import target_print
from render.light import Light
from render.renderer import render, with_noise
from render.target import TargetSolid
from vision.camera.model import Camera, Image
from vision.targets.target import Target

LEAST_SEEN = 0.6  # least fraction of corners in a view
MARGIN_PX = 5.0
_MOST_TRIES = 1000


@dataclass(frozen=True)
class Shot:
    """Imaging conditions of a target.

    Attributes:
        bend: see `render.target.TargetSolid`, m.
        true_marker: printed edge of the markers, if it differs from the target's, m.
        psf_px: standard deviation of the blur, px.
        noise_grey: of the camera.
        light: of the room.
    """

    bend: float = 0.0
    true_marker: float | None = None
    psf_px: float = 0.7
    noise_grey: float = 2.0
    light: Light = field(default_factory=lambda: Light(shadow=0.0))


def photograph_target(
    camera: Camera, target: Target, T_camera_target: Array, rng: np.random.Generator, shot: Shot | None = None
) -> Image:
    """One image of a target at a pose, (h, w) uint8."""
    shot = shot or Shot()
    solid = TargetSolid(
        target, camera.T_base_camera @ T_camera_target, shot.light, shot.bend, shot.true_marker
    )
    image = render(camera, [], [], psf_px=shot.psf_px, light=shot.light, others=[solid])
    return with_noise(image, rng, shot.noise_grey)


class TargetCamera:
    """The camera of a simulated cell, before which a person holds a target.

    Args:
        camera: nominal one of the cell.
        world: ground truth of the cell, or None for an ideal camera.
        rng: of the noise.

    Attributes:
        camera: the true one.
    """

    def __init__(self, camera: Camera, world: World | None, rng: np.random.Generator) -> None:
        self.camera = camera if world is None or world.camera is None else world.camera
        self._world, self._rng = world, rng
        self._true = None if world is None else TrueCamera(self.camera, world)

    def photograph(self, target: Target, T_camera_target: Array) -> Image:
        """One image of a target at a pose, (h, w) uint8."""
        if self._world is None or self._true is None:
            return photograph_target(self.camera, target, T_camera_target, self._rng)
        light, self._true.noise = Shot().light, self._rng
        T_base_target = self.camera.T_base_camera @ T_camera_target
        solid = TargetSolid(target, T_base_target, light, how=target_print(self._world))
        return self._true.images(1, 0, [], [], "", [solid], light)[0]


def target_pose(
    camera: Camera, target: Target, pixel: Array, distance: float, turn: Array, roll: float
) -> Array:
    """T_camera_target of a target with its centre at `pixel` (2,), `distance` m along the camera's axis.

    Args:
        turn: rotation vector (2,) rad about the image's x and y axes.
        roll: rotation about the target's z axis, applied first, rad.
    """
    R = rotation([*turn, 0.0]) @ rot_z(roll)
    middle = np.append(camera.normalised(pixel), 1.0) * distance
    width, height = target.size
    return transform(R, middle - R @ np.array([width / 2.0, height / 2.0, 0.0]))


def corners_in_view(camera: Camera, target: Target, T_camera_target: Array) -> np.ndarray:
    """Mask (n,) of the inner corners in the image."""
    pixels = camera.project(target.points() @ T_camera_target[:3, :3].T + T_camera_target[:3, 3])
    last = np.array(camera.size) - 1.0 - MARGIN_PX
    return np.asarray(((pixels >= MARGIN_PX) & (pixels <= last)).all(axis=1))


def random_poses(
    camera: Camera,
    target: Target,
    rng: np.random.Generator,
    number: int,
    distances: tuple[float, float] = (0.85, 1.25),
    tilt: float = 0.5,
) -> list[Array]:
    """Random poses T_camera_target that together fill the image.

    Args:
        distances: smallest and largest, m.
        tilt: largest about each axis of the image, rad.

    Raises:
        ImpossibleError: the image is too small for the target at these distances.
    """
    found: list[Array] = []
    size = np.array(camera.size)
    for attempt in count():
        if len(found) == number:
            break
        if attempt > _MOST_TRIES * number:
            raise ImpossibleError(
                f"the target ({target.label()}) does not fit into the image at {distances[0]:g} to "
                f"{distances[1]:g} m; use a smaller target or larger distances",
                distances_m=list(distances),
            )
        pixel = size * rng.uniform(0.15, 0.85, 2)
        distance, turn = rng.uniform(*distances), rng.uniform(-tilt, tilt, 2)
        T = target_pose(camera, target, pixel, distance, turn, rng.uniform(-np.pi, np.pi))
        in_view = corners_in_view(camera, target, T).mean()
        if in_view >= (LEAST_SEEN if target.kind == "charuco" else 1.0):  # a checkerboard is only found whole
            found.append(T)
    return found
