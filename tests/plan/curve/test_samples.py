"""Samples of what is free: they cover it, and their neighbours are one step away, in both directions."""

from __future__ import annotations

import numpy as np
import pytest

from arm.errors import InputError
from plan.curve.samples import Samples, samples_of
from plan.curve.tool_curve import ToolCurve
from plan.kinematics.freedom import Freedom
from plans.curves import LINE, some_coordinates

STEPS = np.array([0.03, 0.03, 0.03, np.radians(20.0), np.radians(20.0), np.radians(20.0)])  # m and rad
TILT = np.radians(15.0)  # rad
FREEDOMS = [
    (Freedom({}), ()),
    (Freedom({}), ("rz",)),
    (Freedom({"rz": (-0.1, 0.1)}), ()),
    (Freedom({"rz": (0.5, 3.0)}), ()),
    (Freedom({}, 0.05), ()),
    (Freedom({}, np.radians(30.0)), ("rz",)),
    (Freedom({"x": (-0.04, 0.05), "y": (-0.01, 0.01)}, 0.3), ()),
    (Freedom({"z": (-0.1, -0.02), "rx": (-0.5, 0.2), "ry": (0.0, 0.4)}), ("rz",)),
]
every_freedom = pytest.mark.parametrize(("freedom", "free"), FREEDOMS)


def made(freedom: Freedom, free: tuple[str, ...]) -> tuple[ToolCurve, Samples]:
    curve = ToolCurve(LINE, freedom, free)
    return curve, samples_of(curve)


def apart(one: np.ndarray, two: np.ndarray, free: tuple[str, ...]) -> np.ndarray:
    """Differences (..., 6) of coordinates; of a rotation without limits the shorter way round."""
    found = np.abs(one - two)
    if "rz" in free:
        found[..., 5] = np.minimum(found[..., 5], 2.0 * np.pi - found[..., 5])
    return np.asarray(found)


@every_freedom
def test_samples_are_within_what_is_free_and_the_least_deviation_is_first(
    freedom: Freedom, free: tuple[str, ...]
) -> None:
    curve, samples = made(freedom, free)
    c = samples.coordinates
    places = np.full(len(c), 0.5 * curve.length)
    away, turned = curve.excess(places, curve.placed(places, c))
    assert max(away.max(), turned.max()) < 1e-9
    low, high = curve.box()
    bounded = np.isfinite(high)
    np.testing.assert_allclose(c[0, bounded], np.clip(0.0, low, high)[bounded], atol=1e-12)
    assert len(np.unique(np.round(c, 9), axis=0)) == len(c)


@every_freedom
def test_samples_cover_what_is_free(freedom: Freedom, free: tuple[str, ...]) -> None:
    """Every coordinate has a sample within one step."""
    curve, samples = made(freedom, free)
    for some in some_coordinates(np.random.default_rng(5), curve, 200):
        off = apart(samples.coordinates, some, free)
        within = off <= STEPS + 1e-9
        if freedom.tilt > 0.0:
            swing = np.linalg.norm(samples.coordinates[:, 3:5] - some[3:5], axis=1)
            within[:, 3:5] = (swing <= min(TILT, freedom.tilt) + 1e-9)[:, None]
        assert within.all(axis=1).any()


@pytest.mark.parametrize(("low", "high"), [(-0.1, 0.1), (-0.5, 0.2), (0.2, 0.3), (-1.0, 1.0), (-0.7, 0.0)])
def test_the_ends_of_a_range_are_samples(low: float, high: float) -> None:
    """A way past a body may lead along a limit."""
    for name, factor in (("rz", 1.0), ("y", 0.5), ("rx", 1.0)):
        _, samples = made(Freedom({name: (factor * low, factor * high)}), ())
        column = samples.coordinates[:, ("x", "y", "z", "rx", "ry", "rz").index(name)]
        assert column.min() == pytest.approx(factor * low, abs=1e-12)
        assert column.max() == pytest.approx(factor * high, abs=1e-12)


def test_a_small_range_of_position_is_left_to_the_smoothing() -> None:
    _, samples = made(Freedom({"x": (-0.014, 0.014), "y": (-0.014, 0.05)}), ())
    assert not samples.coordinates[:, 0].any()
    assert (samples.coordinates[:, 1].min(), samples.coordinates[:, 1].max()) == (0.0, 0.05)


def test_more_samples_than_memory_holds_are_refused() -> None:
    with pytest.raises(InputError, match="makes 42750 samples at each place"):
        made(Freedom(dict.fromkeys(("x", "y", "z"), (-0.04, 0.04)), 0.5), ("rz",))


@every_freedom
def test_neighbours_are_symmetric_and_within_one_step(freedom: Freedom, free: tuple[str, ...]) -> None:
    _, samples = made(freedom, free)
    c, near = samples.coordinates, samples.neighbours
    count = len(c)
    beside = np.zeros((count, count), dtype=bool)
    beside[np.arange(count)[:, None], near] = True
    assert beside.diagonal().all()
    assert np.array_equal(beside, beside.T)
    off = apart(c[:, None], c[near], free)
    assert (off <= STEPS + 1e-9).all()
    if freedom.tilt > 0.0:
        assert np.linalg.norm(c[:, None, 3:5] - c[near][..., 3:5], axis=2).max() <= TILT + 1e-9


@every_freedom
def test_every_sample_can_be_reached_from_the_first(freedom: Freedom, free: tuple[str, ...]) -> None:
    _, samples = made(freedom, free)
    seen, edge = {0}, [0]
    while edge:
        edge = [one for one in set(samples.neighbours[edge].ravel().tolist()) if one not in seen]
        seen.update(edge)
    assert len(seen) == len(samples.coordinates)


def test_a_rotation_without_limits_goes_all_the_way_round() -> None:
    _, samples = made(Freedom({}), ("rz",))
    angles = samples.coordinates[:, 5]
    for row, near in zip(angles, samples.neighbours, strict=True):
        assert len(set(near.tolist())) == 3
        steps = np.angle(np.exp(1j * (angles[near] - row)))
        np.testing.assert_allclose(np.sort(steps), (-np.pi / 9.0, 0.0, np.pi / 9.0), atol=1e-9)
