"""Recordings of an A465 that holds a target before a fixed camera, drawn from stated truths.

Nothing of `calib` makes them: the arm is a product of Denavit-Hartenberg matrices written here, so that a mistake in
the chain that is fitted cannot hide in the pictures. Camera, mounts, noise and ranges are those of the recorded sets.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from arm.robot.dh import DhTable
from arm.se3 import Array, apply, frozen, inverse, orthonormalised, rot_x, rot_y, rot_z, transform
from calib.recordings.arm import ArmRecording
from vision.camera.model import Camera

HALF = np.pi / 2
NOMINAL = DhTable(
    frozen([0.3052, 0.0, 0.0, 0.3302, 0.0, 0.0762]),
    frozen([0.0, 0.3048, 0.0, 0.0, 0.0, 0.0]),
    frozen([HALF, 0.0, 3 * HALF, HALF, 3 * HALF, 0.0]),
    frozen([0.0, -3 * HALF, -HALF, 0.0, 0.0, 0.0]),
)
LENS = Camera(
    frozen([[4746.48725, 0.0, 1072.72375], [0.0, 4738.03233, 533.49256], [0.0, 0.0, 1.0]]),
    frozen([-0.21867, -1.00296, 5e-05, 0.00311, 8.29851]),
    (1920, 1200),
    np.eye(4),
)
NOISE_PX = 0.3
PLACE = orthonormalised(
    [
        [0.02628860190, 0.99788813552, -0.05939847135, 0.49209],
        [0.99942079914, -0.02495155514, 0.02314057335, -0.01471],
        [0.02160961936, -0.05997240102, -0.99796609936, 1.19294],
        [0.0, 0.0, 0.0, 1.0],
    ]
)
_SLANT = rot_y(np.radians(0.8)) @ rot_x(np.radians(0.5)) @ rot_z(np.radians(-0.6))
MOUNTS = {
    # the plate stands square to the gripper's axis, or lies along it
    "perpendicular": transform(rot_x(np.pi) @ _SLANT, (0.1, 0.003, 0.118)),
    "parallel": transform(np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]) @ _SLANT, (0.012, 0.004, 0.115)),
}
TARGETS = {
    "marker": frozen([(-0.03, 0.03, 0), (0.03, 0.03, 0), (0.03, -0.03, 0), (-0.03, -0.03, 0)]),
    "charuco": frozen([(0.012 * i - 0.018, 0.012 * j - 0.03, 0) for i in range(4) for j in range(6)]),
}
# the arm's postures over the table: what the recorded sets span
LOW_DEG = np.array([-35.0, -62.0, -120.0, -180.0, -105.0, -180.0])
HIGH_DEG = np.array([35.0, 20.0, 15.0, 180.0, 105.0, 180.0])
MARGIN_PX, OBLIQUE, LOWEST, HIGHEST = 40.0, np.radians(55.0), 0.06, 0.65


@dataclass(frozen=True, eq=False)
class Truth:
    """What an arm and its cell really are.

    Attributes:
        offsets: of the joints, (6,) rad.
        d, a, alpha: errors of the links, (6,) m, m and rad.
        T_base_camera, T_gripper_target: 4x4.
        gear: (6,) what the joints turn by over what the readings say.
    """

    offsets: Array
    d: Array
    a: Array
    alpha: Array
    T_base_camera: Array
    T_gripper_target: Array
    gear: Array

    def T_camera_target(self, joints: Array) -> Array:
        """At readings (n, 6) rad; (n, 4, 4)."""
        return np.asarray(inverse(self.T_base_camera) @ self.T_base_gripper(joints) @ self.T_gripper_target)

    def T_base_gripper(self, joints: Array) -> Array:
        """At readings (n, 6) rad; (n, 4, 4)."""
        q = joints * self.gear + self.offsets + NOMINAL.theta_offset
        d, a, alpha = NOMINAL.d + self.d, NOMINAL.a + self.a, NOMINAL.alpha + self.alpha
        c, s, ca, sa = np.cos(q), np.sin(q), np.cos(alpha), np.sin(alpha)
        A = np.zeros((*q.shape, 4, 4))
        A[..., 0, 0], A[..., 0, 1], A[..., 0, 2], A[..., 0, 3] = c, -s * ca, s * sa, a * c
        A[..., 1, 0], A[..., 1, 1], A[..., 1, 2], A[..., 1, 3] = s, c * ca, -c * sa, a * s
        A[..., 2, 1], A[..., 2, 2], A[..., 2, 3], A[..., 3, 3] = sa, ca, d, 1.0
        T = A[:, 0]
        for j in range(1, q.shape[1]):
            T = T @ A[:, j]
        return np.asarray(T)

    def pixels(self, joints: Array, points: Array) -> Array:
        """Where the points (m, 3) appear, (n, m, 2) px, NaN behind the camera."""
        return _pixels(self.T_camera_target(joints), points)


def _pixels(T_camera_target: Array, points: Array) -> Array:
    return LENS.project(
        points @ np.swapaxes(T_camera_target[:, :3, :3], 1, 2) + T_camera_target[:, None, :3, 3]
    )


def draw_truth(rng: np.random.Generator, mount: str = "perpendicular", links: bool = False) -> Truth:
    """Zeros of J2 to J5 within 0.3 deg; links off by 0.3 mm and 0.05 deg if they are wanted; place and mount as in the
    recorded sets, by some mm and degrees."""
    offsets = np.zeros(6)
    offsets[1:5] = np.radians(rng.uniform(-0.3, 0.3, 4))
    d, a, alpha = rng.standard_normal((3, 6)) * np.array([[0.3e-3], [0.3e-3], [np.radians(0.05)]]) * links
    place, held = (
        transform(rot_x(x) @ rot_y(y) @ rot_z(z), shift)
        for (x, y, z), shift in zip(
            np.radians(rng.uniform(-2.0, 2.0, (2, 3))), rng.uniform(-0.01, 0.01, (2, 3)), strict=True
        )
    )
    return Truth(offsets, d, a, alpha, PLACE @ place, MOUNTS[mount] @ held, np.ones(6))


def nominal(mount: str) -> Truth:
    """What is thought of the cell before anything was measured."""
    none = np.zeros(6)
    return Truth(none, none, none, none, PLACE, MOUNTS[mount], np.ones(6))


def seen(truth: Truth, joints: Array, points: Array) -> npt.NDArray[np.bool_]:
    """Which postures (n, 6) show the whole target, not too obliquely, above the table: (n,)."""
    hand = truth.T_base_gripper(joints)
    T = inverse(truth.T_base_camera) @ hand @ truth.T_gripper_target
    towards = -T[:, :3, 3] / np.linalg.norm(T[:, :3, 3], axis=1)[:, None]
    facing = np.einsum("ni,ni->n", towards, T[:, :3, 2]) > np.cos(OBLIQUE)
    low = apply(truth.T_base_camera, T[:, :3, 3])[:, 2]
    found = np.asarray(facing & (low > LOWEST) & (low < HIGHEST) & (hand[:, 2, 3] > LOWEST))
    with np.errstate(invalid="ignore"):
        pixels = _pixels(T[found], points)
        found[found] = ((pixels > MARGIN_PX) & (pixels < np.array(LENS.size) - 1 - MARGIN_PX)).all(
            axis=(1, 2)
        )
    return found


def wide(truth: Truth, points: Array, count: int, rng: np.random.Generator) -> Array:
    """Postures (count, 6) rad from anywhere in the ranges of all joints."""
    found = np.zeros((0, 6))
    while len(found) < count:
        q = np.radians(rng.uniform(LOW_DEG, HIGH_DEG, (20_000, 6)))
        found = np.concatenate([found, q[seen(truth, q, points)]])
    return found[:count]


def recipe(truth: Truth, points: Array, count: int, rng: np.random.Generator) -> Array:
    """Postures by the course report's recipe (section 2.3.3).

    From a level target J4, J5 and J6 turn together until it leaves the image; then J1 goes on. After every five, the
    target comes nearer or goes away and leans a little; after 100, all again 0.1 m higher.
    """
    found: list[Array] = []
    mount = next(name for name, T in MOUNTS.items() if _alike(T, truth.T_gripper_target))
    for height in np.tile([0.15, 0.25, 0.35, 0.45], 3):
        q0 = _level(mount, round(float(height), 3))
        here: list[Array] = []
        for turn in rng.permutation(np.arange(-25.5, 15.0, 1.5)):
            for sense in (1.0, -1.0):
                for step in range(1, 40):
                    q = q0.copy()
                    q[0] += np.radians(turn)
                    q[3:] += np.radians(sense * 2.5 * step) * np.array([1.0, 0.35, 1.0])
                    if len(here) % 5 == 4:
                        q[[1, 2]] += np.radians(rng.uniform(-3.0, 3.0, 2))
                        q[3:] += np.radians(rng.uniform(-10.0, 10.0, 3))
                    if not seen(truth, q[None], points)[0]:
                        break
                    here.append(q)
        found += [here[i] for i in rng.permutation(len(here))[:100]]
        if len(found) >= 400:
            break
    return np.array([found[i] for i in rng.permutation(len(found))[:count]])


def _alike(a: Array, b: Array) -> bool:
    return bool(np.trace(a[:3, :3].T @ b[:3, :3]) > 2.5)


@cache
def _level(mount: str, height: float) -> Array:
    """Posture that holds a target level under the camera's axis at a height."""
    truth = nominal(mount)
    ray = truth.T_base_camera[:3, :3] @ np.append(LENS.normalised(np.array(LENS.size) / 2.0), 1.0)
    eye = truth.T_base_camera[:3, 3]
    wanted = eye + (height - eye[2]) / ray[2] * ray

    def off(q: Array) -> Array:
        T = apply_all(truth, q)
        return np.concatenate([10.0 * (T[:3, 3] - wanted), T[:2, 2], 1e-3 * (q - start)])

    best = None
    for start in np.radians(
        [[0, -30, -100, 0, 40, -180], [0, -40, -90, 0, -50, 0], [0, -20, -110, 0, 30, 90]]
    ):
        found = least_squares(off, start)
        T = apply_all(truth, found.x)
        up = T[2, 2] > 0.9
        if up and (best is None or found.cost < best.cost):
            best = found
    if best is None:
        raise RuntimeError(f"no level posture, mount {mount}, height {height}")
    return np.asarray(best.x)


