"""What programs that plan need, under one roof: arms, bodies, scenes, poses, plans, proofs.

Importing it loads Pinocchio and coal (about half a second). Everything here is documented where it is defined.
"""

from arm.bodies import Body, Box, Capsule, Convex, Cylinder, Sphere, convex
from arm.errors import A465Error, ImpossibleError, InputError
from arm.meshfile import read_mesh_points
from arm.outfit import ignoring, urdf_limits, with_tool
from arm.planfile import Plan
from arm.robot import Robot, load_a465, load_robot
from arm.se3 import inverse, rot_x, rot_y, rot_z, rotation, transform
from arm.unit import Limits, Unit, load_unit
from plan.budget import PlanningInterrupted, SearchBudget, TransitBudget
from plan.check import check_curve, check_move
from plan.curve import curve_of_waypoints
from plan.ik import explain_pose, inverse_kinematics
from plan.ik_numeric import SearchOptions, solve_ik
from plan.line import Line, LineOptions, follow_line
from plan.options import PlanOptions
from plan.poselist import PosePlan, SearchEffort, Target, plan_poses
from plan.poseplan import Pause, Reached
from plan.reach import reach
from plan.scene import Scene, Station, Transfer
from plan.task import plan_task
from plan.transit import plan_transit
from plan.way import plan_way
from plan.world import World

__all__ = [
    "A465Error",
    "Body",
    "Box",
    "Capsule",
    "Convex",
    "Cylinder",
    "ImpossibleError",
    "InputError",
    "Limits",
    "Line",
    "LineOptions",
    "Pause",
    "Plan",
    "PlanOptions",
    "PlanningInterrupted",
    "PosePlan",
    "Reached",
    "Robot",
    "Scene",
    "SearchBudget",
    "SearchEffort",
    "SearchOptions",
    "Sphere",
    "Station",
    "Target",
    "Transfer",
    "TransitBudget",
    "Unit",
    "World",
    "check_curve",
    "check_move",
    "convex",
    "curve_of_waypoints",
    "explain_pose",
    "follow_line",
    "ignoring",
    "inverse",
    "inverse_kinematics",
    "load_a465",
    "load_robot",
    "load_unit",
    "plan_poses",
    "plan_task",
    "plan_transit",
    "plan_way",
    "reach",
    "read_mesh_points",
    "rot_x",
    "rot_y",
    "rot_z",
    "rotation",
    "solve_ik",
    "transform",
    "urdf_limits",
    "with_tool",
]
