"""The wires and the hoop of scenes/hoop are those of the drawings, and bodies contain what they stand for."""

from __future__ import annotations

import json
import runpy
import shutil
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.io.storage import data_file
from arm.plan_file import read_plan, write_plan
from arm.robot.shapes import Body, Box, Torus
from arm.se3 import Array, apply, inverse
from cell.config.cell_file import read_cell
from cell.files.world import read_world
from cell.program.outline import Arc, Outline
from cell.program.path_step import PathStep
from cell.program.planning import plan_of_program, require_threads
from cell.program.points import read_wire
from cell.program.program_file import read_program
from cell.program.steps import Step
from cell.task.plan_matches import replayed, replayed_to_json, scene_of_now
from typed.command_line import a465, replace_in
from typed.doc_pages import ROOT
from vision.observation import Observation

MADE = runpy.run_path(str(ROOT / "docs/wires.py"))
# length of the centre line and turns at its corners; the last direction is that of the free end
DRAWN = {
    "a": (200.0, [], (0, 0, 1)),
    "b": (80 + 70 * np.sqrt(2) + 50, [45, 45], (0, 0, 1)),
    "c": (50 + 2 * 50 * np.sqrt(2) + 50, [45, 60, 45], (0, 0, 1)),
    "d": (30 + 15 * np.sqrt(2) + 60 + 25 * np.pi + 50, [45, 45], (1, 0, 0)),
    "e": (
        30 + 34.641 + 50 * np.sqrt(2) + 25 * np.pi + 50 * np.sqrt(2) + 50,
        [30, 52.24, 45, 45, 45],
        (0, 1, 0),
    ),
}
FREE_ENDS = {
    "a": (0, 0, 200),
    "b": (70, 0, 200),
    "c": (-50, -50, 200),
    "d": (85, 0, 155),
    "e": (32.68, 100, 160),
}


def _line(wire: str) -> Outline:
    outline = read_wire(data_file(f"scenes/hoop/wires/{wire}.toml")).outline
    assert outline is not None
    return outline


@pytest.mark.parametrize("wire", DRAWN)
def test_centre_lines_are_those_of_the_drawings(wire: str) -> None:
    outline, (length, corners, ahead) = _line(wire), DRAWN[wire]
    assert 1e3 * outline.length == pytest.approx(length, abs=0.01)
    turns = np.degrees(outline.turns())
    np.testing.assert_allclose(turns[turns > 0.01], corners, atol=0.01)
    np.testing.assert_allclose(
        1e3 * outline.at([0.0, outline.length]), [(0, 0, 0), FREE_ENDS[wire]], atol=1e-6
    )
    last = outline.pieces[-1]
    np.testing.assert_allclose(last.directions(np.array([last.length]))[0], ahead, atol=1e-9)
    for piece in outline.pieces:
        assert not isinstance(piece, Arc) or piece.radius == pytest.approx(0.05, abs=1e-5)


@pytest.mark.parametrize("wire", DRAWN)
def test_the_files_are_those_that_the_script_makes(wire: str) -> None:
    assert data_file(f"scenes/hoop/wires/{wire}.toml").read_text() == MADE["text_of"](wire)


@pytest.mark.parametrize("wire", DRAWN)
def test_the_boxes_contain_the_bar_and_little_else(wire: str) -> None:
    """Points of the bar, 10 x 10 mm about its centre line and mitred where it bends, are inside of some box."""
    outline = _line(wire)
    bodies = [
        b
        for b in read_wire(data_file(f"scenes/hoop/wires/{wire}.toml")).bodies
        if not b.name.startswith("foot")
    ]
    turned = MADE["sections"](outline)
    rng = np.random.default_rng(21)
    half = 0.005
    for k, piece in enumerate(outline.pieces):
        s = rng.uniform(0.0, piece.length, 2000)
        across = np.hstack([rng.uniform(-half, half, (2000, 2)), np.zeros((2000, 1))])
        if isinstance(piece, Arc):
            axis = np.cross(piece.outward, piece.ahead)
            R = np.array([MADE["_about"](axis, a) @ turned[k] for a in s / piece.radius])
            points = piece.at(s) + np.einsum("nij,nj->ni", R, across)
        else:
            points = piece.at(s) + across @ turned[k].T
        assert _depths(points, bodies).min() > -1e-9
    for k, joint in enumerate(outline.joints[1:-1]):  # the mitred edges, where both bars meet
        corner, (before, after) = outline.at([joint])[0], list(pairwise(outline.pieces))[k]
        d = before.directions(np.array([before.length]))[0], after.directions(np.zeros(1))[0]
        edges = [turned[k + 1] @ (half * np.array([i, j, 0.0])) for i in (-1, 1) for j in (-1, 1)]
        mitred = [corner + e - d[1] * (e @ (d[0] + d[1])) / (1.0 + d[0] @ d[1]) for e in edges]
        assert _depths(np.array(mitred), bodies).min() > -1e-9
    boxes = [b.shape.size for b in bodies if isinstance(b.shape, Box)]
    assert len(boxes) == len(bodies)
    assert max(min(size) for size in boxes) < 0.0103


