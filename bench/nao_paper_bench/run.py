"""The measurement of a NAO as its paper has it: drive to each stance, look at the board three times, write it down."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from arm.errors import ImpossibleError
from arm.se3 import Array, frozen
from calib.chain.fit import Problem, Sightings
from calib.nao.chain import SIDES, NaoUnknowns, nao_sightings
from calib.nao.recording import NaoRecording
from cell.sim.target_photos import Shot, photograph_target
from nao_paper_bench.kinematics import ON_ITS_BACK, NaoKinematics
from nao_paper_bench.robot import Servos, SimulatedNao
from nao_paper_bench.stance_design import Plan
from nao_paper_bench.stance_pool import Stance, collision_free_motion, resting_posture
from nao_paper_bench.table_2 import (
    CHECKERBOARD,
    NAO_CAMERA,
    PAPER_PIXEL_SIGMA,
    T_SOLE_TARGET,
    VERTICES,
    paper_problem,
)
from render.light import Light
from vision.camera.model import Image
from vision.targets.target import TargetFinder

_ROOM = Shot(light=Light(shadow=0.0, lamp=(0.3, -0.5, -2.0)))  # the lamp is behind the camera
_FARTHEST_PX = (
    120.0  # an uncalibrated NAO's vertices are nearer to where they are expected, half a turn is not
)

See = Callable[[Array], Array]
"""Vertices (24, 2) px, NaN if they are not found, from the true pose T_camera_board."""


@dataclass(frozen=True, eq=False)
class NaoImages:
    """Images of one sole's board.

    Attributes:
        side: L or R.
        stances: number of each image's stance, (n,).
        leg, head: encoders (n, 6) and (n, 2), rad.
        pixels: (n, 24, 2), NaN where the board was not found.
    """

    side: str
    stances: npt.NDArray[np.intp]
    leg: Array
    head: Array
    pixels: Array

    def sightings(self, unknowns: NaoUnknowns) -> Sightings:
        """For a fit."""
        return nao_sightings(
            self.side, unknowns, self.stances, self.leg, self.head, VERTICES, self.pixels, ON_ITS_BACK
        )


@dataclass(frozen=True, eq=False)
class NaoMeasurement:
    """What a run has collected.

    Attributes:
        images: of both legs.
        duration: of the robot's time, s.
        missed: images in which the board was not found.
    """

    images: tuple[NaoImages, ...]
    duration: float
    missed: int

    def problem(self, unknowns: NaoUnknowns, pixel_sigma: Array, reading_sigma: float) -> Problem:
        """All of `unknowns` looked for, from zero.

        Args:
            unknowns: that are looked for.
            pixel_sigma: of vertices, (2,) px.
            reading_sigma: of the encoders, rad; 0 for the paper's cost, which takes them as exact.
        """
        return paper_problem(
            [i.sightings(unknowns) for i in self.images], unknowns, pixel_sigma, reading_sigma
        )


@dataclass
class NoisyVertices:
    """Sees vertices where they are, with noise; quick."""

    rng: np.random.Generator
    sigma: Array = field(default_factory=lambda: PAPER_PIXEL_SIGMA)

    def __call__(self, T_camera_board: Array) -> Array:
        """See `See`."""
        pixels = NAO_CAMERA.project(VERTICES @ T_camera_board[:3, :3].T + T_camera_board[:3, 3])
        return np.asarray(pixels + self.sigma * self.rng.standard_normal(pixels.shape))


@dataclass(frozen=True, eq=False)
class SeenBoard:
    """An image and the vertices (24, 2) px that were found in it, in either order."""

    image: Image
    vertices: Array


class RenderedVertices:
    """Renders the board, finds its vertices in the image, and keeps the images that are asked for."""

    def __init__(self, rng: np.random.Generator, keep: Sequence[int] = ()) -> None:
        self.kept: dict[int, SeenBoard] = {}
        self._rng, self._keep, self._count = rng, set(keep), 0
        self._finder = TargetFinder(CHECKERBOARD)

    def __call__(self, T_camera_board: Array) -> Array:
        """See `See`; in one of the two orders that half a turn of the board leaves open."""
        image = photograph_board(T_camera_board, self._rng)
        found = self._finder.find(image)
        vertices = np.full((len(VERTICES), 2), np.nan) if found is None else found.corners_px
        if self._count in self._keep:
            self.kept[self._count] = SeenBoard(image, vertices)
        self._count += 1
        return vertices


def photograph_board(T_camera_board: Array, rng: np.random.Generator) -> Image:
    """The lower camera's image of a board at a pose, (480, 640) uint8."""
    return photograph_target(NAO_CAMERA, CHECKERBOARD, T_camera_board @ T_SOLE_TARGET, rng, _ROOM)


