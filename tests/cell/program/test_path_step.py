"""Paths of a program file: along lines and arcs, travelled either way, longer or shorter, with or without stops."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm.errors import InputError
from arm.se3 import inverse
from cell.program.path_step import PathStep
from cell.program.program_file import read_program
from programs.program_files import program
from typed.command_line import replace_in


def test_a_path_with_corners_is_rounded_or_has_legs(tmp_path: Path) -> None:
    file = program(tmp_path)
    path = (
        'points_mm = [[0, 0, 100], [50, 0, 100], [50, 50, 100]]\naxis = [0, 0, -1]\n[[steps]]\nname = "wire"'
    )
    replace_in(file, 'name = "wire"', path)
    sharp = read_program(file).steps[2]
    assert isinstance(sharp, PathStep)
    legs = sharp.legs()
    assert len(legs) == 2
    np.testing.assert_allclose(legs[0][-1], legs[1][0])
    np.testing.assert_allclose(legs[1][0][:3, 3], [0.05, 0, 0.1])
    replace_in(file, "axis = [0, 0, -1]", "axis = [0, 0, -1]\ndeviation_mm = 2")
    rounded = read_program(file).steps[2]
    assert isinstance(rounded, PathStep)
    assert len(rounded.legs()) == 1
    assert rounded.outline.length < sharp.outline.length
    relative = inverse(rounded.poses.T_work_tool[0]) @ rounded.poses.T_work_tool[-1]
    np.testing.assert_allclose(relative[:3, :3], np.eye(3), atol=1e-12)


@pytest.mark.parametrize(("backwards", "first", "last"), [(False, -20, 230), (True, 220, -30)])
def test_a_line_is_prolonged_before_its_start_and_behind_its_end(
    tmp_path: Path, backwards: bool, first: float, last: float
) -> None:
    """The axis has the direction of the line as it is stated, whichever way it is travelled."""
    file = program(tmp_path)
    replace_in(file, "backwards = true", f"backwards = {str(backwards).lower()}")
    replace_in(file, "extend_mm = [60, -30]", "extend_mm = [20, 30]")
    path = read_program(file).steps[2]
    assert isinstance(path, PathStep)
    z = 1e3 * path.poses.T_work_tool[[0, -1], 2, 3]
    np.testing.assert_allclose(z, [first, last], atol=1e-9)
    np.testing.assert_allclose(
        path.poses.T_work_tool[:, :3, 2], np.tile([0, 0, 1], (len(path.poses.s), 1)), atol=1e-9
    )
    assert path.threaded is None


def test_a_thread_is_the_whole_line_of_a_wire_file(tmp_path: Path) -> None:
    """From the foot to the free end, whichever part of it the path follows; arcs as dense as the path is."""
    file = program(tmp_path)
    tool = file.with_name("tool.toml")
    replace_in(tool, 'shape = "cylinder"', 'shape = "torus"')
    replace_in(tool, "length_mm = 6.6", "tube_mm = 5.83")
    arc = "{ through_mm = [60, 0, 120], to_mm = [0, 0, 200] }"
    wire = file.with_name("wire.toml")
    replace_in(wire, "[0, 0, 200]]", f"[0, 0, 40], {arc}]")
    wire.write_text(
        f'{wire.read_text()}\n[[bodies]]\nname = "bow"\ncentre_mm = [30, 0, 120]\nsize_mm = [80, 10, 170]\n'
    )
    replace_in(file, 'axis = "along"', 'axis = "along"\nthreaded = "ring"')
    replace_in(file, 'touch = [["ring", "bar"]]\n', "")
    path = read_program(file).steps[2]
    assert isinstance(path, PathStep)
    assert path.threaded is not None
    assert (path.threaded.name, path.threaded.ring) == ("wire", "ring")
    np.testing.assert_allclose(
        path.threaded.points[[0, 1, -1]], [(0, 0, 0), (0, 0, 0.04), (0, 0, 0.2)], atol=1e-9
    )
    a, b = path.threaded.points[1:-1], path.threaded.points[2:]
    radius = (0.06**2 + 0.08**2) / 0.12
    assert (radius - np.sqrt(radius**2 - (np.linalg.norm(b - a, axis=1) / 2) ** 2)).max() < 5.1e-6
    replace_in(file, 'line_of = "wire.toml"', "points_mm = [[0, 0, 0], [0, 0, 200]]")
    with pytest.raises(InputError, match=r"threaded = 'ring': needs line_of"):
        read_program(file)


DRAWING = '<svg viewBox="0 0 100 50"><path d="M 10 40 h 20 v -20"/><circle cx="60" cy="20" r="10"/></svg>'


def _drawing(folder: Path, more: str = "") -> Path:
    file = program(folder)
    file.with_name("d.svg").write_text(DRAWING)
    keys = 'svg = "d.svg"\nwidth_mm = 100\ncorner_mm = [5, 6, 7]\nlift_mm = 4\ndeviation_mm = 0.5\naxis = [0, 0, -1]\n'
    replace_in(file, 'name = "wire"\n', f'name = "drawing"\n{keys}{more}\n[[steps]]\nname = "wire"\n')
    return file


def test_a_drawing_has_a_smooth_path_for_each_stroke_down_to_the_plane_and_up(tmp_path: Path) -> None:
    steps = read_program(_drawing(tmp_path)).steps
    strokes = [step for step in steps if isinstance(step, PathStep) and step.name.startswith("drawing")]
    assert [stroke.name for stroke in strokes] == ["drawing, stroke 1", "drawing, stroke 2"]
    line, circle = (stroke.outline for stroke in strokes)
    for outline in (line, circle):
        assert len(outline.corners()) == 0
        z = 1e3 * outline.at([0.0, 0.002 * np.pi, outline.length - 0.002 * np.pi, outline.length])[:, 2]
        np.testing.assert_allclose(z, [11, 7, 7, 11], atol=1e-6)
    begins = 1e3 * np.array([outline.at([0.002 * np.pi])[0] for outline in (line, circle)])
    np.testing.assert_allclose(begins, [[15, 16, 7], [55, 36, 7]], atol=1e-5)
    corner = np.array([[0.035, 0.016, 0.007]])
    assert min(float(p.distances(corner)[0]) for p in line.pieces) == pytest.approx(5e-4 - 1.07e-4, rel=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("width_mm = 100\n", "", r"steps\[1\].width_mm: is missing"),
        ("lift_mm = 4\n", "", r"steps\[1\].lift_mm: is missing"),
        (
            "lift_mm = 4",
            "backwards = true",
            r"steps\[1\].backwards = True: needs points_mm or line_of or meander_mm",
        ),
        (
            "axis = [0, 0, -1]",
            'axis = "along"',
            r"steps\[1\].axis = 'along': must be a direction x, y, z, with svg",
        ),
        ('svg = "d.svg"', "points_mm = [[0, 0, 0], [0, 0, 9]]", r"steps\[1\].width_mm = 100: needs svg"),
        (
            "deviation_mm = 0.5",
            "deviation_mm = 0.1",
            r"steps\[1\].deviation_mm = 0.1: must be 0, or at least 0.2 mm",
        ),
        ("deviation_mm = 0.5", "deviation_mm = 51", r"steps\[1\].deviation_mm = 51: must be .* 50"),
        ("width_mm = 100", "width_mm = 100\npitch_mm = 2", r"steps\[1\].pitch_mm = 2: needs meander_mm"),
    ],
)
def test_keys_of_a_drawing_belong_to_a_drawing(tmp_path: Path, old: str, new: str, message: str) -> None:
    file = _drawing(tmp_path)
    replace_in(file, old, new)
    with pytest.raises(InputError, match=message):
        read_program(file)


def _meander(folder: Path, more: str = "") -> Path:
    file = program(folder)
    keys = f"meander_mm = [50, 20]\npitch_mm = 6\ncorner_mm = [5, 6, 7]\naxis = [0, 0, -1]\n{more}"
    replace_in(file, 'name = "wire"\n', f'name = "pass"\n{keys}\n[[steps]]\nname = "wire"\n')
    return file


@pytest.mark.parametrize("backwards", [False, True])
def test_a_meander_covers_its_rectangle_with_lines_at_most_a_pitch_apart(
    tmp_path: Path, backwards: bool
) -> None:
    path = read_program(_meander(tmp_path, f"backwards = {str(backwards).lower()}")).steps[2]
    assert isinstance(path, PathStep)
    ends = 1e3 * np.array([path.outline.at([s])[0] for s in path.outline.joints])
    ends = ends[::-1] if backwards else ends
    np.testing.assert_allclose(
        ends[:, 1], np.repeat([6, 11, 16, 21, 26], 2), atol=1e-9
    )  # 20 mm in four steps
    np.testing.assert_allclose(ends[:, 0], [5, 55, 55, 5, 5, 55, 55, 5, 5, 55], atol=1e-9)
    np.testing.assert_allclose(ends[:, 2], 7, atol=1e-9)
    assert len(path.legs()) == 9


def test_a_meander_with_arcs_comes_down_and_leaves_along_its_lines(tmp_path: Path) -> None:
    path = read_program(_meander(tmp_path, "deviation_mm = 1\nlift_mm = 4")).steps[2]
    assert isinstance(path, PathStep)
    assert len(path.legs()) == 1
    np.testing.assert_allclose(1e3 * path.outline.at([0.0, path.outline.length]), [[1, 6, 11], [59, 26, 11]])
    assert path.outline.at(np.linspace(0.0, path.outline.length, 1000))[:, 2].min() >= 0.007 - 1e-12


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("pitch_mm = 6\n", "", r"steps\[1\].pitch_mm: is missing"),
        (
            "pitch_mm = 6",
            "pitch_mm = 6\nextend_mm = [1, 1]",
            r"extend_mm = \[1, 1\]: needs points_mm or line_of",
        ),
        ("pitch_mm = 6", "pitch_mm = 6\nwidth_mm = 9", r"steps\[1\].width_mm = 9: needs svg"),
        ("meander_mm = [50, 20]\npitch_mm = 6", "meander_mm = [50, 50]\npitch_mm = 0.1", "makes 501 lines"),
    ],
)
def test_keys_of_a_meander_belong_to_a_meander(tmp_path: Path, old: str, new: str, message: str) -> None:
    file = _meander(tmp_path)
    replace_in(file, old, new)
    with pytest.raises(InputError, match=message):
        read_program(file)


@pytest.mark.parametrize(
    "change", ["window_mm = 0.025", "extend_mm = [0.04, -0.02]", "ranges = { x_mm = [0, 0.006] }"]
)
def test_lengths_of_a_path_in_metres_are_told(tmp_path: Path, change: str) -> None:
    file = program(tmp_path)
    text = file.read_text()
    lines = [line for line in text.splitlines() if not line.startswith(change.partition(" ")[0])]
    file.write_text("\n".join(lines).replace('axis = "along"', f'axis = "along"\n{change}'))
    with pytest.raises(InputError, match=r"steps\[1\].*is it in metres\?"):
        read_program(file)
