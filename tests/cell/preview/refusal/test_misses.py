"""The misses of a refusal: bodies as near as it says, computed again, and places by how much they are missed."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm.errors import ImpossibleError, InputError
from cell.commands.plan_poses import plan_poses_step, plan_program_step, reach_program_step
from cell.commands.steps import plan_step
from cell.console import Console
from cell.files.reading import reading_of
from cell.preview.of_place import place_shown
from cell.preview.refusal.misses import MOST, Miss, misses_of
from cell.program.program_file import is_program
from pages.refused import (
    Refusal,
    arm_in_a_post,
    arm_out_of_reach,
    program_beside_a_post,
    program_out_of_reach,
)
from plan.collision.world import World
from plan.failure import failure_in
from plans.other_arms import scara_files
from programs.pallets import pallet

SLAB = """
[[walls]]
name = "slab"
centre_mm = [520, -60, 230]
size_mm = [60, 60, 20]
"""
QUIET = Console(as_json=True)


def plan_it(asked: Refusal, output: Path) -> None:
    if is_program(asked.file):
        plan_program_step(asked.file, None, output, None, QUIET, advice=False)
    else:
        reading = reading_of(None, None, "m")
        plan_poses_step(asked.file, Path(asked.words[2]), None, output, reading, None, False, QUIET)


def error_of(asked: Refusal, folder: Path) -> ImpossibleError:
    with pytest.raises(ImpossibleError) as caught:
        plan_it(asked, folder / "plan.json")
    return caught.value


def shown(error: ImpossibleError, file: Path, look: Path | None = None) -> list[Miss]:
    place = place_shown(file, look)
    return misses_of(error, place.setting, place.q_start, place.known)


def require_as_told(error: ImpossibleError, misses: list[Miss]) -> None:
    """Require that each miss of bodies is as near as the refusal says."""
    failure = failure_in(error)
    assert failure is not None
    ways = {(w.where, w.yaw, w.branch): w for w in failure.ways if w.pair}
    told = [(w.pair, w.distance_mm, w.required_mm) for w in ways.values()][: len(misses)]
    assert len(told) == len(misses) > 0
    for miss, (pair, distance, required) in zip(misses, told, strict=True):
        assert miss.pair == pair
        assert miss.distance is not None
        assert miss.points is not None
        assert 1e3 * miss.distance == pytest.approx(distance, abs=1e-4)
        if miss.distance > 0.0:
            apart = float(np.linalg.norm(miss.points[0] - miss.points[1]))
            assert apart >= miss.distance - 1e-6  # paddings are subtracted
        assert miss.required == (None if required is None else pytest.approx(1e-3 * required))


@pytest.mark.parametrize("make", [arm_in_a_post, pytest.param(program_beside_a_post, marks=pytest.mark.slow)])
def test_two_bodies_are_as_near_as_the_refusal_says(make: Callable[[Path], Refusal], tmp_path: Path) -> None:
    asked = make(tmp_path)
    error = error_of(asked, tmp_path)
    misses = shown(error, asked.file)
    require_as_told(error, misses)
    assert misses[0].pair == asked.pair


def test_a_pose_that_no_arm_reaches_is_missed_by_what_is_lacking(tmp_path: Path) -> None:
    """The SCARA's links reach 550 mm from its axis, and it can turn its tool by any angle."""
    asked = arm_out_of_reach(tmp_path)
    (miss,) = shown(error_of(asked, tmp_path), asked.file)
    assert [place.name for place in miss.places] == [asked.place]
    assert miss.away == pytest.approx(np.hypot(0.68, 0.2) - 0.55, abs=1e-5)
    assert miss.turned == pytest.approx(0.0, abs=1e-5)
    assert miss.pair == ()