def test_the_boxes_of_the_foot_contain_its_triangle_and_no_marker() -> None:
    """Straight edge of 43.8 mm at y = 5, apex at y = -21.9; the nearer corner of marker 2 is at (17.5, -17.5)."""
    feet = [b for b in read_wire(data_file("scenes/hoop/wires/b.toml")).bodies if b.name.startswith("foot")]
    rng = np.random.default_rng(5)
    y = rng.uniform(-21.9, 5.0, 3000)
    x = rng.uniform(-1.0, 1.0, 3000) * 21.9 * (y + 21.9) / 26.9
    z = rng.uniform(-2.5, 0.0, 3000)
    assert _depths(np.stack([x, y, z], axis=1) / 1e3, feet).min() > -1e-9
    assert _depths(np.array([[0.0175, -0.0175, -0.001]]), feet).max() < 0.0


def _depths(points: Array, bodies: list[Body]) -> Array:
    """How deep each point is inside of the box that contains it best, m."""
    found = []
    for body in bodies:
        local = np.abs(apply(inverse(body.T_base_body), points))
        found.append((np.array(body.shape.size) / 2.0 - local).min(axis=1))  # type: ignore[union-attr]
    return np.asarray(np.max(found, axis=0))


@pytest.mark.few(2)
@pytest.mark.parametrize("wire", DRAWN)
def test_a_program_threads_the_ring_over_the_free_end_and_leads_it_down(wire: str) -> None:
    task = read_program(data_file(f"scenes/hoop/{wire}.toml"))
    (path,) = task.steps
    assert isinstance(path, PathStep)
    assert path.threaded is not None
    assert (path.threaded.name, path.threaded.ring) == (wire, "ring 1")
    outline, (_, _, ahead) = _line(wire), DRAWN[wire]
    free_end = outline.at([outline.length])[0]
    np.testing.assert_allclose(path.threaded.points[[0, -1]], [(0, 0, 0), free_end], atol=1e-12)
    first, last = path.outline.at([0.0, path.outline.length])
    np.testing.assert_allclose(first, free_end + 0.04 * np.array(ahead), atol=1e-9)
    assert last[2] == pytest.approx(
        0.0275, abs=2e-4
    )  # 30 mm above the board, whose top is 2.5 below the plate's
    on_wire = path.outline.at(np.linspace(0.04, path.outline.length, 300))
    assert np.min([piece.distances(on_wire) for piece in outline.pieces], axis=0).max() < 0.0031


def test_the_hoop_is_at_the_flange_and_its_rings_contain_the_rings_section() -> None:
    """Inside 60, outside 69.6, thick 6.6 mm: two tori contain half a section each; the hole loses 0.3 mm of 30."""
    cell = read_cell(data_file("scenes/hoop/cell.toml"))
    T = cell.tool.T_flange_tool
    np.testing.assert_allclose(T[:3, :3], np.diag([-1, 1, -1]), atol=1e-12)
    np.testing.assert_allclose(1e3 * T[:3, 3], [-135, 0, 13], atol=1e-9)
    assert not cell.has_jaws
    rings = [b for b in cell.robot().bodies if isinstance(b.shape, Torus)]
    assert [b.name for b in rings] == ["ring 1", "ring 2"]
    at = np.array([b.T_joint_body[:3, 3] for b in rings]) - np.mean(
        [b.T_joint_body[:3, 3] for b in rings], axis=0
    )
    for ring, axial, half in zip(rings, at, ((-0.0033, 0.0), (0.0, 0.0033)), strict=True):
        np.testing.assert_allclose(axial[:2], 0.0, atol=1e-9)
        shape = ring.shape
        assert isinstance(shape, Torus)
        section = np.array([(r, z - axial[2]) for r in (0.030, 0.0348) for z in half])
        assert np.hypot(section[:, 0] - shape.radius, section[:, 1]).max() <= shape.tube
        assert shape.radius - shape.tube > 0.0297


