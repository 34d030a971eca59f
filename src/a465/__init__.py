"""Certified motion planning, vision, calibration and execution for a CRS A465 arm on a MARS-8 controller.

``import a465`` is all that a program needs. Names are loaded at their first use, so that the import itself takes a
millisecond:

| name | |
|---|---|
| `load_robot`, `load_a465` | read an arm from its URDF; the arm of the lab (`arm.robot.model`) |
| `load_unit` | a controller's encoder counts and limits (`arm.controller.unit`) |
| `World`, `Body`, `Scene` | collision bodies and their distances (`plan.collision.world`) |
| `solve_ik` | all configurations for a pose (`plan.kinematics.numeric_ik`) |
| `plan_task` | bring cubes from hole to hole (`plan.program.tasks`) |
| `plan_poses`, `Target` | follow a list of poses with any arm (`plan.program.pose_lists`) |
| `plan_joint_motion` | go from one configuration to another (`plan.program.go_to`) |
| `certify` | prove the clearance of a whole motion (`plan.collision.certificate`) |
| `write_plan` | write a plan as a file for `a465 check`, `preview`, `export` and `execute` (`arm.plan_file`) |
| `write_preview` | write a plan as an HTML page that shows it in 3D (`cell.preview.page`) |
| `calibrate_camera` | fit the intrinsics of a camera (`calib.camera.calibrate`) |
| `calibrate_hand_eye` | fit extrinsics and the arm's own kinematics (`calib.hand_eye.calibrate`) |
| `calibrate_pose_pairs`, `PosePairs` | fit the camera's pose to poses without images (`calib.robot_world.solve`) |
| `Mars` | the driver of the controller (`driver.mars.mars`) |

All other names of `plan.api` (shapes, poses, options, errors) are here, too. SI units and radians; `T_a_b` maps b to a,
4x4.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from a465.shadowing import require_own_rooms

if TYPE_CHECKING:
    from arm.plan_file import write_plan
    from calib.camera.calibrate import calibrate_camera
    from calib.hand_eye.calibrate import calibrate_hand_eye
    from calib.robot_world.solve import PosePairs, calibrate_pose_pairs
    from cell.preview.page import write_preview
    from driver.mars.mars import Mars
    from plan.api import *  # noqa: F403  (type checkers see what `__getattr__` finds)
    from plan.api import (
        Body,
        Scene,
        Target,
        World,
        certify,
        load_a465,
        load_robot,
        load_unit,
        plan_joint_motion,
        plan_poses,
        plan_task,
        solve_ik,
    )

__all__ = [
    "Body",
    "Mars",
    "PosePairs",
    "Scene",
    "Target",
    "World",
    "calibrate_camera",
    "calibrate_hand_eye",
    "calibrate_pose_pairs",
    "certify",
    "load_a465",
    "load_robot",
    "load_unit",
    "plan_joint_motion",
    "plan_poses",
    "plan_task",
    "solve_ik",
    "write_plan",
    "write_preview",
]

_PLACES = {
    "Mars": "driver.mars.mars",
    "PosePairs": "calib.robot_world.solve",
    "calibrate_camera": "calib.camera.calibrate",
    "calibrate_hand_eye": "calib.hand_eye.calibrate",
    "calibrate_pose_pairs": "calib.robot_world.solve",
    "load_unit": "arm.controller.unit",  # without the planner's libraries
    "write_plan": "arm.plan_file",
    "write_preview": "cell.preview.page",
}
_API = "plan.api"


def __getattr__(name: str) -> object:
    """Load the object of that name.

    Raises:
        AttributeError: there is no such name.
        ImportError: a foreign module shadows one of this project; the message names it.
    """
    if name.startswith("_"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    require_own_rooms()
    if name in _PLACES:
        found: object = getattr(import_module(_PLACES[name]), name)
    elif name in (api := import_module(_API)).__all__:
        found = getattr(api, name)
    else:
        raise AttributeError(
            f"module {__name__!r} has no attribute {name!r}; dir({__name__}) lists what there is"
        )
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*__all__, *import_module(_API).__all__})