def turned_as_expected(pixels: Array, expected: Array) -> Array:
    """Vertices (24, 2) in the order in which they are nearer to where they are expected; NaN if neither is near.

    A board of 7 x 5 tiles looks the same after half a turn: only where it should be tells.
    """
    both = (pixels, pixels[::-1])
    off = [float(np.linalg.norm((p - expected).mean(axis=0))) + _apart(p, expected) for p in both]
    nearer = int(np.argmin(off))
    return both[nearer] if off[nearer] < _FARTHEST_PX else np.full_like(pixels, np.nan)


def _apart(a: Array, b: Array) -> float:
    """Rms distance of two point sets about their own middles, px."""
    return float(np.sqrt(np.mean(((a - a.mean(axis=0)) - (b - b.mean(axis=0))) ** 2)))


def way_to(at: Array, posture: Array) -> list[Array]:
    """Postures to send one after the other: the last alone if the way is free, else over rest.

    Raises:
        ImpossibleError: neither way is free.
    """
    rest = resting_posture()
    if collision_free_motion(at, posture):
        return [posture]
    if collision_free_motion(at, rest) and collision_free_motion(rest, posture):
        return [rest, posture]
    raise ImpossibleError(
        "a stance of the plan has no free way to it, neither from the one before nor from rest; plan anew",
        posture_rad=posture.tolist(),
    )


def measure(
    robot: SimulatedNao, plan: Plan, see: See, expected: NaoKinematics, settles: bool = True
) -> NaoMeasurement:
    """Drive to all stances of a plan and look at the board in every posture of the head.

    Args:
        robot: on its back, at rest.
        plan: stances in an order.
        see: finds the vertices.
        expected: the NAO as it is believed to be, which tells the two orders of vertices apart.
        settles: whether it waits until image and encoders show the same; otherwise it looks when it should be there.

    Raises:
        ImpossibleError: a stance has no free way to it.
        ExecutionStopped: the robot does not come to rest.
    """
    at = resting_posture()
    rows: dict[str, list[tuple[int, Array, Array, Array]]] = {side: [] for side in SIDES}
    missed = 0
    for number, stance in enumerate(plan.stances):
        for head in stance.heads:
            posture = stance.posture(head)
            for step in way_to(at, posture):
                robot.wait(robot.send(step))
            at = posture
            if settles:
                robot.settle()
            pixels, leg, looking = _look(robot, stance, see, expected)
            if np.isnan(pixels).all():
                missed += 1
                continue
            rows[stance.side].append((number, leg, looking, pixels))
    for step in way_to(at, resting_posture()):
        robot.wait(robot.send(step))
    images = tuple(
        NaoImages(
            side,
            np.array([r[0] for r in found], dtype=np.intp),
            *(frozen(np.array([r[k] for r in found])) for k in (1, 2, 3)),
        )
        for side, found in rows.items()
        if found
    )
    return NaoMeasurement(images, robot.time, missed)


def _look(
    robot: SimulatedNao, stance: Stance, see: See, expected: NaoKinematics
) -> tuple[Array, Array, Array]:
    """Vertices and the readings that came with them."""
    glimpse, readings = robot.image(), robot.encoders()
    side, leg, head = stance.side, robot.of_leg(stance.side, readings), robot.of_head(readings)
    T = robot.true.T_camera_board(
        side, robot.of_leg(side, glimpse.angles)[None], robot.of_head(glimpse.angles)[None], ON_ITS_BACK
    )[0]
    believed = expected.T_camera_board(side, leg[None], head[None], ON_ITS_BACK)[0]
    where = NAO_CAMERA.project(VERTICES @ believed[:3, :3].T + believed[:3, 3])
    return turned_as_expected(see(T), where), leg, head


def run_measurement(
    true: NaoKinematics,
    plan: Plan,
    rng: np.random.Generator,
    servos: Servos | None = None,
    see: See | None = None,
    settles: bool = True,
) -> NaoMeasurement:
    """A whole run of a simulated NAO that nothing is known of; vertices are drawn, not rendered, unless `see` does."""
    robot = SimulatedNao(true, resting_posture(), rng, servos)
    nothing = NaoKinematics(NaoUnknowns(), np.zeros(len(NaoUnknowns().names)))
    return measure(robot, plan, see or NoisyVertices(rng), nothing, settles)


def recording_of(m: NaoMeasurement) -> NaoRecording:
    """A run as a recording, images without a board left out."""
    side = np.concatenate([np.full(len(i.stances), SIDES.index(i.side)) for i in m.images])
    stances, leg, head_q, pixels = (
        np.concatenate([getattr(i, key) for i in m.images]) for key in ("stances", "leg", "head", "pixels")
    )
    seen = np.isfinite(pixels[..., 0]).all(axis=1)
    board = (NAO_CAMERA, VERTICES, np.asarray(ON_ITS_BACK, dtype=float))
    return NaoRecording(*board, side[seen], stances[seen], leg[seen], head_q[seen], pixels[seen])
