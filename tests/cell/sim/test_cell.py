"""The jaws of the simulated cell: what they grip, push and miss, and what becomes of a cube that is let go."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.io.storage import data_file
from arm.se3 import Array, inverse, rot_x, rot_z, rotation, transform
from cell.config.cell_file import read_cell
from cell.files.world import read_world
from cell.sim.cell import SimulatedCell
from cell.sim.grip import angle_to_square, between_jaws
from plan.kinematics.ik import inverse_kinematics


@pytest.fixture
def simulated() -> SimulatedCell:
    cell = read_cell(data_file("scenes/cell.toml"))
    return SimulatedCell(cell, read_world(data_file("scenes/task2.world.toml"), 0.036))


def _counts(simulated: SimulatedCell, T_base_tool: Array) -> tuple[int, ...]:
    unit = simulated.cell.unit
    q = inverse_kinematics(simulated.cell.robot(), T_base_tool, unit.lower, unit.upper).q[0]
    return tuple(int(c) for c in unit.counts(q))


def _over_cube(simulated: SimulatedCell, index: int, error: Array | None = None) -> Array:
    """Tool pose that grips a cube, off by `error` in the tool's frame."""
    grip = transform(rot_x(np.pi), (0.0, 0.0, 0.003))
    return simulated._cubes[index].T_base_cube @ grip @ (transform() if error is None else error)


def _jaws(simulated: SimulatedCell, T_base_tool: Array, fraction: float) -> int:
    gripper = simulated.cell.unit.gripper
    now = gripper.adc(1.0 - simulated.jaw_opening / simulated.cell.gripper.opening)
    return simulated.jaws(_counts(simulated, T_base_tool), now, gripper.adc(fraction))


@pytest.mark.parametrize(
    ("error", "what"),
    [
        (transform(t=(0.0020, 0.0020, 0.0)), "gripped"),
        (transform(t=(0.0025, 0.0025, 0.0)), "pushed"),
        (transform(t=(0.0, 0.0, 0.010)), "gripped"),
        (transform(t=(0.0, 0.0, -0.014)), "pushed"),
        (transform(t=(0.0, 0.0, -0.030)), "missed"),
        (transform(t=(0.050, 0.0, 0.0)), "missed"),
        (transform(rot_z(np.radians(2.5))), "gripped"),
        (transform(rot_z(np.radians(3.5))), "pushed"),
        (transform(rot_z(np.radians(90.0))), "gripped"),
        (transform(rotation((np.radians(3.5), 0.0, 0.0))), "pushed"),
    ],
)
def test_a_cube_is_gripped_within_3_mm_and_3_deg_only(
    simulated: SimulatedCell, error: Array, what: str
) -> None:
    stop = _jaws(simulated, _over_cube(simulated, 1, error), 0.9)
    assert simulated.events[-1].what == what, simulated.events[-1].message
    held = [c.name for c in simulated._cubes if c.T_tool_cube is not None]
    assert held == (["cube 2"] if what == "gripped" else [])
    gripper, cell = simulated.cell.unit.gripper, simulated.cell
    expected = cell.gripper.fraction_closed(cell.cube_size) if what == "gripped" else 0.9
    assert stop == pytest.approx(gripper.adc(expected), abs=1)


def test_a_held_cube_keeps_its_offset_along_the_fingers(simulated: SimulatedCell) -> None:
    error = transform(rot_z(0.02), (0.001, -0.0015, 0.002))
    T_base_tool = _over_cube(simulated, 0, error)
    T_tool_cube = between_jaws(inverse(T_base_tool) @ simulated._cubes[0].T_base_cube)
    assert abs(T_tool_cube[0, 3]) > 5e-4
    _jaws(simulated, T_base_tool, 0.9)
    lifted = _counts(simulated, transform(t=(0.0, 0.0, 0.1)) @ T_base_tool)
    cube = simulated.cubes(lifted)[0]
    assert inverse(simulated.T_base_tool(lifted)) @ cube.T_base_cube == pytest.approx(T_tool_cube, abs=2e-4)
    assert cube.T_base_cube[2, 3] == pytest.approx(simulated._cubes[0].T_base_cube[2, 3] + 0.1, abs=2e-4)


def _carried(simulated: SimulatedCell, T_base_cube: Array) -> None:
    """Grip the first cube truly and let it go with its centre at `T_base_cube`."""
    T_base_tool = _over_cube(simulated, 0)
    T_tool_cube = inverse(T_base_tool) @ simulated._cubes[0].T_base_cube
    _jaws(simulated, T_base_tool, 0.9)
    _jaws(simulated, T_base_cube @ inverse(T_tool_cube), 0.0)


