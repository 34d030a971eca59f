"""Scenes: names that are one of a kind, JSON there and back, digests."""

from __future__ import annotations

from dataclasses import replace

import pytest

from arm.errors import InputError
from arm.robot.model import load_a465
from arm.se3 import transform
from plan.scene import scene_from_json
from tasks.task2 import TABLE, Task2, task2


@pytest.fixture(scope="module")
def case() -> Task2:
    return task2()


def test_json_goes_there_and_back(case: Task2) -> None:
    value = case.scene.to_json()
    again = scene_from_json(value, case.scene.robot_open, case.scene.robot_holding)
    assert again.to_json() == value
    assert again.digest == case.scene.digest
    assert [b.name for b in again.bodies] == [b.name for b in case.scene.bodies]


def test_digest_changes_with_what_stands_where(case: Task2) -> None:
    moved = TABLE.at(transform(t=(0.35, 0.0, -0.0201)))
    bodies = tuple(moved if b.name == "table" else b for b in case.scene.bodies)
    assert replace(case.scene, bodies=bodies).digest != case.scene.digest
    assert replace(case.scene, allowed=frozenset()).digest != case.scene.digest
    assert task2().scene.digest == case.scene.digest


def test_two_bodies_of_one_name_are_refused(case: Task2) -> None:
    with pytest.raises(InputError, match="two bodies are named 'table'"):
        replace(case.scene, bodies=(*case.scene.bodies, TABLE))
    with pytest.raises(InputError, match="two bodies are named 'palm'"):
        replace(case.scene, cubes=(replace(case.scene.cubes[0], name="palm"),))


def test_allowed_contacts_name_known_bodies(case: Task2) -> None:
    with pytest.raises(InputError, match="'tabel', which is not a body"):
        replace(case.scene, allowed=frozenset([frozenset(("cube 1", "tabel"))]))


def test_cube_by_name(case: Task2) -> None:
    assert case.scene.cube("cube 2") is case.scene.cubes[1]
    with pytest.raises(InputError, match="must be a cube of the scene: cube 1, cube 2") as caught:
        case.scene.cube("cube 9")
    assert caught.value.data["name"] == "cube 9"


def test_scene_of_another_arm_is_refused(case: Task2) -> None:
    other = load_a465(0.134112, 0.05)
    whole = {**case.scene.to_json(), "threads": 5}
    with pytest.raises(InputError, match="threads must be a list"):
        scene_from_json(whole, case.scene.robot_open, case.scene.robot_holding)
    with pytest.raises(InputError, match="robot_open has digest"):
        scene_from_json(case.scene.to_json(), other, case.scene.robot_holding)


def test_the_next_of_a_supply_is_absent_until_the_one_in_front_is_put_down(case: Task2) -> None:
    a, b, c, *_ = (cube.name for cube in case.scene.cubes)
    scene = replace(case.scene, supplies=((a, b, c),))
    assert scene.absent(()) == {b, c}
    assert scene.absent({a}) == {c}
    assert scene.absent({a, b}) == scene.absent({a, b, c}) == set()
    assert replace(scene, supplies=((a, c), (b,))).absent(()) == {c}
    value = scene.to_json()
    assert value["supplies"] == [[a, b, c]]
    assert scene_from_json(value, scene.robot_open, scene.robot_holding).supplies == scene.supplies
    assert "supplies" not in case.scene.to_json()
    for wrong in ([a], "ab", [[1]]):
        with pytest.raises(InputError, match="supplies must be lists of names"):
            scene_from_json({**value, "supplies": wrong}, scene.robot_open, scene.robot_holding)


def test_a_supply_is_of_cubes_each_once(case: Task2) -> None:
    a = case.scene.cubes[0].name
    for supplies in ((("table",),), ((a, a),), ((a,), (a,))):
        with pytest.raises(
            InputError, match=r"supplies name .*, which must be a cube of the scene, and in one supply once"
        ):
            replace(case.scene, supplies=supplies)
