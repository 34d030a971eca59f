"""The URDF against the DH table, and its bodies against what Pinocchio may drop."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from arm.controller.unit import UNITS, load_unit
from arm.errors import FileInputError, InputError
from arm.io.storage import data_file
from arm.robot.model import load_a465, load_robot
from arm.robot.shapes import Box, Capsule, Convex
from arm.se3 import inverse, rotation_vector, transform
from arms.made_up import BOX_OBJ, MESH_ARM

TOOL_LENGTH = 0.134112
D = (0.3052, 0.0, 0.0, 0.3302, 0.0, 0.0762)
A = (0.0, 0.3048, 0.0, 0.0, 0.0, 0.0)
ALPHA = np.radians((90, 0, 270, 90, 270, 0))
OFFSET = np.radians((0, -270, -90, 0, 0, 0))


def _dh_flange(q: np.ndarray) -> np.ndarray:
    """Standard DH, written out: Rz(q + offset) Tz(d) Tx(a) Rx(alpha)."""
    T = np.eye(4)
    for theta, d, a, alpha in zip(q + OFFSET, D, A, ALPHA, strict=True):
        c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
        T = T @ np.array(
            [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
        )
    return T


@pytest.mark.parametrize("unit_name", UNITS)
def test_forward_kinematics_equals_the_dh_table(unit_name: str) -> None:
    unit, robot = load_unit(unit_name), load_a465(TOOL_LENGTH, 0.06)
    rng = np.random.default_rng(10)
    for q in rng.uniform(unit.lower, unit.upper, (1000, 6)):
        expected = _dh_flange(q) @ transform(t=(0, 0, TOOL_LENGTH))
        assert np.abs(robot.T_base_tool(q) - expected).max() < 1e-9


def test_upright_at_zero() -> None:
    flange = load_a465(TOOL_LENGTH, 0.06).T_base_tool(np.zeros(6)) @ transform(t=(0, 0, -TOOL_LENGTH))
    assert flange == pytest.approx(transform(t=(0, 0, 1.0164)), abs=1e-12)


def test_jacobian_is_the_derivative_of_the_tool_pose() -> None:
    robot = load_a465(TOOL_LENGTH, 0.06)
    rng = np.random.default_rng(11)
    h = 1e-6
    for q in rng.uniform(-2, 2, (20, 6)):
        J, T = robot.jacobian(q), robot.T_base_tool(q)
        for joint in range(6):
            ahead = inverse(T) @ robot.T_base_tool(q + h * np.eye(6)[joint])
            behind = inverse(T) @ robot.T_base_tool(q - h * np.eye(6)[joint])
            twist = np.concatenate(
                [
                    ahead[:3, 3] - behind[:3, 3],
                    rotation_vector(ahead[:3, :3]) - rotation_vector(behind[:3, :3]),
                ]
            )
            assert np.abs(twist / (2 * h) - J[:, joint]).max() < 1e-7


def test_every_body_of_the_urdf_is_there() -> None:
    robot = load_a465(TOOL_LENGTH, 0.06)
    assert len(robot.bodies) == 12
    names = {b.name for b in robot.bodies}
    assert {"base", "forearm", "palm", "finger_l", "finger_r"} <= names
    assert all(pair <= names for pair in robot.disabled_collisions)


def test_fingers_stand_as_far_apart_as_asked_and_end_at_the_tool() -> None:
    for opening in (0.06, 0.04):
        robot = load_a465(TOOL_LENGTH, opening)
        q = np.radians([10, 20, -30, 40, 50, 60])
        fingers = {b.name: b for b in robot.bodies_at(q) if b.name.startswith("finger")}
        T_tool_base = inverse(robot.T_base_tool(q))
        left, right = (T_tool_base @ fingers[n].T_base_body for n in ("finger_l", "finger_r"))
        thickness = fingers["finger_l"].shape.size[1]
        assert left[1, 3] - right[1, 3] - thickness == pytest.approx(opening, abs=1e-9)
        assert left[2, 3] + fingers["finger_l"].shape.size[2] / 2 == pytest.approx(0.0, abs=1e-9)


def test_the_tool_length_is_never_implied() -> None:
    with pytest.raises(InputError, match=r"108\.712 mm.*134\.112 mm"):
        load_a465(0.108712, 0.06)


def test_a_capsule_dropped_by_pinocchio_is_refused(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    text = data_file("urdf/a465/a465.urdf").read_text()
    broken = tmp_path / "capsule.urdf"
    broken.write_text(text.replace('<sphere radius="0.048"/>', '<capsule radius="0.048" length="0.1"/>'))
    with pytest.raises(FileInputError, match="use cylinders, spheres, boxes and meshes"):
        load_a465(TOOL_LENGTH, 0.06, broken)


@pytest.mark.parametrize("mesh", ["meshes/box.obj", "package://two/meshes/box.obj"])
def test_collision_meshes_become_their_hulls_and_capsules_are_capsules(mesh: str, tmp_path: Path) -> None:
    (tmp_path / "two" / "meshes").mkdir(parents=True)
    (tmp_path / "two" / "meshes" / "box.obj").write_text(BOX_OBJ)
    urdf = tmp_path / "two" / "two.urdf"
    urdf.write_text(MESH_ARM.format(mesh=mesh))
    robot = load_robot(urdf, "rod", np.eye(4))
    foot, rod = robot.bodies
    assert isinstance(foot.shape, Convex)
    corners = [(x, y, z) for x in (0, 0.2) for y in (0, 0.2) for z in (0, 0.3)]
    assert np.array(sorted(foot.shape.points)) == pytest.approx(np.array(corners), abs=1e-7)
    assert foot.T_joint_body == pytest.approx(transform(t=(0, 0, 1)))
    assert rod.shape == Capsule(0.1, 0.5)

    before = robot.digest
    (tmp_path / "two" / "meshes" / "box.obj").write_text(BOX_OBJ.replace("0.3", "0.4"))
    assert load_robot(urdf, "rod", np.eye(4)).digest != before  # the hull is part of what the arm is
    (tmp_path / "two" / "meshes" / "box.obj").write_text(BOX_OBJ.replace("0.3", "0.0"))
    with pytest.raises(FileInputError, match=r"link foot = .*box.obj.*has no hull.*one plane"):
        load_robot(urdf, "rod", np.eye(4))
    in_mm = BOX_OBJ.replace("0.1", "100").replace("0.2", "200").replace("0.3", "300")
    (tmp_path / "two" / "meshes" / "box.obj").write_text(in_mm)
    with pytest.raises(FileInputError, match=r"link foot = .*box.obj': is 300 m long; .* \(is it in mm\? "):
        load_robot(urdf, "rod", np.eye(4))
    (tmp_path / "two" / "meshes" / "box.obj").unlink()
    with pytest.raises(FileInputError, match="could not be found"):
        load_robot(urdf, "rod", np.eye(4))


def test_unknown_names_are_refused_with_the_choices() -> None:
    path = data_file("urdf/a465/a465.urdf")
    with pytest.raises(InputError, match="J1, J2"):
        load_robot(path, "flange", np.eye(4), {"jaw": 0.0})
    with pytest.raises(InputError, match="flansch"):
        load_robot(path, "flansch", np.eye(4))


def test_bodies_move_with_their_joints() -> None:
    robot = load_a465(TOOL_LENGTH, 0.06)
    q = np.radians([30, -20, 40, 10, -50, 70])
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    placed = {b.name: b for b in robot.bodies_at(q)}
    palm = next(b for b in robot.bodies if b.name == "palm")
    assert isinstance(palm.shape, Box)
    assert placed["palm"].T_base_body == pytest.approx(data.oMi[6].homogeneous @ palm.T_joint_body, abs=1e-12)
    assert placed["base"].T_base_body == pytest.approx(transform(t=(0, 0, 0.1)), abs=1e-12)


def test_an_arm_that_branches_is_refused() -> None:
    """With both jaws moving the chain ends in two; its motion bounds would be wrong."""
    with pytest.raises(
        FileInputError, match=r"does not move flange: lock .*locked={'jaw_l': 0.0, 'jaw_r': 0.0}"
    ):
        load_robot(data_file("urdf/a465/a465.urdf"), "flange", transform(t=(0.0, 0.0, 0.134112)))


@pytest.mark.parametrize("urdf", [3, None, b"arm.urdf", ["arm.urdf"]])
def test_urdf_must_be_a_path(urdf: object) -> None:
    with pytest.raises(InputError, match=r"urdf = .*: must be the path of a URDF file"):
        load_robot(urdf, "flange", np.eye(4))  # type: ignore[arg-type]
