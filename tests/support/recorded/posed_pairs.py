"""Pairs of poses with known calibration and noise."""

import numpy as np
from scipy.spatial.transform import Rotation

from arm.se3 import Array, inverse, rotation, transform
from calib.robot_world.reml import inverses
from calib.robot_world.solve import PosePairs, RobotWorld

HELD = transform(rotation([0.2, -0.3, 0.8]), (0.03, -0.02, 0.08))

STANDING = transform(rotation([3.0, 0.3, 0.2]), (0.5, 0.1, 0.9))


def twisted(rng: np.random.Generator, T: Array, shift: float, turn: float) -> Array:
    """T times small random motions, of sizes in m and rad, per axis or for all."""
    noise = np.tile(np.eye(4), (len(T), 1, 1))
    noise[:, :3, :3] = Rotation.from_rotvec(rng.standard_normal((len(T), 3)) * turn).as_matrix()
    noise[:, :3, 3] = rng.standard_normal((len(T), 3)) * shift
    return T @ noise


def views(rng: np.random.Generator, n: int, in_gripper: bool) -> tuple[Array, Array]:
    """T_base_gripper and T_camera_target without error: the target 0.4 to 0.8 m away, tilted up to 45 deg, any roll."""
    seen = np.tile(np.eye(4), (n, 1, 1))
    tilt = Rotation.from_rotvec(np.c_[rng.uniform(-0.6, 0.6, (n, 2)), np.zeros(n)])
    roll = Rotation.from_rotvec(np.c_[np.zeros((n, 2)), rng.uniform(-np.pi, np.pi, n)])
    seen[:, :3, :3] = (Rotation.from_rotvec([np.pi, 0.0, 0.0]) * tilt * roll).as_matrix()
    seen[:, :3, 3] = np.c_[rng.uniform(-0.08, 0.08, (n, 2)), rng.uniform(0.4, 0.8, n)]
    if in_gripper:
        return STANDING @ inverses(HELD @ seen), seen
    return STANDING @ seen @ inverse(HELD), seen


def drawn(
    seed: int,
    n: int = 20,
    in_gripper: bool = False,
    across: float = 1e-3,
    along: float = 3e-3,
    turn: float = 2e-3,
    arm: tuple[float, float] = (0.2e-3, 0.3e-3),
) -> PosePairs:
    """Pairs whose camera errs along its axes and whose arm errs about the flange."""
    rng = np.random.default_rng(seed)
    said, seen = views(rng, n, in_gripper)
    seen = twisted(rng, seen, 0.0, turn)
    seen[:, :3, 3] += rng.standard_normal((n, 3)) * (across, across, along)
    return PosePairs(twisted(rng, said, *arm), seen, in_gripper)


def off(found: RobotWorld) -> Array:
    """Twists (12,) from what was found to the truth."""
    E = [inverse(found.T_held) @ HELD, inverse(found.T_standing) @ STANDING]
    return np.concatenate([np.r_[e[:3, 3], Rotation.from_matrix(e[:3, :3]).as_rotvec()] for e in E])


def nees(found: RobotWorld) -> float:
    """Error of what was found in units of its covariance, squared, per number: near 1 if that is honest."""
    return float(off(found) @ np.linalg.solve(found.covariance, off(found)) / 12.0)


def cone(seed: int, half_deg: float, turns_deg: tuple[float, float], n: int = 20) -> tuple[Array, Array]:
    """R_base_gripper of motions about axes in a cone, either way round."""
    rng = np.random.default_rng(seed)
    main, R = Rotation.random(random_state=rng), [Rotation.random(random_state=rng)]
    for _ in range(n - 1):
        z, around = rng.uniform(np.cos(np.radians(half_deg)), 1.0), rng.uniform(-np.pi, np.pi)
        axis = main.apply([np.sqrt(1 - z * z) * np.cos(around), np.sqrt(1 - z * z) * np.sin(around), z])
        R.append(
            R[-1] * Rotation.from_rotvec(axis * np.radians(rng.uniform(*turns_deg)) * rng.choice([-1, 1]))
        )
    return np.array([r.as_matrix() for r in R]), main.apply([0.0, 0.0, 1.0])
