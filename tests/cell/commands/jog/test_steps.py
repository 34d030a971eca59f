"""Steps of a jog: each is straight, ends where it was asked for, and is refused where it would come too near."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.io.storage import data_file
from arm.robot.shapes import Body, Sphere
from arm.se3 import angle_between, transform
from cell.commands.jog.keys import JOINTS
from cell.commands.jog.steps import StepMaker
from cell.config.cell import Cell
from cell.config.cell_file import read_cell
from cell.scene.build import unseen_scene
from plan.collision.world import World

CELL = data_file("scenes/cell.toml")
START_DEG = (-57.0, -40.0, -80.0, 0.0, -60.0, 5.0)


@pytest.fixture(scope="module")
def here() -> Cell:
    return read_cell(CELL)


@pytest.fixture
def maker(here: Cell) -> StepMaker:
    return StepMaker(here, unseen_scene(here))


def _counts(cell: Cell, deg: tuple[float, ...]) -> tuple[int, ...]:
    return tuple(int(c) for c in cell.unit.counts(np.radians(deg)))


def _plus(start: tuple[int, ...], by: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(a + b for a, b in zip(start, by, strict=True))


@pytest.mark.parametrize("joint", range(6))
def test_a_step_of_a_joint_turns_it_alone(here: Cell, maker: StepMaker, joint: int) -> None:
    start = _counts(here, START_DEG)
    end = _plus(start, maker.step(start, JOINTS[joint], np.radians(0.1)).by)
    turned = np.degrees(here.unit.positions(end) - here.unit.positions(start))
    np.testing.assert_allclose(turned, 0.1 * np.eye(6)[joint], atol=0.001)


@pytest.mark.parametrize("axis", ["x", "y", "z", "along"])
def test_a_hundred_steps_lead_the_tool_straight_and_as_far(here: Cell, maker: StepMaker, axis: str) -> None:
    at, by = _counts(here, START_DEG), -0.0005 if axis == "along" else 0.0005
    robot, unit = here.robot(), here.unit
    T = robot.T_base_tool(unit.positions(at))
    along = T[:3, 2] if axis == "along" else np.eye(3)["xyz".index(axis)]
    for _ in range(100):
        start, step = at, maker.step(at, axis, by)
        at = _plus(at, step.by)
        maker.took(start, axis, by, at)
        assert step.tool_m == pytest.approx(0.0005, abs=3e-5)
    end = robot.T_base_tool(unit.positions(at))
    np.testing.assert_allclose(end[:3, 3], T[:3, 3] + 100 * by * along, atol=3e-5)
    assert np.degrees(angle_between(T[:3, :3], end[:3, :3])) < 0.005  # rounding of counts does not add up


@pytest.mark.parametrize("axis", ["z", "J1"])
def test_steps_end_before_the_clearance(here: Cell, maker: StepMaker, axis: str) -> None:
    scene, by = unseen_scene(here), -0.005 if axis == "z" else np.radians(1.0)
    world, at = World(scene.robot_open, scene.present), _counts(here, START_DEG)
    refused: ImpossibleError | None = None
    while refused is None:
        try:
            end = _plus(at, maker.step(at, axis, by).by)
            maker.took(at, axis, by, end)
            at = end
        except ImpossibleError as error:
            refused = error
    assert re.search(r"comes within .* of .* \(required: 10 mm\)", str(refused))
    kept = world.distance(here.unit.positions(at)).value
    assert here.clearance <= kept == maker.distance(at) < here.clearance + 0.02
    assert len(refused.data["pair"]) == 2


def test_a_step_that_passes_something_thin_is_refused_though_its_end_is_free(here: Cell) -> None:
    scene, start = unseen_scene(here), _counts(here, START_DEG)
    between, beyond = ((START_DEG[0] - turn, *START_DEG[1:]) for turn in (10.0, 20.0))
    tip = here.robot().T_base_tool(np.radians(between))[:3, 3]
    thin = replace(scene, bodies=(*scene.bodies, Body("bead", Sphere(0.002), transform(t=tip), "wall")))
    world, maker = World(thin.robot_open, thin.present), StepMaker(here, thin)
    for end in (START_DEG, beyond):
        assert world.distance(np.radians(end)).value > here.clearance
    with pytest.raises(ImpossibleError, match="bead"):
        maker.step(start, "J1", np.radians(-20.0))
    StepMaker(here, scene).step(start, "J1", np.radians(-20.0))


def test_a_joint_stays_within_its_limits_and_may_come_back(here: Cell, maker: StepMaker) -> None:
    limit = float(np.degrees(here.limits.upper[5]))
    start = _counts(here, (*START_DEG[:5], limit - 0.05))
    with pytest.raises(ImpossibleError, match=r"J6 is at its limit \(from .* deg\)"):
        maker.step(start, "J6", np.radians(0.1))
    maker.step(start, "J6", np.radians(-0.1))
    beyond = _counts(here, (*START_DEG[:5], limit + 0.5))
    maker.step(beyond, "J6", np.radians(-0.1))


def test_the_errors_of_a_calibrated_arm_count(scenes: Path) -> None:
    cell = read_cell(scenes / "realistic/cell.toml")
    assert cell.calibration is not None
    start = _counts(cell, START_DEG)
    plain = StepMaker(cell, unseen_scene(cell))
    plain.step(start, "J1", np.radians(0.1))
    strict = replace(cell, erring_clearance=plain.distance(start) - 1e-4)
    maker = StepMaker(strict, unseen_scene(strict))
    assert all("for all likely errors of the arm" in pair for pair in maker.too_near(start))
    with pytest.raises(ImpossibleError, match="for all likely errors of the arm"):
        maker.step(start, "J1", np.radians(0.1))


def _beside(cell: Cell, start: tuple[int, ...], name: str, way: tuple[float, float], gap: float) -> Body:
    """A ball at a distance of a finger of the open jaws; `way`: from the tool's middle, along its y and z axes."""
    robot, q = cell.robot(), cell.unit.positions(start)
    T, scene = robot.T_base_tool(q), unseen_scene(cell)
    for far in np.arange(0.0, 0.2, 1e-3):
        middle = T[:3, 3] + T[:3, 1:3] @ (np.array(way) * far + [cell.gripper.opening / 2.0 * way[0], 0.0])
        ball = Body(name, Sphere(0.002), transform(t=middle), "wall")
        if World(robot, (*scene.present, ball)).only([name]).distance(q).value >= gap:
            return ball
    raise AssertionError