@pytest.mark.parametrize("wire", ["a", *(pytest.param(wire, marks=pytest.mark.slow) for wire in "bcde")])
def test_the_program_of_a_wire_is_planned_and_its_plan_proves_that_the_ring_stays_threaded(
    wire: str, tmp_path: Path
) -> None:
    task = read_program(data_file(f"scenes/hoop/{wire}.toml"))
    plan = plan_of_program(task, Observation(), task.cell.speed)
    along = [move for move in plan.moves if move.threaded == wire]
    assert [move.name for move in along] == [f"along wire {wire.upper()}", f"back along wire {wire.upper()}"]
    assert all(move.threaded is None for move in plan.moves if move not in along)
    moves = replayed(task, plan)
    assert min(move.check.clearance for move in moves) >= 0.005 - 1e-6
    told = [move["name"] for move in replayed_to_json(plan, moves)["moves"] if move["threaded"] == wire]
    assert told == [move.name for move in along]
    write_plan(tmp_path / "plan.json", plan)
    said, _ = a465("check", tmp_path / "plan.json", data_file(f"scenes/hoop/{wire}.toml"))
    assert f"the ring stays threaded on {wire}: proved for 2 moves" in said
    require_threads(task, plan)
    touches = replace(along[0], allowed_pairs=(("bar 1", "ring 1"),))
    edited = replace(plan, steps=tuple(touches if step is along[0] else step for step in plan.steps))
    with pytest.raises(
        ImpossibleError, match="lets touch bar 1 and ring 1, which the program does not allow"
    ):
        require_threads(task, edited)
    unthreaded = replace(task, steps=tuple(_without_thread(step) for step in task.steps))
    with pytest.raises(
        ImpossibleError, match=f"the plan's scene is not that of the present cell: the line of {wire}"
    ):
        scene_of_now(unthreaded, plan)


def _without_thread(step: Step) -> Step:
    return replace(step, threaded=None) if isinstance(step, PathStep) else step


@pytest.mark.slow
def test_the_ring_is_led_along_a_wire_whose_board_is_seen_by_its_markers(tmp_path: Path) -> None:
    """The board lies where only the world file says; wire, foam and hoop are in the pictures of the looks."""
    file, look, plan = data_file("scenes/hoop/seen.toml"), tmp_path / "look.json", tmp_path / "plan.json"
    a465("look", file, "-o", look)
    said, _ = a465("plan", file, "--look", look, "-o", plan, "--json")
    assert json.loads(said)["boards"] == ["01-02"]
    task, truth = read_program(file), read_world(file.with_suffix(".world.toml"), 0.04)
    stated = {body["name"]: np.array(body["T_base_body"]) for body in read_plan(plan).scene["bodies"]}
    true = {body.name: body for body in task.bodies_at(truth.boards[0].T_base_board @ task.T_on_work)}
    assert set(true) < set(stated)
    assert max(np.linalg.norm(stated[name][:3, 3] - true[name].T_base_body[:3, 3]) for name in true) < 2e-3
    assert {"plate 01-02", "stand 01-02"} < set(stated)
    a465("check", plan, file)
    said, _ = a465("execute", plan, file, "--json", "--time-scale", "100", cwd=tmp_path)
    assert json.loads(said)["plan_sha256"] == read_plan(plan).sha256


@pytest.mark.slow
def test_a_board_of_which_a_lamp_hides_a_marker_is_found_by_its_outline(tmp_path: Path) -> None:
    for folder in ("hoop", "cameras"):
        shutil.copytree(data_file(f"scenes/{folder}"), tmp_path / folder)
    file, cell, look = tmp_path / "hoop/seen.toml", tmp_path / "hoop/cell.toml", tmp_path / "look.json"
    lamp = "[[walls]]\nname = 'lamp'\ncentre_mm = [516, -6.5, 90]\nsize_mm = [44, 44, 10]\nrpy_deg = [0, 0, 15]\n"
    replace_in(cell, "[look]", lamp + "\n[look]")
    a465("look", file, "-o", look)
    (found,) = json.loads(look.read_text())["scenes"][0]["boards"]
    true = read_world(file.with_suffix(".world.toml"), 0.04).boards[0].T_base_board
    off = np.linalg.inv(np.array(found["T_base_board"])) @ true
    assert found["verdict"] == "accepted"
    assert np.linalg.norm(off[:3, 3]) < 4e-3
    assert np.degrees(np.arccos(off[2, 2])) < 1.0
    replace_in(tmp_path / "hoop/boards/puzzle_01-02.toml", "outline_within_mm", "# outline_within_mm")
    _, told = a465("look", file, code=3)
    assert "marker 2 is hidden, or less than 3 px inside the image; marker 1 alone does not determine" in told
