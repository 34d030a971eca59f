"""What tests of previews rest on: a made-up but plausible plan (no planner, no look, stated places)."""

from __future__ import annotations

import fcntl
import os
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm.board import PLATE_CENTRE, Board
from arm.controller.segments import CountPath, Segment
from arm.controller.unit import Unit, load_unit
from arm.io.storage import data_file
from arm.plan_file import GripperStep, LookStep, Move, Plan, Step, read_plan
from arm.robot.model import Robot, load_a465
from arm.robot.shapes import Body, Box, body_to_json
from arm.se3 import Array, frozen, inverse, rot_x, rot_z, rotation, rotation_vector, transform
from calib.chain.score_tests import ChainErrorHypothesis
from calib.hand_eye.calibrate import HandEye, calibrate_hand_eye
from cell.files.observation import read_observation
from cell.files.task import Task, read_task
from cell.scene.bodies import T_hole_cube, cube_body, plate_body, stand_body
from driver.emulator import Emulator
from driver.line.clock import Clock
from pages.browsers import chromium
from pages.preview import PlacedTestBoard, PreviewCase
from recorded.arm_sets import TARGETS, Truth, draw_truth, recorded, wide
from tasks.full_disks import folder_with_plan
from typed.command_line import a465
from vision.observation import Observation

TOOL_LENGTH = 0.134112
Q_START = np.radians([-60.0, -40.0, -80.0, 0.0, -60.0, 0.0])
SPEED = 0.5


def _placed(
    name: str, holes_mm: list[tuple[int, int]], centre: tuple[float, float, float], *deg: float
) -> PlacedTestBoard:
    yaw, tilt, lean = np.radians(deg)
    R = rotation(tilt * np.array([-np.sin(lean), np.cos(lean), 0.0])) @ rot_z(yaw)
    low, high = (int(part) for part in name.split("-"))
    board = Board(name, (low, high), frozen([(x / 1e3, y / 1e3, 0.0) for x, y in holes_mm]), 0.036)
    return PlacedTestBoard(board, transform(R, np.array(centre) - R @ np.array([*PLATE_CENTRE, 0.0])))


def _solve(robot: Robot, unit: Unit, T: Array, q: Array) -> Array | None:
    """Damped Newton inverse kinematics from a guess; None if it does not arrive inside the limits."""
    q = q.copy()
    for _ in range(200):
        error = inverse(robot.T_base_tool(q)) @ T
        twist = np.concatenate([error[:3, 3], rotation_vector(error[:3, :3])])
        if np.linalg.norm(twist) < 1e-9:
            inside = np.all(q >= unit.lower) and np.all(q <= unit.upper)
            return q if inside else None
        J = robot.jacobian(q)
        step = J.T @ np.linalg.solve(J @ J.T + 1e-6 * np.eye(6), twist)
        q += step * min(1.0, 0.3 / (np.abs(step).max() + 1e-12))
    return None


def _timed(q: Array, unit: Unit, least_s: float = 0.0) -> CountPath:
    """Way-points (n, 6) at rest-to-rest minimum-jerk timing under the registers at SPEED, as integer cubics."""
    limits = unit.limits().scaled(SPEED)
    s = np.linspace(0.0, 1.0, len(q))
    d1, d2 = np.gradient(q, s, axis=0), np.gradient(np.gradient(q, s, axis=0), s, axis=0)
    fastest, strongest = 1.875, 5.78  # greatest first and second derivative of the minimum-jerk profile
    duration = max(
        float((np.abs(d1).max(axis=0) * fastest / limits.velocity).max()),
        float(
            np.sqrt(
                (
                    (np.abs(d1).max(axis=0) * strongest + np.abs(d2).max(axis=0) * fastest**2)
                    / limits.acceleration
                ).max()
            )
        ),
        least_s,
    )
    count = max(2, int(np.ceil(duration / 0.1)))
    u = np.linspace(0.0, 1.0, count + 1)
    profile, rate = 10 * u**3 - 15 * u**4 + 6 * u**5, 30 * u**2 - 60 * u**3 + 30 * u**4
    at = np.stack([np.interp(profile, s, column) for column in q.T], axis=1)
    slope = np.stack([np.interp(profile, s, column) for column in d1.T], axis=1) * rate[:, None] / count
    knots = unit.counts(at)
    tangents = np.rint(slope * unit.counts_per_rad).astype(np.int64)
    segments = []
    for a, b, m, n in zip(knots[:-1], knots[1:], tangents[:-1], tangents[1:], strict=True):
        rows = (m, 3 * (b - a) - 2 * m - n, m + n - 2 * (b - a))
        segments.append(Segment(100, tuple(tuple(int(v) for v in row) for row in rows)))
    return CountPath(tuple(int(v) for v in knots[0]), tuple(segments))


