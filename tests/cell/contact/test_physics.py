"""The hand as a spring, and jaws with a force."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm.errors import A465Error
from arm.se3 import angle_between, rot_z, transform
from cell.contact.model import STEP_S
from emulated.driven_contact import OVER, START, DrivenContact, world_of

mujoco = pytest.importorskip("mujoco")


def test_the_hand_follows_its_target_and_rests_there() -> None:
    physics = DrivenContact().cell._physics
    physics.put_hand(START)
    end = START @ transform(rot_z(0.4), (0.02, 0.05, -0.03))
    for share in np.linspace(0.0, 1.0, 500):
        physics.follow(START @ transform(rot_z(0.4 * share), share * np.array([0.02, 0.05, -0.03])), 1)
    assert (
        np.abs(physics.pose("hand")[:3, 3] - end[:3, 3]).max() < 0.1e-3
    )  # it does not lag at constant speed
    for _ in range(200):
        physics.follow(end, 1)
    assert physics.hand_still
    assert np.abs(physics.pose("hand")[:3, 3] - end[:3, 3]).max() < 1e-6
    assert angle_between(physics.pose("hand")[:3, :3], end[:3, :3]) < 1e-6


@pytest.mark.parametrize("stiffness", [1e4, 5e4])
def test_the_hand_gives_way_by_force_over_stiffness(stiffness: float) -> None:
    driven = DrivenContact(world_of(contact={"hand_stiffness": stiffness}))
    physics = driven.cell._physics
    table = transform(START[:3, :3], (0.3, 0.4, 0.0))
    physics.put_hand(table @ transform(t=(0.0, 0.0, -0.01)))
    for height in np.linspace(-0.01, 0.001, 400):  # 1 mm into the table
        physics.follow(table @ transform(t=(0.0, 0.0, float(height))), 1)
    for _ in range(300):
        physics.follow(table @ transform(t=(0.0, 0.0, 0.001)), 1)
    assert physics.pose("hand")[2, 3] == pytest.approx(0.0, abs=5e-5)
    pushed = sum(_force_on(physics, i) for i in range(physics._data.ncon))
    assert pushed == pytest.approx(stiffness * 1e-3, rel=0.05)


def _force_on(physics: object, contact: int) -> float:
    force = np.zeros(6)
    mujoco.mj_contactForce(physics._model, physics._data, contact, force)  # type: ignore[attr-defined]
    return float(force[0])


@pytest.mark.parametrize("force", [5.0, 40.0])
def test_jaws_press_with_their_force(force: float) -> None:
    driven = DrivenContact(world_of(contact={"jaw_force": force}))
    physics, grip = driven.cell._physics, driven.T_base_hole(0, 1) @ OVER
    physics.put_hand(grip)
    assert physics.move_jaws(0.006, grip) == pytest.approx(0.04, abs=3e-4)
    contacts = physics._data.contact
    finger = physics._geoms["finger_l"]
    pressed = sum(_force_on(physics, i) for i, pair in enumerate(contacts.geom) if finger in pair)
    assert pressed == pytest.approx(force, rel=0.05)
    assert physics.gripped("cube 2")
    assert not physics.gripped("cube 1")
    assert physics.move_jaws(0.05, grip) == pytest.approx(0.05, abs=1e-4)


def test_a_cube_that_one_finger_touches_is_not_gripped() -> None:
    driven = DrivenContact()
    physics = driven.cell._physics
    physics.put_hand(driven.T_base_hole(0, 1) @ OVER @ transform(t=(0.0, 0.0102, 0.0)))
    assert any(physics._geoms["cube 2"] in pair for pair in physics._data.contact.geom.tolist())
    assert not physics.gripped("cube 2")


def test_a_cell_at_rest_stays_where_the_world_file_puts_it() -> None:
    driven = DrivenContact(world_of("scenes/realistic/task2.world.toml"))
    physics = driven.cell._physics
    physics.put_hand(START)
    before = {c.name: physics.pose(c.name) for c in driven.cell._cubes}
    for _ in range(round(1.0 / STEP_S)):
        physics.follow(START, 1)
    assert physics.at_rest
    for name, T in before.items():
        assert np.abs(physics.pose(name)[:3, 3] - T[:3, 3]).max() < 0.1e-3
        assert angle_between(physics.pose(name)[:3, :3], T[:3, :3]) < np.radians(0.1)


def test_an_unstable_simulation_is_an_error_and_leaves_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    physics = DrivenContact().cell._physics
    physics.put_hand(START)
    physics._data.qvel[-1] = 1e20
    with pytest.raises(A465Error, match="became unstable"):
        physics.follow(START, 5)
    assert not list(tmp_path.iterdir())
