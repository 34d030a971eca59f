"""What a workshop made: as scattered as the world file says, the same in every session."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm.board import POCKET_FLOOR, POCKET_MOUTH
from arm.errors import InputError
from arm.io.storage import data_file
from arm.robot.tool import FixedTool
from arm.se3 import rotation, transform
from cell.config.cell_file import read_cell
from cell.files.world import World
from cell.sim.made import cube_sizes, made_board, require_on_table, target_print, texture, true_tool
from pictures.rendered import changed, world_with
from render.surface import Print

POCKET = (POCKET_MOUTH, POCKET_FLOOR)


@pytest.fixture
def world(tmp_path: Path) -> World:
    return world_with(tmp_path, "")


def test_a_board_below_the_table_is_refused(world: World) -> None:
    require_on_table(world, 0.0)
    board = world.boards[0]
    low = replace(board, T_base_board=transform(t=(0.4, 0.1, 0.002)))  # flat, of a plate 15 mm thick
    with pytest.raises(
        InputError, match=r"boards\[0\].centre_mm: puts the underside .* 13 mm below the top of the tab"
    ):
        require_on_table(replace(world, boards=(low,)), 0.0)
    require_on_table(replace(world, boards=(low,)), -0.012)


def test_without_keys_all_is_as_designed(world: World) -> None:
    made = made_board(world, world.boards[0], POCKET)
    assert np.array_equal(made.board.holes, world.boards[0].board.holes)
    assert made.board.pocket == POCKET
    plain = [replace(p, seed=(0,)) for p in (*made.prints, target_print(world))]
    assert plain == [Print()] * 3
    assert cube_sizes(world, 3, 0.04) == [0.04] * 3
    assert texture(world).plain


def test_holes_pockets_cubes_and_markers_scatter_as_stated(world: World) -> None:
    bad = changed(
        changed(world, "made", hole=1e-4, pocket=5e-5, cube=2e-5), "prints", glued=3e-4, glued_turn=1e-3
    )
    boards = [made_board(replace(bad, build_seed=seed), bad.boards[0], POCKET) for seed in range(150)]
    holes = np.array([b.board.holes - bad.boards[0].board.holes for b in boards])
    assert holes[..., :2].std() == pytest.approx(1e-4, rel=0.08)
    assert not holes[..., 2].any()
    pockets = np.array([b.board.pocket for b in boards]) - POCKET
    assert pockets[:, 0].std() == pytest.approx(5e-5, rel=0.2)
    assert pockets[:, 0] == pytest.approx(pockets[:, 1])
    shifts = np.array([p.shift for b in boards for p in b.prints])
    assert shifts.std() == pytest.approx(3e-4, rel=0.1)
    assert np.std([p.turn for b in boards for p in b.prints]) == pytest.approx(1e-3, rel=0.15)
    assert np.std(cube_sizes(bad, 400, 0.04)) == pytest.approx(2e-5, rel=0.12)


def test_the_same_is_made_in_every_session(world: World) -> None:
    bad = changed(changed(world, "made", hole=1e-4, cube=1e-4), "prints", glued=1e-4, warp=1e-4)
    today, tomorrow = (replace(bad, seed=seed) for seed in (1, 2))
    a, b = (made_board(w, w.boards[0], POCKET) for w in (today, tomorrow))
    assert np.array_equal(a.board.holes, b.board.holes)
    assert a.prints == b.prints
    assert a.prints[0] != a.prints[1]
    assert cube_sizes(today, 4, 0.04) == cube_sizes(tomorrow, 4, 0.04)
    assert target_print(today) == target_print(tomorrow)
    assert texture(today).seed == texture(tomorrow).seed != texture(replace(today, build_seed=9)).seed


def test_a_tool_without_jaws_is_where_the_world_says_and_one_with_jaws_where_the_cell_says(
    world: World,
) -> None:
    hoop = read_cell(data_file("scenes/hoop/cell.toml"))
    off = changed(
        world, "tool", tool_off=np.array([0.001, 0.0, -0.002]), tool_turned=np.array([0.0, 0.1, 0.0])
    )
    assert true_tool(hoop, world) is hoop.tool
    found = true_tool(hoop, off)
    assert isinstance(found, FixedTool)
    assert isinstance(hoop.tool, FixedTool)
    T = transform(rotation([0.0, 0.1, 0.0]), (0.001, 0.0, -0.002))
    np.testing.assert_allclose(found.T_flange_tool, T @ hoop.tool.T_flange_tool, atol=1e-15)
    jaws = read_cell(data_file("scenes/cell.toml"))
    assert true_tool(jaws, world) is jaws.tool
    with pytest.raises(InputError, match=r"tool.off_mm, tool.turned_deg: are for tools without jaws"):
        true_tool(jaws, off)