@pytest.mark.parametrize("seed", range(3))
def test_the_distance_is_that_of_the_two_bodies_whatever_else_is_nearer(tmp_path: Path, seed: int) -> None:
    arm = scara_files(tmp_path)
    place = place_shown(arm, None)
    world = World(place.setting.robot, place.setting.scene.bodies)
    q = np.random.default_rng(seed).uniform(place.setting.limits.lower, place.setting.limits.upper)
    for number, value in enumerate(world.pair_distances(q, np.arange(len(world.pairs)))):
        data = {"pair": list(world.pair_names(number)), "clearance_m": 0.01, **world.state(q)}
        (miss,) = misses_of(ImpossibleError("no", **data), place.setting, place.q_start, place.known)
        assert set(miss.pair) == set(data["pair"])
        assert miss.distance == pytest.approx(value, abs=1e-9)


@pytest.mark.slow
def test_stations_of_a_program_are_the_same_for_plan_and_for_reach(tmp_path: Path) -> None:
    far = program_out_of_reach(tmp_path)
    (planned,) = shown(error_of(far, tmp_path), far.file)
    with pytest.raises(ImpossibleError) as caught:
        reach_program_step(far.file, None, QUIET)
    (reached,) = shown(caught.value, far.file)
    assert planned.away is not None
    assert reached.away is not None
    assert planned.away > 0.05
    (post := tmp_path / "post").mkdir()
    near = program_beside_a_post(post)
    with pytest.raises(ImpossibleError) as caught:
        reach_program_step(near.file, None, QUIET)
    require_as_told(caught.value, shown(caught.value, near.file))


@pytest.mark.slow
def test_of_a_task_what_is_in_the_jaws_counts_and_the_page_has_room(
    planned_scenes: Path, tmp_path: Path
) -> None:
    """A slab above a hole, which the gripper hits with and without a cube in its jaws."""
    scenes = Path(shutil.copytree(planned_scenes, tmp_path / "scenes"))
    cell = scenes / "cell.toml"
    cell.write_text(cell.read_text() + SLAB)
    with pytest.raises(ImpossibleError) as caught:
        plan_step(scenes / "task2.toml", scenes / "look.json", tmp_path / "plan.json", None, QUIET)
    misses = shown(caught.value, scenes / "task2.toml", scenes / "look.json")
    assert len(misses) <= MOST
    require_as_told(caught.value, misses)
    assert any(in_tool for miss in misses for _, _, in_tool in miss.cubes)


def test_places_that_a_refusal_names_are_marked_at_the_start(planned_scenes: Path) -> None:
    task, look = planned_scenes / "task2.toml", planned_scenes / "look.json"
    place = place_shown(task, look)
    named: dict[str, Any]
    for named, expected in (
        ({"hole": "01-02/3"}, ["01-02/3"]),
        ({"board": "03-04"}, ["03-04"]),
        ({"below_mm": {"01-02/1": 3.0, "01-02/2": 2.0}}, ["01-02/1", "01-02/2"]),
    ):
        (miss,) = misses_of(ImpossibleError("no", **named), place.setting, place.q_start, place.known)
        assert [one.name for one in miss.places] == expected
        assert (miss.q == place.q_start).all()
    assert misses_of(ImpossibleError("no", board="99"), place.setting, place.q_start, place.known) == []


def test_parts_that_would_stand_too_near_are_shown_where_they_would_stand(tmp_path: Path) -> None:
    file = pallet(tmp_path, ("52, 36]", "47, 36]"))
    with pytest.raises(ImpossibleError, match=r"mm from part 1 .required") as caught:
        plan_program_step(file, None, tmp_path / "plan.json", None, QUIET, advice=False)
    place = place_shown(file, None, whole=False)
    (miss,) = misses_of(caught.value, place.setting, place.q_start, place.known)
    assert miss.pair == ("part 2", "part 1")
    assert miss.distance == pytest.approx(0.003, abs=1e-6)
    assert miss.required == 0.005
    assert {body.name for body, _, _ in miss.cubes} == {"part 1", "part 2"}
    with pytest.raises(ImpossibleError, match=r"mm from part 1 .required"):
        place_shown(file, None)


def test_a_refusal_of_another_arm_is_not_shown(tmp_path: Path) -> None:
    asked = arm_in_a_post(tmp_path)
    error = error_of(asked, tmp_path)
    for way in error.data["failure"]["ways"]:
        way["at"]["robot"] = "0" * 64
    with pytest.raises(InputError, match="of another arm"):
        shown(error, asked.file)
