"""Ways to rest: usual poses agree with their own rest, and limits exclude what would fall or could not stand."""

from __future__ import annotations

import numpy as np
import pytest

from arm.board import POCKET_FLOOR, POCKET_MOUTH
from arm.se3 import Array, rot_x, rot_z, rotation, transform
from cell.sim.release_faults import T_hole_released
from pictures.boards import CUBE
from vision.loose.rests import Rest, possible, prior, rests, usual_normal

POCKET = (POCKET_MOUTH, POCKET_FLOOR)


def _released(name: str, quarters: int = 0) -> Array:
    return transform(rot_z(quarters * np.pi / 2.0)) @ T_hole_released(name, CUBE)


def _misfits(T: Array) -> list[float]:
    return [float((prior(rest, T, CUBE, POCKET) ** 2).sum()) for rest in rests(POCKET)]


@pytest.mark.parametrize("quarters", range(4))
def test_each_fault_of_a_release_agrees_with_one_rest_alone(quarters: int) -> None:
    for name, kind in (("aside", "flat"), ("rim", "flat"), ("high", "upright"), ("half", "leaning")):
        T = _released(name, quarters)
        misfits = np.array(_misfits(T))
        best = rests(POCKET)[int(np.argmin(misfits))]
        assert best.kind == kind
        assert misfits.min() < 3.0
        assert np.sort(misfits)[1] > misfits.min() + 9.0
        assert possible(best, T, CUBE, POCKET)
        if kind == "leaning":  # its top leans towards the lower edge, away from the raised side
            assert usual_normal(best) @ T[:3, 2] > np.cos(np.radians(1.0))


# poses of cubes after releases beside a pocket in contact physics: middle in mm, normal of the top, yaw in deg
JAMMED = (
    ((-4.50, -0.15, 16.23), (0.243, 0.0, 0.970), 0.5),
    ((-0.30, -4.64, 16.26), (0.0, 0.244, 0.970), -0.9),
    ((-0.42, 3.56, 16.12), (-0.002, -0.238, 0.971), 1.1),
    ((-0.80, -1.78, 15.86), (0.0, 0.225, 0.974), -2.3),
    ((3.37, -0.04, 16.10), (-0.234, 0.001, 0.972), -0.2),
    ((-0.57, 1.70, 15.98), (-0.009, -0.228, 0.974), 1.1),
    ((1.21, 0.01, 15.86), (-0.218, 0.0, 0.976), 0.0),
    ((-1.68, -1.97, 16.11), (-0.033, 0.252, 0.967), -3.2),  # beyond the capture along both axes
)


@pytest.mark.parametrize(("middle", "normal", "yaw"), JAMMED)
def test_a_cube_that_was_released_beside_its_pocket_is_wedged(
    middle: tuple[float, ...], normal: tuple[float, ...], yaw: float
) -> None:
    axis = np.cross((0.0, 0.0, 1.0), normal)
    R = rotation(axis / np.linalg.norm(axis) * np.arcsin(np.linalg.norm(axis))) @ rot_z(np.radians(yaw))
    T = transform(R, 1e-3 * np.array(middle))
    misfits = np.array(_misfits(T))
    best = rests(POCKET)[int(np.argmin(misfits))]
    assert best.kind == "wedged"
    assert misfits.min() < 8.0
    assert np.sort(misfits)[1] > misfits.min() + 9.0
    assert possible(best, T, CUBE, POCKET)


def test_a_flat_cube_must_not_drop_or_tip_into_the_pocket() -> None:
    def flat(x: float, yaw_deg: float) -> bool:
        T = transform(rot_z(np.radians(yaw_deg)), (x, 0.0, CUBE / 2.0))
        return possible(Rest("flat"), T, CUBE, POCKET)

    assert flat(0.025, 0.0)
    assert flat(0.0, 45.0)
    assert not flat(0.0, 0.0)
    assert not flat(0.010, 0.0)
    assert possible(Rest("flat"), transform(t=(0.01, 0.0, CUBE / 2.0)), CUBE, None)


def test_a_cube_in_a_pocket_is_aligned_and_leans_within_limits() -> None:
    upright, leaning = Rest("upright"), Rest("leaning", (0.0, 1.0))
    high = _released("high")
    assert possible(upright, high, CUBE, POCKET)
    assert not possible(upright, high @ transform(rot_z(np.radians(9.0))), CUBE, POCKET)
    assert not possible(upright, transform(t=(0.004, 0.0, 0.0)) @ high, CUBE, POCKET)
    assert not possible(upright, high @ transform(rot_x(np.radians(4.0))), CUBE, POCKET)
    assert not possible(leaning, high, CUBE, POCKET)
    assert not possible(leaning, high @ transform(rot_x(np.radians(-20.0))), CUBE, POCKET)
