"""Vertices of meshes from STL (binary and ASCII) and OBJ files. Only hulls are used, so faces do not matter."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from arm.errors import FileInputError
from arm.io.storage import read_bytes
from arm.se3 import Array, frozen

_HEADER, _TRIANGLE = 84, 50  # bytes of a binary STL: before its triangles, and of each triangle


def read_mesh_points(path: Path) -> Array:
    """Return the distinct vertices (n, 3) of all faces, in the file's unit.

    A file whose size matches its header is a binary STL; other files must be text.

    Raises:
        FileInputError: the file cannot be read, is too large, is not a mesh, or has a number that is not finite.
    """
    data = read_bytes(path, "mesh")
    count = int.from_bytes(data[_HEADER - 4 : _HEADER], "little")
    is_binary = len(data) >= _HEADER and len(data) == _HEADER + _TRIANGLE * count
    points = _binary(data) if is_binary else _text(path, data)
    if not len(points):
        raise FileInputError(path, "", None, "has no vertices; it must be an STL or OBJ file with faces")
    if not np.isfinite(points).all():
        raise FileInputError(path, "", None, "has a vertex that is not three finite numbers")
    return frozen(np.unique(points, axis=0))


def _binary(data: bytes) -> Array:
    """Read triangles: normal, three vertices, two attribute bytes."""
    layout = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    triangles = np.frombuffer(data, dtype=layout, offset=_HEADER)
    return triangles["corners"].reshape(-1, 3).astype(float)


def _text(path: Path, data: bytes) -> Array:
    """Read lines ``vertex x y z`` of an ASCII STL, or ``v x y z`` of an OBJ file."""
    rule = "is not a mesh; it must be an STL (binary or ASCII) or OBJ file"
    try:
        lines = data.decode("utf-8").splitlines()
    except UnicodeDecodeError as error:
        raise FileInputError(path, "", None, rule, "or a binary STL that was cut off") from error
    points = []
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if words and words[0] in ("vertex", "v"):
            try:
                points.append([float(w) for w in words[1:4]])
            except ValueError as error:
                raise FileInputError(path, f"line {number}", line[:60], "must be three numbers") from error
            if len(points[-1]) != 3:
                raise FileInputError(path, f"line {number}", line[:60], "must be three numbers")
    if not points:
        raise FileInputError(path, "", None, rule)
    return np.array(points)
