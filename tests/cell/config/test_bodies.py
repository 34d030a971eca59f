"""Bodies of a cell file."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm.errors import InputError
from arm.io.node import Node
from arm.robot.shapes import Capsule, Convex, Cylinder, Sphere, Torus, convex, shape_from_json, shape_to_json
from cell.config.bodies import pose_of, read_body
from cell.config.cell_file import read_cell
from cell.task.plan_matches import _same_shape as same_shape

WEDGE = "".join(
    f"v {x} {y} {z}\n" for x, y, z in [(0, 0, 0), (80, 0, 0), (0, 60, 0), (0, 0, 90), (10, 10, 10)]
)

WALLS = """
[[walls]]
name = "column"
shape = "cylinder"
radius_mm = 30
length_mm = 400
centre_mm = [500, 300, 200]
rpy_deg = [90, 0, 0]

[[walls]]
name = "ball"
shape = "sphere"
radius_mm = 50
centre_mm = [500, 300, 200]

[[walls]]
name = "rail"
shape = "capsule"
radius_mm = 20
length_mm = 300
centre_mm = [500, 300, 200]

[[walls]]
name = "wedge"
mesh = "wedge.obj"
mesh_unit = "mm"
origin_mm = [500, 300, 200]
rpy_deg = [0, 0, 90]

