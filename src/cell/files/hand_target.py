"""A calibration target in the gripper: its file, the arm that carries it, and its pose in the simulated cell."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from arm.io.keys import Keys, key
from arm.io.node import Node
from arm.io.rules import carried, triple, turns
from arm.io.storage import sha256
from arm.numerics.products import mul
from arm.robot.model import LinkBody, Robot
from arm.robot.shapes import Box
from arm.se3 import Array, frozen, inverse, rotation, transform
from calib.recordings.arm import SIZE_RULE, SIZE_WITHIN
from cell.config.bodies import pose_of
from vision.targets.target import KIND, CharucoKeys, CheckerboardKeys, Target, target_of

PLATE = "target plate"
_ROUGH = (0.003, np.radians(2.0))  # standard deviations of a plate mounted by hand, m and rad per axis


@dataclass(frozen=True, eq=False)
class HandTarget:
    """A target on a plate that moves with the flange.

    Attributes:
        target: printed target.
        T_flange_target: nominal pose; its origin is the corner of the chessboard.
        plate: size (3,), m, along x, y and z of the printed side, centred on the chessboard.
        size_within: standard deviation of the print's scale, relative.
    """

    target: Target
    T_flange_target: Array
    plate: tuple[float, float, float]
    size_within: float = SIZE_WITHIN

    def carried_by(self, robot: Robot) -> Robot:
        """Return the arm with the plate as a body of its last joint."""
        flange = inverse(robot.T_end_tool)
        joint = len(robot.joint_names)
        q = np.zeros(joint)
        T_joint_flange = mul(mul(inverse(robot.joint_poses(q)[joint]), robot.T_base_tool(q)), flange)
        width, height = self.target.size
        T_target_plate = transform(
            t=(width / 2.0, height / 2.0, self.plate[2] / 2.0)
        )  # its middle; z goes into it
        T_joint_plate = mul(mul(T_joint_flange, self.T_flange_target), T_target_plate)
        plate = LinkBody(PLATE, joint, Box(self.plate), frozen(T_joint_plate))
        content = {"robot": robot.digest, "plate": [list(self.plate), plate.T_joint_body.tolist()]}
        return replace(robot, bodies=(*robot.bodies, plate), digest=sha256(content))

    def roughly_mounted(self, seed: int) -> HandTarget:
        """Return the target with random mounting errors, for the simulated cell."""
        rng = np.random.default_rng([seed, 465])
        off = transform(rotation(rng.normal(0.0, _ROUGH[1], 3)), rng.normal(0.0, _ROUGH[0], 3))
        return replace(self, T_flange_target=frozen(mul(self.T_flange_target, off)))

    def sight(self, T_base_camera: Array, T_base_target: Array) -> Array:
        """Return the corners (5, 3), m, of the pyramid between camera and chessboard, which must stay free."""
        width, height = self.target.size
        corners = np.array([[0, 0, 0], [width, 0, 0], [0, height, 0], [width, height, 0]], dtype=float)
        corners[:, 2] = -2e-3  # above the print
        on_target = mul(corners, T_base_target[:3, :3].T) + T_base_target[:3, 3]
        return np.vstack([on_target, T_base_camera[:3, 3]])


class HandKeys(Keys):
    """Keys of ``[hand]``, and the print's tolerance."""

    size_within: float = key("size_within_percent", SIZE_RULE, 100.0 * SIZE_WITHIN)
    centre: Array = key("hand.centre_mm", carried(500))
    rpy: Array = key("hand.rpy_deg", turns(3))
    plate: tuple[float, float, float] = key("hand.plate_mm", triple("mm", 0.5, 500))


class HandCharucoKeys(HandKeys, CharucoKeys, file="a file of the gripper's target"):
    """Keys of a target with markers in the gripper."""


class _HandCheckerboardKeys(HandKeys, CheckerboardKeys):
    pass


def read_hand_target(path: Path) -> HandTarget:
    """Read a target file with a table ``[hand]``.

    Raises:
        FileInputError: a value is wrong.
    """
    root = Node.of_toml(path, "target")
    keys: HandCharucoKeys | _HandCheckerboardKeys
    if root.get("kind", KIND, "charuco") == "charuco":
        keys = HandCharucoKeys.read(root)
    else:
        keys = _HandCheckerboardKeys.read(root)
    target = target_of(keys, root)
    width, height = target.size
    if keys.plate[0] < width or keys.plate[1] < height:
        rule = f"must be at least as large as the chessboard, {1e3 * width:g} x {1e3 * height:g} mm"
        raise root.error_at("hand.plate_mm", rule)
    T = mul(pose_of(keys.centre, keys.rpy), transform(t=(-width / 2.0, -height / 2.0, 0.0)))
    return HandTarget(target, frozen(T), keys.plate, keys.size_within / 100.0)
