"""Errors of the arm for its certificates: from the calibration, and nothing without one."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pinocchio as pin
import pytest

from arm.numerics.products import mul
from arm.plan_file import GripperStep, Plan
from arm.poses import adjoint
from arm.robot.dh import A465
from arm.robot.error_screws import error_screws
from arm.robot.link_errors import LinkErrors
from arm.robot.shapes import Body, Box, Capsule, Cylinder, Sphere, Torus
from arm.se3 import Array, apply, frozen, transform
from cell.accuracy.arm_errors import arm_errors, body_errors
from cell.accuracy.error_model import ErrorModel
from cell.accuracy.placement import Transfer, gripper_positions, hole_of, placement_error
from cell.config.cell import Cell
from cell.files.task import Task
from cell.program.points import WORK
from cell.scene.displaced import DisplacedCube, with_displaced
from cell.task.plan_matches import check_plan
from plan.collision.covers import hull
from plan.scene import Scene, scene_from_json
from vision.observation import Observation, ObservedBoard


@pytest.fixture
def scene(cell: Cell, plan: Plan) -> Scene:
    return scene_from_json(plan.scene, cell.robot(), cell.robot_holding())


def _with_links(cell: Cell, sigma: float, first: int = 0) -> Cell:
    made = cell.calibration
    assert made is not None
    assert made.covariance is not None
    covariance = made.covariance.copy()
    covariance[12:30, 12:30] = sigma**2 * np.diag(np.arange(18) >= first)
    return replace(cell, calibration=replace(made, covariance=covariance))


def test_joints_err_by_offsets_scatter_and_following(cell: Cell) -> None:
    made = cell.calibration
    assert made is not None
    assert made.covariance is not None
    assert made.scatter is not None
    found = arm_errors(replace(cell, following_error=1e-3, sigmas=2.0))
    assert found is not None
    assert found.sigmas == 2.0
    assert found.covariance == pytest.approx(made.covariance[6:12, 6:12] + np.diag(made.scatter**2 + 1e-6))
    assert found.shift == 0.0


def test_an_uncalibrated_arm_or_no_sigmas_have_none(cell: Cell) -> None:
    assert arm_errors(replace(cell, calibration=None)) is None
    assert arm_errors(replace(cell, sigmas=0.0)) is None
    exact = arm_errors(replace(cell, calibration=replace(cell.calibration, scatter=None)))  # type: ignore[type-var]
    assert exact is not None
    assert np.diag(exact.covariance).max() < 1e-8


@pytest.mark.few(3)
@pytest.mark.parametrize("first", [0, 12])  # of d, a and alpha, or of alpha alone
@pytest.mark.parametrize("seed", range(5))
def test_no_error_of_the_links_within_the_sigmas_moves_a_point_further_than_the_shift(
    cell: Cell, seed: int, first: int
) -> None:
    rng = np.random.default_rng(seed)
    sigma = 1e-4
    found = arm_errors(_with_links(cell, sigma, first))
    assert found is not None
    robot = cell.robot()
    moved = []
    for _ in range(200):
        q = rng.uniform(cell.unit.lower, cell.unit.upper)
        direction = rng.normal(size=18) * (np.arange(18) >= first)
        error = found.sigmas * sigma * direction / np.linalg.norm(direction)
        twist = error_screws(A465, LinkErrors.none(), q)[:, 6:] @ error
        point = apply(robot.T_base_tool(q), rng.uniform(-0.08, 0.08, 3))
        moved.append(float(np.linalg.norm(twist[:3] + np.cross(twist[3:], point))))
    assert max(moved) <= found.shift
    assert found.shift < 10.0 * max(moved)


@pytest.mark.slow
def test_check_states_the_clearance_of_the_arm_as_it_may_be_beside_that_of_an_exact_one(
    task: Task, plan: Plan
) -> None:
    """Each move loses some clearance to the errors, and more with more of them; the exact arm's is stated unchanged."""
    lost = []
    for sigmas in (0.0, 3.0, 6.0):
        moves = check_plan(replace(task, cell=replace(task.cell, sigmas=sigmas)), plan)["moves"]
        if sigmas == 0.0:
            assert {m["proved_erring_mm"] for m in moves} == {None}
            continue
        assert all(m["proved_mm"] >= max(m["stated_mm"] - 1e-3, m["proved_erring_mm"]) for m in moves)
        closest = min(moves, key=lambda m: m["stated_mm"])
        lost.append(closest["stated_mm"] - closest["proved_erring_mm"])
    assert 0.5 < lost[0] < 1.5
    assert lost[1] == pytest.approx(2.0 * lost[0], rel=0.2)


