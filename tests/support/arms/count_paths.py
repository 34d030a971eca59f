"""Paths in whole counts for tests at the wire, and how far what was executed is from them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from arm.controller.segments import CountPath, Segment
from arm.controller.unit import Unit

Counts = npt.NDArray[np.int64]

DISTANCE = (30000, -4000, 15000, 9000, -20000, 25000)
OBJECT_ADC = 420


class Jaws:
    """Something 42 % wide stands between the jaws."""

    def jaws(self, counts: tuple[int, ...], from_adc: int, to_adc: int) -> int:
        return max(to_adc, OBJECT_ADC) if to_adc < from_adc else to_adc


def sweep(unit: Unit, start: tuple[int, ...], seconds: float = 6.0, fraction: float = 0.9) -> CountPath:
    """From rest to rest, the arm at `fraction` of its default speeds in the middle, as 100 ms cubics."""
    top = fraction * np.array(unit.speed_registers) / 256.0  # counts/ms
    way = np.array([1, 1, -1, -0.8, -0.6, 0.3]) * top * seconds * 1e3 / 1.5
    t = np.linspace(0.0, 1.0, round(seconds * 10) + 1)
    return _cubics(start, np.outer(t**2 * (3 - 2 * t), way), np.outer(6 * t * (1 - t), way))


def quintic(start: tuple[int, ...], pieces: int, distance: tuple[int, ...] = DISTANCE) -> CountPath:
    """From rest to rest by `distance` counts without a jump of acceleration, in cubics of 100 ms."""
    t, way = np.linspace(0.0, 1.0, pieces + 1), np.array(distance, dtype=float)
    return _cubics(
        start, np.outer(t**3 * (10 + t * (-15 + 6 * t)), way), np.outer(30 * t**2 * (1 - t) ** 2, way)
    )


def _cubics(
    start: tuple[int, ...], way: npt.NDArray[np.float64], slope: npt.NDArray[np.float64]
) -> CountPath:
    """Through knots (m, 6) with derivatives by the whole time, all coefficients whole numbers."""
    knots, slopes = np.rint(np.array(start) + way).astype(int), np.rint(slope / (len(way) - 1)).astype(int)
    cubics = []
    for d, v0, v1 in zip(np.diff(knots, axis=0), slopes[:-1], slopes[1:], strict=True):
        a3 = v0 + v1 - 2 * d
        cubics.append(Segment(100, tuple(tuple(int(c) for c in row) for row in (v0, d - v0 - a3, a3))))
    return CountPath(start, tuple(cubics))


def reversed_path(path: CountPath) -> CountPath:
    """The path from its end to its start, exact to the count."""
    back = []
    for segment in reversed(path.segments):
        a1, a2, a3 = np.array(segment.coefficients)  # cubics
        rows = (-(a1 + 2 * a2 + 3 * a3), a2 + 3 * a3, -a3)
        back.append(Segment(segment.duration_ms, tuple(tuple(int(c) for c in row) for row in rows)))
    return CountPath(path.end, tuple(back))


def distances_deg(unit: Unit, executed: Counts, path: CountPath) -> npt.NDArray[np.float64]:
    """How far each executed sample (m, 6) is from the nearest point of the path, deg, worst joint: (m,)."""
    ideal = np.degrees(unit.positions(path.sample(2.5e-4)))
    distance, _ = cKDTree(ideal).query(np.degrees(unit.positions(executed)), p=np.inf)
    return np.asarray(distance)


def distance_deg(unit: Unit, executed: Counts, path: CountPath) -> float:
    """The farthest of them."""
    return float(np.max(distances_deg(unit, executed, path)))


def off_path_deg(unit: Unit, counts: npt.ArrayLike, curve: npt.ArrayLike) -> float:
    """Farthest that any of positions (m, 6) in order is from the polyline of a curve (n, 6), n at least 2.

    Both are counts, the curve a corner a millisecond; the worst axis at the nearest point, deg.
    """
    return max((deg for deg, _ in departures(unit, counts, curve)), default=0.0)


def departures(
    unit: Unit, counts: npt.ArrayLike, curve: npt.ArrayLike
) -> list[tuple[float, npt.NDArray[np.float64]]]:
    """Of each position how far its worst axis is from the nearest point of the curve, deg, and that point, counts."""
    per_deg = np.abs(unit.counts_per_rad)[:, None] * np.pi / 180.0
    # axes first: sums and extremes over axes then run along the memory
    points, corners = np.asarray(counts).T / per_deg, np.ascontiguousarray(np.asarray(curve).T / per_deg)
    begins, ways = corners[:, :-1], np.diff(corners)
    lengths = np.maximum(np.einsum("ij,ij->j", ways, ways), 1e-30)
    found: list[tuple[float, npt.NDArray[np.float64]]] = []
    near, last = 0, ()
    for point in points.T[:, :, None]:
        here = (*point.ravel(), near)
        if here == last:  # an arm at rest, sought in the same part of the curve
            found.append(found[-1])
            continue
        last = here
        low = min(max(near - 300, 0), ways.shape[1] - 1)
        part = slice(low, near + 899)
        off, way = begins[:, part] - point, ways[:, part]
        share = np.clip(np.einsum("ij,ij->j", off, way) / -lengths[part], 0.0, 1.0)
        off += share * way
        distance = np.abs(off).max(axis=0)
        best = int(np.argmin(distance))
        near = low + best
        found.append((float(distance[best]), ((point + off[:, best, None]) * per_deg)[:, 0]))
    return found
