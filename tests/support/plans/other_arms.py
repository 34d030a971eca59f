"""Plans of arms without a controller's unit: six joints, seven and a gripper of which one finger follows, a SCARA."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from arm.robot.model import load_robot
from arm.robot.shapes import Body, Box, Cylinder
from arm.robot.tool import urdf_limits, with_disabled_collisions, with_tool
from arm.se3 import transform
from arms.made_up import PANDA, UR5, arm
from arms.made_up import urdf as urdf_of
from plan.options import PlanOptions
from plan.program.goals.target import Target
from plan.program.planned import Planned
from plan.program.pose_lists import plan_poses
from tasks.pose_lists import EFFORT, FAST, TABLE, down
from typed.doc_pages import ROOT, blocks

POST = Body("post", Cylinder(0.04, 0.6), transform(t=(0.45, 0.0, 0.26)), "post")
AROUND = [
    Target("fetch", down(0.4, -0.25, 0.15), free="rz", approach=0.06, retract=0.06, dwell_s=0.5),
    Target("bring", down(0.4, 0.25, 0.15)),
]
# links of the Panda and of its gripper that always overlap
OVERLAPPING = [("left", "hand"), ("right", "hand"), ("l6", "hand"), ("l5", "hand")]
OVERLAPPING += [(f"l{a}", f"l{b}") for a, b in ((0, 2), (2, 4), (3, 5), (4, 6), (5, 7), (4, 7))]
_FINGERS = """
<link name="hand"><collision><geometry><box size="0.05 0.16 0.04"/></geometry></collision></link>
<joint name="hand_mount" type="fixed"><parent link="l7"/><child link="hand"/><origin xyz="0 0 0.1"/></joint>
<link name="left"><collision><geometry><box size="0.02 0.02 0.05"/></geometry></collision></link>
<link name="right"><collision><geometry><box size="0.02 0.02 0.05"/></geometry></collision></link>
<joint name="left_slide" type="prismatic"><parent link="hand"/><child link="left"/><origin xyz="0 0 0.05"/>
<axis xyz="0 1 0"/><limit lower="0" upper="0.05" velocity="1" effort="1"/></joint>
<joint name="right_slide" type="prismatic"><parent link="hand"/><child link="right"/><origin xyz="0 0 0.05"/>
<axis xyz="0 -1 0"/><limit lower="0" upper="0.05" velocity="1" effort="1"/><mimic joint="left_slide"/></joint>
</robot>"""


def six_joints(folder: Path) -> Planned:
    """The joints of a UR5 around a post."""
    robot = arm(folder, UR5, [("l0", "l2")])
    q, limits = [-0.9, -0.6, 1.2, 0.4, 1.57, 0.0], urdf_limits(robot, 4.0)
    return plan_poses(robot, [TABLE, POST], AROUND, q, limits, options=FAST, effort=EFFORT)


def seven_joints(folder: Path) -> Planned:
    """The joints of a Panda with a gripper, around a post."""
    path = folder / "gripper.urdf"
    path.write_text(urdf_of(PANDA).replace("</robot>", _FINGERS))
    robot = load_robot(path, "hand", transform(t=(0.0, 0.0, 0.08)), {"left_slide": 0.03})
    robot = with_disabled_collisions(robot, OVERLAPPING, neighbours=True)
    q, limits = [-0.8, 0.0, 0.0, -1.9, 0.0, 1.9, 0.8], urdf_limits(robot, 4.0)
    bodies = [TABLE, Body("post", POST.shape, transform(t=(0.5, 0.0, 0.26)), "post")]
    around = [replace(AROUND[0], jaws=1.0), AROUND[1]]
    return plan_poses(robot, bodies, around, q, limits, options=FAST, effort=EFFORT)


def scara_files(folder: Path) -> Path:
    """The files of the SCARA in docs/adding.md: URDF, list of poses, and arm file, which is returned."""
    for block in blocks((ROOT / "docs/adding.md").read_text()):
        if block.file:
            (folder / block.file).write_text(block.text)
    return folder / "scara.toml"


def scara(folder: Path) -> Planned:
    """The SCARA of docs/adding.md with its cup, which carries a part past a post."""
    urdf = scara_files(folder).with_suffix(".urdf")
    robot = with_disabled_collisions(load_robot(urdf, "flange", transform()), neighbours=True)
    cup = Body("cup", Cylinder(0.012, 0.03), transform(t=(0.0, 0.0, 0.065)), "tool")
    robot = with_tool(robot, transform(t=(0.0, 0.0, 0.08)), [cup])
    limits = urdf_limits(robot, {"j1": 20.0, "j2": 25.0, "j3": 8.0, "j4": 50.0})
    bodies = [
        Body("table", Box((0.8, 0.8, 0.04)), transform(t=(0.3, 0.0, -0.02)), "table"),
        Body("part", Box((0.04, 0.04, 0.10)), transform(t=(0.38, -0.2, 0.05)), "part"),
        Body("post", Box((0.05, 0.05, 0.22)), transform(t=(0.42, 0.02, 0.11)), "post"),
    ]
    allowed = [("cup", "part"), ("part", "table")]
    targets = [
        Target(name, down(0.38, y, 0.101), free="rz", approach=0.06, retract=0.06, allowed_collisions=allowed, **do)
        for name, y, do in (("fetch", -0.2, {"attach": "part"}), ("leave", 0.2, {"detach": True}))
    ]  # fmt: skip
    q = np.array([0.9, 0.8, 0.0, 0.0])
    return plan_poses(
        robot, bodies, targets, q, limits, options=PlanOptions(speed=1.0, clearance=0.01), effort=EFFORT
    )


OTHER_ARMS = {"six joints": six_joints, "seven joints": seven_joints, "SCARA": scara}