def _drawn(C: Array, sigmas: float, rng: np.random.Generator) -> Array:
    """A twist on the surface of the ellipsoid."""
    values, vectors = np.linalg.eigh(C)
    way = rng.normal(size=6)
    return np.asarray(vectors @ (np.sqrt(np.clip(values, 0.0, None)) * sigmas * way / np.linalg.norm(way)))


@pytest.mark.parametrize("seed", range(3))
def test_no_error_of_a_board_within_the_sigmas_moves_a_body_further(
    cell: Cell, seen: Observation, plan: Plan, scene: Scene, seed: int
) -> None:
    """Not only to first order: by rotations of several degrees too."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(6, 6)) * np.array([1e-3, 1e-3, 2e-3, 0.02, 0.02, 0.02])[:, None]
    noisy = replace(seen, boards=tuple(_with(b, root @ root.T / 6.0) for b in seen.boards))
    found, model = body_errors(cell, noisy, plan, scene), ErrorModel.of(cell)
    for pose in noisy.poses:
        C = model.board(pose).shared.covariance
        for body in (
            b for b in scene.bodies if b.name in (f"plate {pose.board.name}", f"stand {pose.board.name}")
        ):
            assert isinstance(body.shape, Box)
            corners = np.array(body.shape.size) / 2.0 * np.array(list(product((-1, 1), repeat=3)))
            at = apply(body.T_base_body, corners)
            moved = []
            for _ in range(500):
                T = pin.exp6(_drawn(C, cell.sigmas, rng)).homogeneous
                moved.append(float(np.linalg.norm(apply(T, at) - at, axis=1).max()))
            assert 0.7 * found[body.name] < max(moved) <= found[body.name]


def test_a_displaced_cube_errs_with_the_board_that_it_stands_on(
    cell: Cell, seen: Observation, plan: Plan, scene: Scene
) -> None:
    """Not with the one that it is named after: 0.4 m from there, half a degree of that board is 3.5 mm."""
    first, second = seen.boards
    noisy = replace(seen, boards=(_with(first, np.diag([1e-5, 1e-5, 1e-5, 9e-3, 9e-3, 9e-3]) ** 2), second))
    name = next(cube.name for cube in scene.cubes)
    there = replace(
        scene,
        cubes=tuple(c for c in scene.cubes if c.name != name),
        allowed=frozenset(pair for pair in scene.allowed if name not in pair),
    )
    still = replace(plan, steps=tuple(s for s in plan.steps if not isinstance(s, GripperStep)))
    off = {}
    for board in (first, second):
        place = board.pose.holes[0]
        T = frozen(mul(place.T_base_hole, transform(t=(0.03, 0.0, 0.02))))
        cube = DisplacedCube(name, place.name, T)
        off[board.name] = body_errors(cell, noisy, still, with_displaced(cell, there, (cube,)))[name]
    exact = body_errors(cell, seen, still, scene)
    assert off[second.name] < 1.2 * max(exact.values())
    assert off[first.name] > 2.0 * off[second.name]


def test_a_cube_is_off_in_the_jaws_and_where_it_is_released_too(
    cell: Cell, seen: Observation, plan: Plan, scene: Scene
) -> None:
    """A look that is exact leaves the errors of the arm; a joint that errs at rest adds to them."""
    exact = body_errors(cell, seen, plan, scene)
    erring = body_errors(replace(cell, following_error=np.radians(0.05)), seen, plan, scene)
    for cube in plan.task["cubes"]:
        assert 0.5e-3 < exact[cube["cube"]] < 3e-3
        assert erring[cube["cube"]] > exact[cube["cube"]] + 1e-3
    assert all(erring[name] == exact[name] for name in exact if name.startswith(("plate", "stand")))
    still = replace(plan, steps=tuple(s for s in plan.steps if not isinstance(s, GripperStep)))
    resting = body_errors(cell, seen, still, scene)
    assert all(resting[cube["cube"]] < exact[cube["cube"]] for cube in plan.task["cubes"])


def test_a_released_cube_is_off_by_the_error_of_its_placement(
    cell: Cell, seen: Observation, plan: Plan, scene: Scene
) -> None:
    """An error of the board is still in the jaws when they open, over a target that is exact."""
    rng = np.random.default_rng(2)
    first, second = seen.boards
    noisy = replace(seen, boards=(_with(first, np.diag([2e-3, 2e-3, 1e-4, 1e-3, 1e-3, 1e-3]) ** 2), second))
    erring = replace(cell, following_error=np.radians(0.15))
    found, model = body_errors(erring, noisy, plan, scene), ErrorModel.of(erring)
    boards = {pose.board.name: model.board(pose) for pose in noisy.poses}
    at, reached = gripper_positions(erring, plan), []
    for number, entry in enumerate(plan.task["cubes"]):
        source, (target, hole) = (hole_of(boards, entry[key]) for key in ("from", "to"))  # type: ignore[misc]
        q_grip, q_release = at[number, "close"], at[number, "open"]
        transfer = Transfer(entry["cube"], source, (target, hole), q_grip, q_release)  # type: ignore[arg-type]
        T_base_hole = target.pose.T_base_board @ target.pose.board.T_board_hole(hole)
        twist = placement_error(model, transfer).transformed(adjoint(T_base_hole)) + target.hole(hole)
        cube, tools = scene.cube(entry["cube"]), [model.T_base_tool(q) for q in (q_grip, q_release)]
        T_base_cube = tools[1] @ np.linalg.inv(tools[0]) @ cube.T_base_body
        corners = apply(T_base_cube, 0.5 * cell.cube_size * np.array(list(product((-1, 1), repeat=3))))
        moved = []
        for _ in range(600):
            T = pin.exp6(_drawn(twist.covariance, cell.sigmas, rng)).homogeneous
            moved.append(float(np.linalg.norm(apply(T, corners) - corners, axis=1).max()))
        assert max(moved) <= found[cube.name]
        reached.append(max(moved) / found[cube.name])
    assert min(reached) > 0.8


@pytest.mark.parametrize("seed", range(3))
def test_what_is_on_a_work_errs_with_the_board_that_carries_it(
    cell: Cell, seen: Observation, plan: Plan, scene: Scene, seed: int
) -> None:
    """Bodies of any shape; without a board of the workpiece they have no errors."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(6, 6)) * np.array([1e-3, 1e-3, 2e-3, 0.02, 0.02, 0.02])[:, None]
    noisy = replace(seen, boards=tuple(_with(b, root @ root.T / 6.0) for b in seen.boards))
    pose = noisy.poses[0]
    T = frozen(mul(pose.T_base_board, transform(t=(0.09, 0.06, 0.1))))
    shapes = (
        Box((0.01, 0.02, 0.2)),
        Sphere(0.03),
        Capsule(0.01, 0.1),
        Cylinder(0.02, 0.1),
        Torus(0.03, 0.005),
    )
    bodies = tuple(Body(type(shape).__name__, shape, T, WORK) for shape in shapes)
    there = replace(scene, bodies=(*scene.bodies, *bodies))
    on_board = replace(plan, task={"kind": "program", "board": pose.board.name})
    found = body_errors(cell, noisy, on_board, there)
    C = ErrorModel.of(cell).board(pose).shared.covariance
    for body in bodies:
        points, radius = hull(body.shape)
        way = rng.normal(size=points.shape)
        at = apply(T, points + radius * way / np.linalg.norm(way, axis=1, keepdims=True))
        moved = []
        for _ in range(300):
            E = pin.exp6(_drawn(C, cell.sigmas, rng)).homogeneous
            moved.append(float(np.linalg.norm(apply(E, at) - at, axis=1).max()))
        assert 0.5 * found[body.name] < max(moved) <= found[body.name]
    off = body_errors(cell, noisy, replace(on_board, task={"kind": "program"}), there)
    assert not {body.name for body in bodies} & set(off)


def test_what_is_not_seen_or_not_calibrated_has_no_errors(
    cell: Cell, seen: Observation, plan: Plan, scene: Scene
) -> None:
    one = replace(seen, boards=seen.boards[1:])
    assert set(body_errors(cell, one, plan, scene)) == {"plate 03-04", "stand 03-04"}
    assert body_errors(replace(cell, calibration=None), seen, plan, scene) == {}
    assert body_errors(replace(cell, sigmas=0.0), seen, plan, scene) == {}


def _with(board: ObservedBoard, covariance: Array) -> ObservedBoard:
    return replace(board, pose=replace(board.pose, covariance=covariance))