class _Writer:
    """Collects steps; the arm stands where the last move ended."""

    def __init__(self, robot: Robot, unit: Unit) -> None:
        self.robot, self.unit = robot, unit
        self.q = np.asarray(Q_START)
        self.steps: list[Step] = []

    def move(self, role: str, cube: int, q: Array, held: str | None, least_s: float = 0.0) -> None:
        clearance, closest = {
            "transit": (0.0312 + 0.007 * cube, ("finger_l", "cube 4")),
            "approach": (0.0064 + 0.001 * cube, ("palm", "plate 01-02")),
            "retract": (0.0081, ("finger_r", "cube 3")),
            "home": (0.1207, ("forearm", "camera post")),
        }[role]
        path = _timed(q, self.unit, least_s)
        self.steps.append(
            Move(
                f"cube {cube + 1}: {role}",
                role,
                cube,
                path,
                held,
                0.04 if held else 0.06,
                clearance,
                closest,
                role != "transit",
            )
        )
        self.q = self.unit.positions(path.end)

    def straight(self, role: str, cube: int, to: Array, held: str | None) -> None:
        self.move(role, cube, np.linspace(self.q, to, 40), held)

    def line(self, role: str, cube: int, T_to: Array, held: str | None) -> None:
        T_from, q, points = self.robot.T_base_tool(self.q), self.q, [self.q]
        for s in np.linspace(0.0, 1.0, 24)[1:]:
            T = np.array(T_to)
            T[:3, 3] = (1 - s) * T_from[:3, 3] + s * T_to[:3, 3]
            solved = _solve(self.robot, self.unit, frozen(T), q)
            assert solved is not None
            q = solved
            points.append(q)
        self.move(role, cube, np.stack(points), held, least_s=4.0)

    def grip(self, action: str, cube: int) -> None:
        self.steps.append(
            GripperStep(f"cube {cube + 1}: {action}", action, cube, 1 / 3 if action == "close" else 0.0, 1.0)
        )


def _offset(T_base_tool: Array) -> Array:
    return frozen(T_base_tool @ transform(t=(0.0, 0.0, -0.1)))


def _grasp(robot: Robot, unit: Unit, place: PlacedTestBoard, hole: int) -> tuple[Array, Array]:
    """Tool pose at a hole and a configuration 10 cm above it."""
    for yaw in range(4):
        in_hole = transform(rot_x(np.pi) @ rot_z(yaw * np.pi / 2), (0.0, 0.0, 0.015))
        T = frozen(place.T_base_board @ place.board.T_board_hole(hole) @ in_hole)
        azimuth = np.arctan2(T[1, 3], T[0, 3])
        for guess in (-60.0, -45.0):
            q0 = np.array([azimuth, np.radians(-30), np.radians(-100), 0.0, np.radians(guess), 0.0])
            above = _solve(robot, unit, _offset(T), q0)
            if above is not None and np.abs(above[3]) < 1.0 and _solve(robot, unit, T, above) is not None:
                return T, above
    raise AssertionError(f"no grasp of hole {hole}")


