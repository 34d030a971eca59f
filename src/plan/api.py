"""The public names of the planner in one module: arms, bodies, scenes, poses, plans, certificates.

The import loads Pinocchio and coal, which takes about 0.5 s. The defining modules hold the documentation.
"""

from arm.controller.unit import Limits, Unit, load_unit
from arm.errors import A465Error, ImpossibleError, InputError
from arm.former import former_names
from arm.plan_file import Pause, Plan
from arm.robot.mesh import read_mesh_points
from arm.robot.model import Robot, load_a465, load_robot
from arm.robot.shapes import Body, Box, Capsule, Convex, Cylinder, Sphere, Torus, convex
from arm.robot.tool import urdf_limits, with_disabled_collisions, with_tool
from arm.se3 import inverse, rot_x, rot_y, rot_z, rotation, transform
from plan.budget import PlanningInterrupted, SearchBudget, TransitBudget
from plan.cartesian.line import Line, LineOptions, follow_line
from plan.cartesian.reachability import reach
from plan.collision.bezier import curve_of_waypoints
from plan.collision.certificate import certify_curve, certify_move
from plan.collision.world import World
from plan.kinematics.ik import explain_pose, inverse_kinematics
from plan.kinematics.numeric_ik import SearchOptions, solve_ik
from plan.options import PlanOptions
from plan.program.assignment.planner import Transfers
from plan.program.go_to import plan_joint_motion
from plan.program.goals.target import Target
from plan.program.planned import Planned, Reached
from plan.program.pose_lists import plan_poses
from plan.program.program import Program, plan_program
from plan.program.sequence.planner import SearchEffort
from plan.program.tasks import plan_task
from plan.scene import Scene, Station, Transfer
from plan.transit.planner import Transit, find_transit, plan_transit

__all__ = [
    "A465Error", "Body", "Box", "Capsule", "Convex", "Cylinder", "ImpossibleError", "InputError", "Limits",
    "Line", "LineOptions", "Pause", "Plan", "PlanOptions", "Planned", "PlanningInterrupted", "Program",
    "Reached", "Robot", "Scene", "SearchBudget", "SearchEffort", "SearchOptions", "Sphere", "Station",
    "Target", "Torus", "Transfer", "Transfers", "Transit", "TransitBudget", "Unit", "World", "certify",
    "certify_curve", "certify_move", "convex", "curve_of_waypoints", "explain_pose", "find_transit",
    "follow_line", "inverse", "inverse_kinematics", "load_a465", "load_robot", "load_unit",
    "plan_joint_motion", "plan_poses", "plan_program", "plan_task", "plan_transit", "reach",
    "read_mesh_points", "rot_x", "rot_y", "rot_z", "rotation", "solve_ik", "transform", "urdf_limits",
    "with_disabled_collisions", "with_tool",
]  # fmt: skip


certify = certify_curve

former_names(
    __name__,
    __name__,
    check_move="certify_move",
    check_curve="certify_curve",
    ignoring="with_disabled_collisions",
    plan_way="plan_joint_motion",
    PosePlan="Planned",
)