def test_an_arm_that_is_too_near_is_led_away_and_nowhere_else(here: Cell) -> None:
    scene, start = unseen_scene(here), _counts(here, START_DEG)
    scene = replace(scene, bodies=(*scene.bodies, _beside(here, start, "bead", (1.0, 0.0), 0.005)))
    maker, world = StepMaker(here, scene), World(scene.robot_open, scene.present)
    assert re.search(r"^finger_\w comes within .* of bead \(required: 10 mm\)$", maker.too_near(start)[0])
    led = next(by for by in np.radians([0.1, -0.1]) if _made(maker, start, by))
    for by in (-led, -60.0 * led):  # the second ends beyond the ball
        with pytest.raises(ImpossibleError, match=r"bead .*: only steps that lead them apart are made"):
            maker.step(start, "J1", by)
    assert world.distance(here.unit.positions(start) - [60.0 * led, *[0.0] * 5]).value > here.clearance
    at, clear = start, [maker.distance(start)]
    while maker.too_near(at) and len(clear) < 50:
        at = _plus(at, maker.step(at, "J1", led).by)
        clear.append(world.distance(here.unit.positions(at)).value)
    assert not maker.too_near(at)
    assert np.diff(clear).min() > 1e-4
    with pytest.raises(ImpossibleError, match="comes within"):  # and it does not come back
        maker.step(at, "J1", -10.0 * led)


def test_what_leads_away_from_one_body_keeps_clear_of_all_others(here: Cell) -> None:
    scene, start = unseen_scene(here), _counts(here, START_DEG)
    near = _beside(here, start, "bead", (1.0, 0.0), 0.005)
    other = _beside(here, start, "other", (-1.0, 0.0), 0.012)
    alone, both = (
        StepMaker(here, replace(scene, bodies=(*scene.bodies, *more))) for more in ([near], [near, other])
    )
    far = next(by for by in np.radians([1.0, -1.0]) if _made(alone, start, by))
    assert _made(both, start, far / 10.0)
    with pytest.raises(ImpossibleError, match=r"comes within .* of other"):
        both.step(start, "J1", far)


def _made(maker: StepMaker, start: tuple[int, ...], by: float) -> bool:
    try:
        maker.step(start, "J1", by)
    except ImpossibleError:
        return False
    return True


def test_bodies_that_touch_are_left_to_the_hand(here: Cell) -> None:
    scene, start = unseen_scene(here), _counts(here, START_DEG)
    inside = replace(scene, bodies=(*scene.bodies, _beside(here, start, "bead", (1.0, 0.0), -0.001)))
    for by in np.radians([0.1, -0.1]):
        with pytest.raises(ImpossibleError, match=r"is inside bead .* move it by hand \(a465 release\)"):
            StepMaker(here, inside).step(start, "J1", by)
