"""Find the camera's pose from pairs of poses alone, of the gripper and of a target that it holds, here simulated."""

import numpy as np
from scipy.spatial.transform import Rotation

from a465 import PosePairs, calibrate_pose_pairs, inverse, rot_x, transform

rng = np.random.default_rng(1)
T_base_camera = transform(rot_x(np.pi), (0.45, 0.0, 1.20))  # what the calibration must find
T_gripper_target = transform(t=(0.10, 0.0, 0.02))


def near(T: np.ndarray, shift: float, turn: float) -> np.ndarray:
    """T with an error of its own: standard deviations in m and rad."""
    return T @ transform(
        Rotation.from_rotvec(rng.normal(0.0, turn, 3)).as_matrix(), rng.normal(0.0, shift, 3)
    )


arm: list[np.ndarray] = []
seen: list[np.ndarray] = []
for _ in range(30):
    tilted = Rotation.from_euler("xyz", rng.uniform((-0.6, -0.6, -1.5), (0.6, 0.6, 1.5))).as_matrix()
    T_base_gripper = transform(rot_x(np.pi) @ tilted, rng.uniform((0.3, -0.2, 0.1), (0.6, 0.2, 0.4)))
    T_camera_target = inverse(T_base_camera) @ T_base_gripper @ T_gripper_target
    arm.append(near(T_base_gripper, 0.0002, 0.0003))
    seen.append(near(T_camera_target, 0.0005, 0.002))
seen[7] = near(seen[7], 0.05, 0.5)  # one pair is wrong, as from another target

found = calibrate_pose_pairs(PosePairs(np.array(arm), np.array(seen)))
off = np.linalg.norm(found.T_standing[:3, 3] - T_base_camera[:3, 3])
sigma = np.sqrt(np.trace(found.covariance[6:9, 6:9]))
print(f"camera: {1e3 * off:.2f} mm off, standard deviation {1e3 * sigma:.2f} mm")
print(f"least certain: {found.weakest}")
print(f"not used: pairs {', '.join(map(str, np.flatnonzero(~found.inliers)))}")