def make_case(cubes: int = 4) -> PreviewCase:
    """Task 2 of the default cell with `cubes` cubes; the figures of clearance are made up."""
    unit = load_unit("crs93")
    robot_open, robot_holding = load_a465(TOOL_LENGTH, 0.06), load_a465(TOOL_LENGTH, 0.04)
    source = _placed(
        "01-02", [(0, 80), (80, 60), (100, 140), (140, 0)], (0.46, 0.11, 0.04), 175.0, 7.0, 265.0
    )
    target = _placed(
        "03-04", [(20, 120), (60, 40), (120, 100), (180, 0)], (0.46, -0.13, 0.09), 90.0, 15.0, 270.0
    )
    bodies = [
        Body("table", Box((1.3, 1.5, 0.04)), transform(t=(0.35, 0.0, -0.02)), "table"),
        Body("camera post", Box((0.08, 0.08, 1.2)), transform(t=(0.93, 0.0, 0.6)), "wall"),
    ]
    for place in (source, target):
        bodies.append(plate_body(place.board.name, place.T_base_board))
        stand = stand_body(place.board.name, place.T_base_board, (0.12, 0.12), 0.0)
        bodies += [stand] if stand else []
    standing = [
        cube_body(
            f"cube {i + 1}", 0.04, source.T_base_board @ source.board.T_board_hole(i) @ T_hole_cube(0.04)
        )
        for i in range(cubes)
    ]
    writer = _Writer(robot_open, unit)
    writer.steps.append(GripperStep("open the gripper", "open", None, 0.0, 1.0))
    for cube in range(cubes):
        name = f"cube {cube + 1}"
        pick, above_pick = _grasp(robot_open, unit, source, cube)
        place_pose, above_place = _grasp(robot_open, unit, target, cube)
        writer.straight("transit", cube, above_pick, None)
        writer.line("approach", cube, pick, None)
        writer.grip("close", cube)
        writer.line("retract", cube, _offset(pick), name)
        writer.straight("transit", cube, above_place, name)
        writer.line("approach", cube, place_pose, name)
        writer.grip("open", cube)
        writer.line("retract", cube, _offset(place_pose), None)
        writer.straight("home", cube, np.asarray(Q_START), None)
        writer.steps.append(LookStep(f"look after cube {cube + 1}"))
    plan = Plan(
        task={
            "name": "task2",
            "kind": "board-to-board",
            "cubes": [
                {"cube": f"cube {i + 1}", "from": f"01-02/{i + 1}", "to": f"03-04/{i + 1}"}
                for i in range(cubes)
            ],
        },
        unit="crs93",
        speed=SPEED,
        speed_registers=unit.speed_registers,
        acceleration_registers=unit.acceleration_registers,
        steps=tuple(writer.steps),
        provenance={"robot": robot_open.digest, "unit": unit.digest, "seed": 0, "a465": "0.1.0"},
        scene={"bodies": [body_to_json(b) for b in bodies], "cubes": [body_to_json(c) for c in standing]},
    )
    return PreviewCase(plan, robot_open, robot_holding, unit, (source, target))


@pytest.fixture(scope="session")
def planned_scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The shipped scenes with a look and a plan of the second task; no test may change them.

    The processes of a parallel run share them: the first that asks makes them, the others wait.
    """
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    folder = shared / "planned" / "scenes"
    with (shared / "planned.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (folder / "plan.json").exists():
            shutil.rmtree(folder, ignore_errors=True)  # what was begun by a process that ended
            shutil.copytree(data_file("scenes"), folder)
            a465("look", folder / "task2.toml", "-o", folder / "look.json")
            a465("plan", folder / "task2.toml", "--look", folder / "look.json", "-o", folder / "plan.json")
    return folder


@pytest.fixture(scope="session")
def task(planned_scenes: Path) -> Task:
    """The second task of `planned_scenes`; `plan` and `seen` are its plan and its look."""
    return read_task(planned_scenes / "task2.toml")


@pytest.fixture(scope="session")
def plan(planned_scenes: Path) -> Plan:
    return read_plan(planned_scenes / "plan.json")


@pytest.fixture(scope="session")
def seen(planned_scenes: Path, task: Task) -> Observation:
    return read_observation(planned_scenes / "look.json", task.cell)


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to run in, with a plan."""
    return folder_with_plan(tmp_path, monkeypatch)


@pytest.fixture
def emulator() -> Iterator[Emulator]:
    """A unit whose clock runs 20 times as fast as the wall's."""
    with Emulator(load_unit("crs93"), Clock(20.0)) as emulator:
        yield emulator


@pytest.fixture(scope="session")
def preview_case() -> PreviewCase:
    """Four cubes."""
    return make_case()


@pytest.fixture(scope="session")
def make_preview_case() -> Callable[[int], PreviewCase]:
    """Plans of other lengths."""
    return make_case


@pytest.fixture(scope="module")
def browser() -> Iterator[object]:
    """Debian's chromium."""
    with chromium() as started:
        yield started


@pytest.fixture(scope="session")
def truth() -> Truth:
    """An arm with its camera and target, drawn."""
    return draw_truth(np.random.default_rng(8))


@pytest.fixture(scope="session")
def found() -> HandEye:
    """A calibration with errors of the links in it, and with things to tell that it does not have."""
    rng = np.random.default_rng(3)
    truth = draw_truth(rng, links=True)
    joints = wide(truth, TARGETS["charuco"], 30, rng)
    found = calibrate_hand_eye(replace(recorded(truth, joints, "charuco", rng), unit="crs97"))
    c = found.chain
    assert c.accepted
    assert c.trials[0].needed
    weights = np.ones(30)
    weights[[4, 11]] = 0.0
    told = replace(
        c,
        problem=replace(c.problem, reading_sigma=np.radians([0.01, 0.02, 0.03, 0.0, 0.0, 0.0])),
        fit=replace(c.fit, weights=(weights,)),
        hypotheses=(ChainErrorHypothesis("target size", 0.01, 0.002, "", 50.0, 20.0),),
        remarks=("look at this",),
    )
    return replace(found, chain=told)
