"""Contact physics: what friction holds, what funnels guide, what slips, and what it does not need to simulate."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm.se3 import rot_z, transform
from cell.commands.run import run_task
from cell.console import Console
from cell.cubes.grips import recovery_grips
from cell.scene.build import RELEASE_GAP, grips_over
from cell.scene.displaced import DisplacedCube
from cell.session.connection import WhichCell
from emulated.driven_contact import LIFT, OVER, SHUT, DrivenContact, world_of
from plan.scene import Station
from tasks.small import quick_scenes

pytest.importorskip("mujoco")


def _events(driven: DrivenContact) -> list[str]:
    return [f"{e.cube} {e.what}" for e in driven.cell.events]


def test_a_cube_is_carried_by_friction_and_guided_by_its_funnel() -> None:
    driven = DrivenContact()
    cube = driven.cell.cubes(driven.counts)[1]
    assert driven.fetch(1) == pytest.approx(cube.size, abs=2e-4)
    held = driven.cell.cubes(driven.counts)[1]
    assert held.where == "jaws"
    assert held.T_base_cube[2, 3] - cube.T_base_cube[2, 3] == pytest.approx(LIFT, abs=2e-3)
    driven.place(2, aside=(1e-3, -0.5e-3))
    assert _events(driven) == ["cube 2 gripped", "cube 2 placed"]
    placed = driven.cell.cubes(driven.counts)[1]
    T_hole_cube = np.linalg.inv(driven.T_base_hole(1, 2)) @ placed.T_base_cube
    assert np.abs(T_hole_cube[:2, 3]).max() < 0.1e-3
    assert T_hole_cube[2, 3] == pytest.approx(0.012, abs=0.1e-3)


@pytest.mark.few(1)
@pytest.mark.parametrize("way", [1, 3, 5, 7])
def test_jaws_that_lean_and_grip_higher_hold_a_cube_and_seat_it(way: int) -> None:
    """As where another cube leaves no room for straight ones: higher, and leaning by 10, 20 and 30 degrees."""
    driven = DrivenContact()
    cube = driven.cell.cubes(driven.counts)[1]
    T_base_hole = driven.T_base_hole(1, 2)
    goal = Station("03-04/3", grips_over(T_base_hole, driven.cell.cell.grip_height + RELEASE_GAP))
    displaced = DisplacedCube(cube.name, "01-02/2", cube.T_base_cube)
    grip = list(recovery_grips(driven.cell.cell, displaced, [goal], None))[way]
    at, to = grip.pick.T_base_tool[0], grip.goals[0].T_base_tool[0]
    up, over = transform(t=LIFT * cube.T_base_cube[:3, 2]), transform(t=LIFT * T_base_hole[:3, 2])
    for pose in (up @ at, at):
        driven.line(pose)
    driven.wait(0.1)
    assert driven.jaws(SHUT) == pytest.approx(cube.size, abs=2e-4)
    for pose in (up @ at, over @ to, to):
        driven.line(pose)
    driven.wait(0.1)
    driven.jaws(0.0)
    assert _events(driven) == ["cube 2 gripped", "cube 2 placed"]


def test_a_cube_beside_the_mouth_is_not_seated() -> None:
    driven = DrivenContact()
    driven.fetch(0)
    driven.place(0, aside=(3e-3, 0.0))
    assert _events(driven) == ["cube 1 gripped", "cube 1 unseated"]
    assert driven.cell.events[-1].T_base_cube is not None
    assert "tilted by" in driven.cell.events[-1].message


def test_jaws_beside_a_cube_close_on_nothing() -> None:
    driven = DrivenContact()
    assert driven.fetch(1, transform(t=(0.0, 0.0, -0.05))) == pytest.approx(0.006, abs=1e-4)
    assert _events(driven) == [" missed"]


def test_jaws_that_hold_a_cube_by_its_edge_stay_wider_apart_than_it_is() -> None:
    driven = DrivenContact()
    cube = driven.cell.cubes(driven.counts)[1]
    assert driven.fetch(1, transform(rot_z(np.radians(12.0)))) > cube.size + 1e-3


def test_a_weak_grip_is_lost_and_the_jaws_tell_it() -> None:
    driven = DrivenContact(world_of(contact={"jaw_force": 1.0, "jaw_friction": 0.1, "cube_mass": 0.2}))
    driven.fetch(1)
    assert driven.reading() == pytest.approx(0.006, abs=1e-4)
    assert _events(driven) == ["cube 2 gripped", "cube 2 lost"]
    driven.jaws(0.0)
    assert _events(driven)[-1] == "cube 2 placed"  # it slipped back into its own pocket


@pytest.mark.slow
def test_the_same_motion_has_the_same_bytes() -> None:
    def poses() -> bytes:
        driven = DrivenContact()
        driven.fetch(3)
        driven.place(0, aside=(1.5e-3, 0.0))
        return b"".join(c.T_base_cube.tobytes() for c in driven.cell.cubes(driven.counts))

    assert poses() == poses()


@pytest.mark.slow
def test_asking_more_often_changes_nothing() -> None:
    often, once = DrivenContact(), DrivenContact()
    for driven in (often, once):
        above = driven.T_base_hole(0, 1) @ transform(t=(0.0, 0.0, 0.2)) @ np.diag([1.0, -1.0, -1.0, 1.0])
        for x in (0.0, 0.02, 0.0):
            driven.line(above @ transform(t=(x, 0.0, 0.0)))
            if driven is often:
                driven.cell.catch_up()
        driven.fetch(1)
    a, b = (d.cell.cubes(d.counts)[1].T_base_cube for d in (often, once))
    assert a.tobytes() == b.tobytes()


def test_a_plate_that_is_pushed_shifts_with_its_cubes() -> None:
    driven = DrivenContact()
    before = driven.cell.world.boards[0].T_base_board
    cubes = driven.cell.cubes(driven.counts)
    side = (0.09, -0.08, -0.004)  # beside the long side, below the top
    edge = before @ transform(t=side) @ np.diag([1.0, -1.0, -1.0, 1.0])
    driven.line(edge @ transform(t=(0.0, 0.0, -0.1)))
    driven.line(edge)
    driven.line(edge @ transform(t=(0.0, -0.03, 0.0)))
    after = driven.cell.cubes(driven.counts)
    shift = driven.cell.world.boards[0].T_base_board[:3, 3] - before[:3, 3]
    assert np.linalg.norm(shift) > 2e-3
    for old, new in zip(cubes, after, strict=True):
        assert np.linalg.norm(new.T_base_cube[:3, 3] - old.T_base_cube[:3, 3] - shift) < 2e-3
    assert set(_events(driven)) == {f"cube {n} pushed" for n in (1, 2, 3, 4)}


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_the_counters_show_the_servos_share_of_a_push(share: float) -> None:
    driven = DrivenContact(world_of(contact={"servo_share": share}))
    cell = driven.cell
    q = cell.cell.q_start + (0.6, -0.3, 0.1, 0.2, 0.1, 0.0)
    counts = tuple(int(c) for c in cell.cell.unit.counts(q))
    T = cell.true_robot(cell.jaw_opening).T_base_tool(cell.positions(counts))
    cell._physics.put_hand(T)
    cell._away = False
    position = cell._physics._data.qpos[cell._physics._at :]
    off = np.array([1e-3, -0.5e-3, 2e-3])
    position[:3] += T[:3, :3] @ off
    read = np.add(counts, cell.pushed_back(counts))
    moved = cell.true_robot(cell.jaw_opening).T_base_tool(cell.positions(read))
    assert T[:3, :3].T @ (moved[:3, 3] - T[:3, 3]) == pytest.approx(share * off, abs=2e-5)
    position[:3] = T[:3, 3] + (0.0, 0.0, 1e-4)  # no push, but the lag of a hand that speeds up
    assert not any(cell.pushed_back(counts))


def test_nothing_is_simulated_while_the_empty_hand_is_far_from_everything() -> None:
    driven = DrivenContact()
    start = driven.cell.cubes(driven.counts)
    driven.line(driven.cell.poses[0] @ transform(t=(0.0, 0.0, -0.05)))
    driven.wait(100.0)
    assert driven.cell.simulated_steps == 0
    assert all(
        np.array_equal(a.T_base_cube, b.T_base_cube)
        for a, b in zip(start, driven.cell.cubes(driven.counts), strict=True)
    )


@pytest.mark.slow
def test_a_whole_run_seats_its_cubes_by_contact_physics(tmp_path: Path) -> None:
    scenes = quick_scenes(tmp_path, 2, 4)
    where = WhichCell(time_scale=100.0, contact=True)
    report = run_task(scenes / "task2.toml", Console(), where, tmp_path / "run")
    assert [cube["placed"] for cube in report["cubes"]] == [True, True]
    assert all(cube["error_mm"] < 0.05 for cube in report["cubes"])


def test_a_board_that_slides_takes_its_cubes_with_it() -> None:
    """After the first grasp, of a cube on another board; nothing that rests begins to move."""
    world = world_of()
    slides = replace(world.boards[1], shift=(0.003, -0.002, 0.02), cubes=(0, 2))
    driven = DrivenContact(replace(world, boards=(world.boards[0], slides)))
    before, stood = driven.cell.cubes(driven.counts), driven.cell.world.boards
    driven.fetch(1)
    driven.wait(0.5)
    after, boards = driven.cell.cubes(driven.counts), driven.cell.world.boards
    assert boards[0].T_base_board == pytest.approx(stood[0].T_base_board, abs=1e-4)
    assert boards[1].T_base_board == pytest.approx(slides.T_shift @ stood[1].T_base_board, abs=1e-4)
    for number in (4, 5):
        T = slides.T_shift @ before[number].T_base_cube
        assert after[number].T_base_cube == pytest.approx(T, abs=5e-4)
    assert _events(driven) == ["cube 2 gripped"]


@pytest.mark.parametrize(
    ("aside", "seated"), [((0.0, 0.0), True), ((1.5e-3, 0.5e-3), True), ((3e-3, 0.0), False)]
)
def test_a_cube_on_the_rim_holds_the_hand_back(aside: tuple[float, float], seated: bool) -> None:
    """By more than any arm at rest is off without contact, some 0.35 mm; one that goes in, by less."""
    driven = DrivenContact()
    driven.fetch(2)
    goal = driven.T_base_hole(1, 1) @ transform(t=(*aside, RELEASE_GAP)) @ OVER
    driven.line(goal @ transform(t=(0.0, 0.0, -LIFT)))
    driven.line(goal)
    driven.wait(0.5)
    driven.cell.catch_up()
    back = -driven.cell._physics.pushed_back()[2]
    assert (back < 0.2e-3) if seated else (back > 0.6e-3)
    driven.jaws(0.0)
    assert (driven.cell.events[-1].what == "placed") == seated
