"""Meshes from STL and OBJ: the same corners from each, and what is no mesh is told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm.errors import FileInputError
from arm.io.storage import MOST_BYTES
from arm.robot.mesh import read_mesh_points

CORNERS = np.array([(0, 0, 0), (1, 0, 0), (0, 2, 0), (0, 0, 3.5)])
FACES = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))


def binary_stl(title: bytes = b"") -> bytes:
    layout = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    triangles = np.zeros(len(FACES), dtype=layout)
    triangles["corners"] = CORNERS[np.array(FACES)]
    return title.ljust(80, b" ") + len(FACES).to_bytes(4, "little") + triangles.tobytes()


def ascii_stl() -> bytes:
    lines = ["solid wedge"]
    for face in FACES:
        lines += ["facet normal 0 0 0", "  outer loop"]
        lines += [f"    vertex {x:e} {y:e} {z:e}" for x, y, z in CORNERS[list(face)]]
        lines += ["  endloop", "endfacet"]
    return "\r\n".join([*lines, "endsolid wedge"]).encode()


def obj() -> bytes:
    lines = ["# a wedge", "o wedge", *(f"v {x} {y} {z} 1.0" for x, y, z in CORNERS), "vn 0 0 1", "vt 0 0"]
    return "\n".join([*lines, *(f"f {a + 1}//1 {b + 1}//1 {c + 1}//1" for a, b, c in FACES)]).encode()


@pytest.mark.parametrize("data", [binary_stl(), binary_stl(b"solid though it is binary"), ascii_stl(), obj()])
def test_the_same_corners_from_every_format(data: bytes, tmp_path: Path) -> None:
    path = tmp_path / "wedge.stl"
    path.write_bytes(data)
    points = read_mesh_points(path)
    assert points.tolist() == sorted(CORNERS.tolist())
    assert not points.flags.writeable


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "is not a mesh; it must be an STL"),
        (b"solid nothing\nendsolid nothing\n", "is not a mesh"),
        (binary_stl()[:-7], "is not a mesh.*cut off|is not a mesh"),
        (bytes(80) + (0).to_bytes(4, "little"), "has no vertices"),
        (ascii_stl().replace(b"3.500000e+00", b"high"), "line 1[0-9].*must be three numbers"),
        (b"v 1 2\n", "line 1 = 'v 1 2': must be three numbers"),
        (ascii_stl().replace(b"3.500000e+00", b"inf"), "a vertex that is not three finite numbers"),
        (b"\x89PNG\r\n\x1a\n\xff\xfe" * 20, "is not a mesh"),
    ],
)
def test_other_files_are_refused_as_meshes(data: bytes, message: str, tmp_path: Path) -> None:
    path = tmp_path / "broken.stl"
    path.write_bytes(data)
    with pytest.raises(FileInputError, match=message) as caught:
        read_mesh_points(path)
    assert str(path) in str(caught.value)


def test_a_missing_or_oversized_mesh_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(FileInputError, match="cannot be read"):
        read_mesh_points(tmp_path / "missing.stl")
    (tmp_path / "large.stl").write_bytes(ascii_stl())
    monkeypatch.setitem(MOST_BYTES, "mesh", 500)
    with pytest.raises(FileInputError, match="which is the limit for a mesh file"):
        read_mesh_points(tmp_path / "large.stl")
