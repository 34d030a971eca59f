"""An arm as JSON types gives the same arm again, without the files that it came from."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from arm.errors import FileInputError, InputError
from arm.io.node import Node
from arm.io.storage import canonical_json
from arm.robot.description import joint_motion, robot_from_json, robot_to_json
from arm.robot.dh import A465
from arm.robot.link_errors import LinkErrors, with_link_errors
from arm.robot.model import Robot, load_a465, load_robot
from arm.robot.shapes import Body, Sphere
from arm.robot.tool import padded, with_tool
from arm.se3 import frozen, rot_x, rot_y, transform
from arms.made_up import BOX_OBJ, MESH_ARM, PANDA, RAIL, UR_LIKE, arm
from plan.collision.world import World

SLANTED = [
    ("0 0 0.2", "0 0 0", "0 0 -1", "revolute", -2.0, 2.0),
    ("0 0.1 0.3", "0.3 0 0", "0.6 0 0.8", "prismatic", -0.2, 0.2),
    ("0.2 0 0.1", "0 0.7 0", "0 0.28 0.96", "continuous", 0, 0),
]


def mesh_arm(folder: Path) -> Robot:
    (folder / "box.obj").write_text(BOX_OBJ)
    (folder / "arm.urdf").write_text(MESH_ARM.format(mesh="box.obj"))
    robot = load_robot(folder / "arm.urdf", "rod", transform(rot_x(0.4), (0.0, 0.1, 0.3)))
    (folder / "box.obj").unlink()
    return robot


def calibrated(folder: Path) -> Robot:
    d, a, alpha = 2e-3 * np.random.default_rng(5).normal(size=(3, 6))
    return with_link_errors(load_a465(0.134112, 0.04), A465, LinkErrors(frozen(d), frozen(a), frozen(alpha)))


def with_pen(folder: Path) -> Robot:
    pen = Body("pen", Sphere(0.02), transform(rot_y(0.3), (0.02, 0.0, 0.15)), "tool", 0.001)
    return padded(with_tool(arm(folder, UR_LIKE, [("l0", "l2")]), transform(t=(0, 0, 0.2)), [pen]), 0.003)


ARMS = {
    "Panda": lambda folder: arm(folder, PANDA, [("l0", "l2")]),
    "rail": lambda folder: arm(folder, RAIL),
    "slanted axes": lambda folder: arm(folder, SLANTED),
    "meshes": mesh_arm,
    "calibrated": calibrated,
    "tool and padding": with_pen,
}


def again(value: dict[str, Any]) -> Robot:
    return robot_from_json(Node(Path("plan.json"), "arm", json.loads(canonical_json(value))))


@pytest.mark.parametrize("make", ARMS.values(), ids=ARMS)
def test_the_arm_is_the_same_again(make, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    robot = make(tmp_path)
    found = again(robot_to_json(robot))
    assert (found.joint_names, found.end_frame, found.digest) == (
        robot.joint_names,
        robot.end_frame,
        robot.digest,
    )
    assert (found.disabled_collisions, dict(found.locked)) == (robot.disabled_collisions, dict(robot.locked))
    assert [(b.name, b.joint, b.link, b.padding) for b in found.bodies] == [
        (b.name, b.joint, b.link, b.padding) for b in robot.bodies
    ]
    ball = Body("ball", Sphere(0.1), transform(t=(0.4, 0.3, 0.5)), "wall")
    worlds = World(robot, [ball]), World(found, [ball])
    rng = np.random.default_rng(1)
    for q in rng.uniform(-1.5, 1.5, size=(40, len(robot.joint_names))):
        np.testing.assert_allclose(found.T_base_tool(q), robot.T_base_tool(q), atol=1e-11)
        np.testing.assert_allclose(found.jacobian(q), robot.jacobian(q), atol=1e-11)
        ours, theirs = (w.pair_distances(q, np.arange(len(w.pairs))) for w in worlds)
        np.testing.assert_allclose(theirs, ours, atol=2e-6)
    assert robot_to_json(replace(found, ideal=robot.ideal)) == robot_to_json(robot)


def test_the_urdf_of_a_calibrated_arm_is_left_out(tmp_path: Path) -> None:
    assert again(robot_to_json(calibrated(tmp_path))).urdf == ""
    assert again(robot_to_json(arm(tmp_path, RAIL))).urdf == (tmp_path / "arm.urdf").read_text()


@pytest.mark.parametrize(
    ("key", "change", "told"),
    [
        ("joints", lambda value: [], "arm.joints = []: must be at least one joint"),
        ("joints", lambda value: [{**value[0], "kind": "ball"}], "arm.joints[0].kind = 'ball'"),
        ("joints", lambda value: [{**value[0], "axis": [0, 0, 2]}], "arm.joints[0].axis = [0, 0, 2]: must be a unit"),
        ("bodies", lambda value: [{**value[0], "joint": 9}], "arm.bodies[0].joint = 9: must be at most 5"),
        ("bodies", lambda value: [{**value[0], "shape": {"box": [1, 2]}}], "arm.bodies[0].shape"),
        ("disabled_collisions", lambda value: [["l0"]], "arm.disabled_collisions[0] = ['l0']: must be two names"),
        ("locked", lambda value: {"jaw": "open"}, "arm.locked.jaw = 'open'"),
        ("T_end_tool", lambda value: [[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], "arm.T_end_tool"),
    ],
)  # fmt: skip
def test_a_wrong_value_is_told_by_its_key(key: str, change: Any, told: str, tmp_path: Path) -> None:
    value = robot_to_json(arm(tmp_path, RAIL))
    with pytest.raises(FileInputError) as refusal:
        again({**value, key: change(json.loads(json.dumps(value[key])))})
    assert f"plan.json: {told}" in str(refusal.value)
    with pytest.raises(FileInputError, match=rf"plan.json: arm.{key}: is missing"):
        again({name: one for name, one in value.items() if name != key})


def test_only_joints_that_turn_or_slide_are_known() -> None:
    assert joint_motion(pin.JointModel(pin.JointModelPY()), "slide")[0] == "prismatic"
    with pytest.raises(InputError, match="joint ball: is a JointModelSpherical; only revolute and prismatic"):
        joint_motion(pin.JointModel(pin.JointModelSpherical()), "ball")