def apply_all(truth: Truth, q: Array) -> Array:
    """T_base_target at one posture (6,)."""
    return np.asarray(truth.T_base_gripper(q[None])[0] @ truth.T_gripper_target)


SAMPLERS: dict[str, Callable[[Truth, Array, int, np.random.Generator], Array]] = {
    "wide": wide,
    "recipe": recipe,
}


def recorded(
    truth: Truth, joints: Array, kind: str, rng: np.random.Generator, noise_px: float = NOISE_PX
) -> ArmRecording:
    """The target at every posture (n, 6), with noise."""
    pixels = truth.pixels(joints, TARGETS[kind])
    pixels += noise_px * rng.standard_normal(pixels.shape)
    return ArmRecording(LENS, NOMINAL, TARGETS[kind], kind, frozen(joints), frozen(pixels))


def spoilt(
    recording: ArmRecording, part: float, way: str, rng: np.random.Generator
) -> tuple[ArmRecording, npt.NDArray[np.intp]]:
    """A recording of which a part of the images is wrong, and which.

    Args:
        way: "shifted" by 25 px anywhere, "other" image's corners, or "turned" corners, as of a square target that was
            taken for turned by a quarter.
    """
    n = len(recording.joints)
    wrong = np.sort(rng.permutation(n)[: round(part * n)])
    pixels = np.array(recording.pixels)
    if way == "shifted":
        angle = rng.uniform(0.0, 2.0 * np.pi, len(wrong))
        pixels[wrong] += 25.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)[:, None]
    elif way == "other":
        pixels[wrong] = recording.pixels[(wrong + rng.integers(1, n, len(wrong))) % n]
    elif way == "turned":
        pixels[wrong] = pixels[wrong][:, _quarter_turn(recording.points)]
    else:
        raise ValueError(way)
    return replace(recording, pixels=frozen(pixels)), wrong


def _quarter_turn(points: Array) -> npt.NDArray[np.intp]:
    """Which point stands where each is taken for: a quarter turn of a square, half a turn of what is longer."""
    square = np.ptp(points[:, 0]) == np.ptp(points[:, 1])
    turned = points @ rot_z(HALF if square else np.pi).T
    off = np.linalg.norm(turned[:, None] - points, axis=-1)
    return np.asarray(off.argmin(axis=1))