@pytest.mark.parametrize(("aside", "what"), [(0.0, "placed"), (0.0018, "placed"), (0.0025, "unseated")])
def test_a_pocket_catches_a_cube_within_2_mm(simulated: SimulatedCell, aside: float, what: str) -> None:
    target = simulated.world.boards[1]
    T_base_hole = target.T_base_board @ target.board.T_board_hole(1)
    _carried(simulated, T_base_hole @ transform(t=(aside, 0.0, 0.013)))
    assert simulated.events[-1].what == what
    if what == "placed":
        seat = inverse(T_base_hole) @ simulated._cubes[0].T_base_cube
        assert seat[:3, 3] == pytest.approx([0.0, 0.0, 0.012], abs=1e-9)
        assert angle_to_square(seat[:3, :3]) == pytest.approx(0.0, abs=1e-6)
    else:  # it lies on the plate
        flat = inverse(T_base_hole) @ simulated._cubes[0].T_base_cube
        assert flat[:3, 3] == pytest.approx([aside, 0.0, 0.020], abs=1e-5)
        assert flat[:3, 2] == pytest.approx([0.0, 0.0, 1.0], abs=1e-6)


@pytest.mark.parametrize("fault", ["missed", "half", "aside"])
def test_a_grasp_with_a_fault_holds_nothing_and_the_next_one_holds(
    simulated: SimulatedCell, fault: str
) -> None:
    simulated._grasp_faults = [fault, "held"]
    T_base_tool, before = _over_cube(simulated, 0), simulated._cubes[0].T_base_cube
    _jaws(simulated, T_base_tool, 0.9)
    assert simulated.events[-1].what == ("missed" if fault == "missed" else "pushed")
    T_cube_now = inverse(before) @ simulated._cubes[0].T_base_cube
    assert np.allclose(T_cube_now, np.eye(4)) is (fault == "missed")
    _jaws(simulated, T_base_tool, 0.0)
    _jaws(simulated, simulated._cubes[0].T_base_cube @ inverse(before) @ T_base_tool, 0.9)
    assert simulated.events[-1].what == "gripped"


@pytest.mark.parametrize(("height", "what"), [(0.001, "set down"), (0.009, "set down"), (0.030, "fallen")])
def test_a_cube_is_set_down_on_the_table_or_falls(simulated: SimulatedCell, height: float, what: str) -> None:
    _carried(simulated, transform(rot_z(0.3), (0.25, -0.40, 0.020 + height)))
    assert simulated.events[-1].what == what
    if what == "set down":
        assert simulated._cubes[0].T_base_cube[2, 3] == pytest.approx(0.020)


def test_errors_of_the_arm_move_its_tool_and_not_its_encoders(simulated: SimulatedCell) -> None:
    """Joint errors of the world file act on true positions, by the unit's signs and at each arrival anew."""
    backlash = replace(simulated.world.arm, backlash=np.full(6, 2e-3))
    bad = SimulatedCell(simulated.cell, replace(simulated.world, arm=backlash))
    motion = [100, (1, 1, 1, 1, 1, 1)]
    bad.follow(lambda: (motion[0], motion[1]))
    counts = tuple(int(c) for c in simulated.cell.unit.counts(simulated.cell.q_start))
    senses = np.sign(simulated.cell.unit.counts_per_rad)
    assert bad.positions(counts) - simulated.positions(counts) == pytest.approx(-1e-3 * senses)
    motion[1] = (-1, -1, -1, -1, -1, -1)
    assert bad.positions(counts) - simulated.positions(counts) == pytest.approx(1e-3 * senses)
    assert not np.allclose(bad.T_base_tool(counts), simulated.T_base_tool(counts), atol=1e-4)


def test_jaws_stop_at_the_true_size_of_a_cube(simulated: SimulatedCell) -> None:
    large = SimulatedCell(
        simulated.cell, replace(simulated.world, made=replace(simulated.world.made, cube=2e-4))
    )
    stops = [_jaws(cell, _over_cube(cell, 1), 0.9) for cell in (simulated, large)]
    gripper = simulated.cell.unit.gripper
    width = simulated.cell.gripper.width(gripper.fraction_closed(stops[1]))
    assert large._cubes[1].size != 0.04
    assert width == pytest.approx(large._cubes[1].size, abs=6e-5)
    assert stops[0] != stops[1]
    seat = large._cubes[1].T_base_cube[:3, 3] - simulated._cubes[1].T_base_cube[:3, 3]
    assert np.linalg.norm(seat) > 1e-4  # a smaller cube sits deeper
