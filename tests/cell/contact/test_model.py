"""The MuJoCo model of a cell, and what is said where MuJoCo is missing."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from arm.errors import InputError
from arm.io.storage import data_file
from arm.robot.shapes import Body, Sphere, Torus
from arm.se3 import rot_x, transform
from cell.config.cell_file import read_cell
from cell.contact.model import STEP_S, Builder, load_mujoco
from cell.sim.cell import SimulatedCell
from emulated.driven_contact import world_of


def test_without_mujoco_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(InputError, match=r"pip install 'a465\[contact\]'") as caught:
        load_mujoco()
    assert caught.value.exit_code == 2
    assert "\n" not in str(caught.value)


def test_the_model_is_the_true_cell() -> None:
    mujoco = pytest.importorskip("mujoco")
    cell = read_cell(data_file("scenes/cell.toml"))
    truth = SimulatedCell(cell, world_of("scenes/realistic/task2.world.toml", {"cube_mass": 0.1}))
    builder = Builder(mujoco, truth.world.contact)
    for cube in truth.cubes(cell.unit.counts(cell.q_start)):
        builder.add_cube(cube)
    for b in truth.world.boards:
        builder.add_plate(b.board.name, b)
    builder.add_hand(cell.robot(), cell.gripper.opening)
    model = builder.spec.compile()
    assert model.opt.timestep == STEP_S
    for cube in truth.cubes(cell.unit.counts(cell.q_start)):
        assert model.geom(cube.name).size * 2.0 == pytest.approx([cube.size] * 3)
        assert model.body(cube.name).mass[0] == pytest.approx(0.1)
        assert model.body(cube.name).inertia == pytest.approx([0.1 * cube.size**2 / 6.0] * 3)
    for b in truth.world.boards:
        assert np.abs(model.body(b.board.name).pos - b.T_base_board[:3, 3]).max() < 1e-12
        assert model.body(b.board.name).mass[0] == pytest.approx(truth.world.contact.plate_mass)
    assert model.body("hand").ipos == pytest.approx([0.0] * 3)


def test_a_torus_that_stands_still_is_a_ring_of_capsules() -> None:
    mujoco = pytest.importorskip("mujoco")
    builder = Builder(mujoco, world_of("scenes/realistic/task2.world.toml", {}).contact)
    at = transform(rot_x(1.0), (0.3, -0.2, 0.1))
    builder.add_still([Body("ring", Torus(0.1, 0.01), at, "wall"), Body("ball", Sphere(0.02), at, "wall")])
    model = builder.spec.compile()
    rings = [model.geom(i) for i in range(model.ngeom) if model.geom(i).name.startswith("ring")]
    assert model.ngeom == len(rings) + 1
    local = (np.array([ring.pos for ring in rings]) - at[:3, 3]) @ at[:3, :3]
    assert np.hypot(local[:, 0], local[:, 1]) == pytest.approx(0.1, rel=0.0025)
    assert local[:, 2] == pytest.approx(0.0, abs=1e-12)
    assert {float(ring.size[0]) for ring in rings} == {0.01}