[[walls]]
name = "ring"
shape = "torus"
radius_mm = 32.4
tube_mm = 4.8
centre_mm = [500, 300, 200]
rpy_deg = [90, 0, 0]
"""


def test_walls_of_every_shape(scenes: Path) -> None:
    (scenes / "wedge.obj").write_text(WEDGE)
    (scenes / "cell.toml").write_text((scenes / "cell.toml").read_text() + WALLS)
    walls = {b.name: b for b in read_cell(scenes / "cell.toml").fixed if b.kind == "wall"}
    assert walls["column"].shape == Cylinder(0.03, 0.4)
    assert walls["column"].T_base_body[:3, 2] == pytest.approx([0, -1, 0])  # its axis, turned about x
    assert walls["column"].T_base_body[:3, 3] == pytest.approx([0.5, 0.3, 0.2])
    assert walls["ball"].shape == Sphere(0.05)
    assert walls["rail"].shape == Capsule(0.02, 0.3)
    assert walls["ring"].shape == Torus(0.0324, 0.0048)
    assert walls["ring"].T_base_body[:3, 2] == pytest.approx([0, -1, 0])  # the axis of its circle
    wedge = walls["wedge"].shape
    assert isinstance(wedge, Convex)
    corners = np.array([(0, 0, 0), (0, 0, 0.09), (0, 0.06, 0), (0.08, 0, 0)])
    assert np.array(sorted(wedge.points)) == pytest.approx(corners)
    assert walls["wedge"].T_base_body @ [0.08, 0, 0, 1] == pytest.approx([0.5, 0.38, 0.2, 1])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            '"cylinder"',
            '"cylnder"',
            r"walls\[1\].shape = 'cylnder': must be one of box.*did you mean 'cylinder'",
        ),
        ("radius_mm = 50", "", r"walls\[2\].radius_mm: is missing"),
        ("tube_mm = 4.8", "", r"walls\[5\].tube_mm: is missing"),
        ("tube_mm = 4.8", "tube_mm = 0", r"walls\[5\].tube_mm = 0: must be a number in mm from 1 to 10000"),
        ("tube_mm = 4.8", "tube_mm = 32.4", r"walls\[5\].tube_mm = 32.4: must be less than radius_mm, 32.4"),
        (
            "radius_mm = 50",
            "radius_mm = 50\nlength_mm = 3",
            r"walls\[2\].length_mm = 3: is not a known key of a sphere \(shape cylinder or capsule has it\)",
        ),
        (
            "radius_mm = 50",
            "diameter_mm = 100",
            r"walls\[2\].diameter_mm.*\(give radius_mm, which is half of it\)",
        ),
        (
            '"sphere"',
            '"box"',
            r"walls\[2\].radius_mm = 50: is not a known key of a box \(shape cylinder or sphere",
        ),
        (
            'shape = "sphere"',
            "",
            r"radius_mm = 50: is not a known key of a box, which a body without shape is",
        ),
        ("radius_mm = 20", "radius_mm = 0", r"walls\[3\].radius_mm = 0: must be a number in mm from 1"),
        ('"wedge.obj"', '"none.stl"', r"walls\[4\].mesh = 'none.stl': names a file that does not exist"),
        ('"wedge.obj"', '"task2.toml"', r"walls\[4\].mesh = 'task2.toml': cannot be used: .*is not a mesh"),
        ('mesh_unit = "mm"', "", r"walls\[4\].mesh_unit: is missing; it must be one of mm, m"),
        ('mesh_unit = "mm"', 'mesh_unit = "m"', r"walls\[4\].mesh_unit = 'm': makes the mesh 80 x 60 x 90 m"),
        ("[0, 0, 90]", "[0, 90]", r"walls\[4\].rpy_deg = \[0, 90\]: must be 3 numbers in deg"),
        ("origin_mm", "centre_mm", r"walls\[4\].centre_mm.*of a mesh, .*\(of a mesh it is origin_mm\)"),
    ],
)
def test_mistakes_in_walls_are_told(scenes: Path, old: str, new: str, message: str) -> None:
    (scenes / "wedge.obj").write_text(WEDGE)
    (scenes / "cell.toml").write_text((scenes / "cell.toml").read_text() + WALLS.replace(old, new, 1))
    with pytest.raises(InputError, match=message):
        read_cell(scenes / "cell.toml")


def test_bodies_are_turned_as_in_urdf() -> None:
    """By roll, pitch and yaw about fixed axes, which is what SciPy calls xyz in small letters."""
    rng = np.random.default_rng(7)
    for _ in range(20):
        degrees = rng.uniform(-180.0, 180.0, 3)
        T = pose_of(np.array([0.01, 0.02, 0.03]), np.radians(degrees))
        assert T[:3, :3] == pytest.approx(Rotation.from_euler("xyz", degrees, degrees=True).as_matrix())
        assert T[:3, 3] == pytest.approx([0.01, 0.02, 0.03])


def test_a_hull_in_a_plan_is_held_against_the_mesh_of_now() -> None:
    points = np.random.default_rng(3).normal(size=(30, 3))
    now = convex(points)
    assert same_shape(shape_from_json(json.loads(json.dumps(shape_to_json(now)))), now)
    corners = np.array(now.points)
    assert not same_shape(convex(corners[:-1]), now)
    assert not same_shape(convex(corners + [[1e-6, 0, 0]]), now)
    assert not same_shape(Sphere(0.1), now)


def test_a_mesh_in_m_that_is_said_to_be_in_mm_is_told(scenes: Path) -> None:
    (scenes / "wedge.obj").write_text(re.sub(r"\d+", lambda mm: f"{int(mm[0]) / 1e3}", WEDGE))
    (scenes / "cell.toml").write_text((scenes / "cell.toml").read_text() + WALLS)
    with pytest.raises(
        InputError, match=r"mesh_unit = 'mm': makes the mesh .* mm; a body .*\(is it in m\?\)"
    ):
        read_cell(scenes / "cell.toml")


@pytest.mark.parametrize(
    ("kind", "place", "told"),
    [
        ("wall", [0.42, 0.02, 0.11], "must be 2 mm or more from the arm's axis"),
        ("tool", [0, 0, 0.119], r"must be \[0, 0, 0\], or 0.5 mm or more from there"),
        ("work", [0.42, 0.02, 0.11], ""),
        ("wall", [0, 0, -300], ""),
    ],
)
def test_a_body_in_metres_is_told(kind: str, place: list[float], told: str) -> None:
    value = {"name": "post", "size_mm": [40, 40, 200], "centre_mm": place}
    node = Node(Path("a.toml"), "bodies[0]", value)
    if not told:
        assert read_body(node, kind).T_base_body[:3, 3] == pytest.approx(np.array(place) / 1e3)
        return
    with pytest.raises(InputError, match=rf"bodies\[0\].centre_mm = .*: {told}.*\(is it in metres\?\)"):
        read_body(node, kind)


def test_a_flat_mesh_is_told(scenes: Path) -> None:
    (scenes / "wedge.obj").write_text(WEDGE.replace("90", "0").replace("10 10 10", "10 10 0"))
    (scenes / "cell.toml").write_text((scenes / "cell.toml").read_text() + WALLS)
    with pytest.raises(InputError, match=r"walls\[4\].mesh = 'wedge.obj': cannot be used: .*one plane"):
        read_cell(scenes / "cell.toml")
