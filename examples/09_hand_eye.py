"""Calibrate the camera's pose and the arm's joint offsets from images of a target in the gripper, here simulated."""

import numpy as np

from a465 import calibrate_hand_eye, inverse, load_a465, rot_x, transform
from arm.io.storage import data_file
from arm.robot.dh import A465
from calib.recordings.arm import ArmRecording
from vision.camera.model import read_camera

rng = np.random.default_rng(1)
camera = read_camera(data_file("scenes/cameras/lab.toml"))
robot = load_a465(tool_length=0.134112, jaw_opening=0.060)
offsets = np.radians([0.0, 0.2, -0.3, 0.1, -0.2, 0.0])  # what the calibration must find
points = np.array([(0.012 * i - 0.018, 0.012 * j - 0.030, 0.0) for i in range(4) for j in range(6)])
T_tool_target = transform(rot_x(np.pi), (0.100, 0.0, -0.016))

joints: list[np.ndarray] = []
images: list[np.ndarray] = []
while len(joints) < 24:
    q = np.radians(rng.uniform((-35, -62, -120, -180, -105, -180), (35, 20, 15, 180, 105, 180)))
    T_camera_target = inverse(camera.T_base_camera) @ robot.T_base_tool(q + offsets) @ T_tool_target
    facing = -T_camera_target[:3, 2] @ T_camera_target[:3, 3] / np.linalg.norm(T_camera_target[:3, 3]) > 0.6
    pixels = camera.project(points @ T_camera_target[:3, :3].T + T_camera_target[:3, 3])
    if facing and np.all((pixels > 40) & (pixels < np.array(camera.size) - 40)):
        joints.append(q)
        images.append(pixels + rng.normal(0.0, 0.3, pixels.shape))

start = camera.at(np.eye(4))  # the intrinsics are known, the pose is not
found = calibrate_hand_eye(
    ArmRecording(start, A465, points, "ChArUco", np.array(joints), np.array(images)), encoder_step=0.0
)
off = found.T_base_camera[:3, 3] - camera.T_base_camera[:3, 3]
sigma, _ = found.camera_sigma
print(
    f"camera: {1e3 * np.linalg.norm(off):.3f} mm off, standard deviation {1e3 * np.linalg.norm(sigma):.3f} mm"
)
print("joint offsets:", np.round(np.degrees(found.joint_offsets), 3), "deg")
print("accepted" if not found.chain.reasons else "; ".join(found.chain.reasons))
