"""The true camera of the simulated cell: where it is at each image, and what it makes of the light."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from arm.robot.shapes import Body
from arm.se3 import Array, frozen, rotation, transform
from cell.files.world import World
from cell.sim.made import texture
from render.light import Light
from render.rays import Floats, smooth_displacement
from render.renderer import Exposure, PlacedBoard, exposed, render, with_noise
from render.solids import BodySolid, Solid
from render.surface import TexturedSolid
from vision.camera.model import Camera, Image

if TYPE_CHECKING:
    from cell.sim.cell import SimulatedCell

_SWAY, _DRIFT = 7, 8  # what a sequence of random numbers is for
DRIFT_PERIODS_S = (240.0, 1500.0)  # shortest and longest wave of the slow shift
_WAVES = 4
TABLE = "table"  # name of the body that has a texture


class TrueCamera:
    """A camera that sways, scatters corners and exposes as the world file says; by default it does none of it.

    Args:
        camera: where it was when it was measured, with its true lens.
        world: its errors.

    Attributes:
        noise: draws the noise of the images.
    """

    def __init__(self, camera: Camera, world: World) -> None:
        self._world = world
        self._image = world.image
        self._still = camera
        if np.any(self._image.turned):
            self._still = camera.at(frozen(camera.T_base_camera @ transform(rotation(self._image.turned))))
        self.noise = np.random.default_rng(world.seed)
        self._taken = 0
        self.texture = texture(world)

    @property
    def alike(self) -> bool:
        """Whether images of one moment differ by their noise alone."""
        image = self._image
        return not (image.sway or image.sway_turn or image.corner_scatter or image.exposure_scatter)

    def at(self, number: int, now_ms: int) -> Camera:
        """The camera at its image `number`, at an emulated time."""
        image = self._image
        shift = image.drift * drift(self._world.seed, now_ms / 1e3)
        rng = np.random.default_rng([self._world.seed, _SWAY, number])
        shift = shift + image.sway * rng.standard_normal(2)
        turn = image.sway_turn * float(rng.standard_normal())
        if not shift.any() and not turn:
            return self._still
        return self._still.at(frozen(self._still.T_base_camera @ shaken(self._still, shift, turn)))

    def images(
        self,
        count: int,
        now_ms: int,
        bodies: Sequence[Body],
        boards: Sequence[PlacedBoard],
        dictionary: str,
        others: Sequence[Solid],
        light: Light | None = None,
    ) -> list[Image]:
        """Take `count` images of one moment; other arguments as of `render.renderer.render`."""
        if not self.texture.plain:
            textured = [b for b in bodies if b.name == TABLE]
            bodies = [b for b in bodies if b.name != TABLE]
            others = [*others, *(TexturedSolid(BodySolid(b, Light()), self.texture) for b in textured)]
        draw = partial(
            render, bodies=bodies, boards=boards, dictionary=dictionary, light=light, others=others
        )
        images: list[Image] = []
        clean: Floats | None = None
        for _ in range(count):
            if clean is None or not self.alike:
                clean = self._clean(now_ms, draw)
            images.append(with_noise(clean, self.noise, self._world.noise_grey))
            self._taken += 1
        return images

    def _clean(self, now_ms: int, draw: Callable[..., Floats]) -> Floats:
        """The image without noise that `draw` makes for the present camera, its blur and its displacement."""
        image = self._image
        camera = self.at(self._taken, now_ms)
        rng = np.random.default_rng([self._world.seed, _SWAY, self._taken, 1])
        displaced = (
            smooth_displacement(camera.size, rng, image.corner_scatter) if image.corner_scatter else None
        )
        gain = image.exposure * (1.0 + image.exposure_scatter * float(rng.standard_normal()))
        seen = draw(camera, psf_px=image.blur, displaced=displaced)
        across, down = image.gradient.tolist()
        return exposed(seen, Exposure(max(gain, 0.0), image.gamma, (across, down)))


def drift(seed: int, time_s: float) -> Array:
    """A slow random motion (2,) of unit variance at a time: waves of random period and phase."""
    rng = np.random.default_rng([seed, _DRIFT])
    low, high = np.log(DRIFT_PERIODS_S)
    periods = np.exp(rng.uniform(low, high, (2, _WAVES)))
    phases = rng.uniform(0.0, 2.0 * np.pi, (2, _WAVES))
    waves = np.sin(2.0 * np.pi * time_s / periods + phases).sum(axis=1)
    return np.asarray(np.sqrt(2.0 / _WAVES) * waves)


def shaken(camera: Camera, shift_px: Array, turn: float) -> Array:
    """Rotation T_camera_shaken (4x4) that shifts the middle of the image by `shift_px` (2,) and rolls by `turn` rad."""
    dx, dy = shift_px
    return transform(rotation([dy / camera.K[1, 1], -dx / camera.K[0, 0], turn]))


class SimulatedCamera:
    """Render the simulated cell at the moment of each grab (`vision.camera.frame_source.FrameSource`).

    A grab is one moment. Unless the world file makes images of one moment differ, it is one rendering with `count`
    draws of noise.

    Args:
        simulated: the cell.
        camera: the true camera.
        counts: returns the present encoder counts of the arm.
        dictionary: of the true markers.
    """

    def __init__(
        self, simulated: SimulatedCell, camera: Camera, counts: Callable[[], npt.ArrayLike], dictionary: str
    ) -> None:
        self._simulated = simulated
        self._counts = counts
        self._dictionary = dictionary
        self._camera = TrueCamera(camera, simulated.world)

    def grab(self, count: int) -> list[Image]:
        """`count` frames, (h, w) grey."""
        simulated, counts = self._simulated, self._counts()
        bodies = simulated.bodies(counts, simulated.true_robot(simulated.jaw_opening))
        boards = [PlacedBoard(b.board, b.T_base_board, b.prints) for b in simulated.world.boards]
        others = simulated.targets(counts)
        return self._camera.images(count, simulated.now_ms(), bodies, boards, self._dictionary, others)
