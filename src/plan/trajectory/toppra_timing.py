"""Time parametrisation by the library toppra (H. Pham, Q.-C. Pham, https://github.com/hungpham2511/toppra).

It solves the same stages as `plan.trajectory.topp_ra`, with a linear program at each. The stages are given to it as
they are, with derivatives from inside every interval: where the second derivative of a path jumps, toppra's own
constraints would take it from the wrong side. The library is imported when it is first used, which takes 2 s.
"""

from __future__ import annotations

import logging
import warnings
from functools import lru_cache
from types import ModuleType
from typing import Any

import numpy as np

from arm.controller.unit import Limits
from arm.errors import ImpossibleError
from arm.se3 import Array
from plan.trajectory.topp_ra import Gridpoints, speed_caps

_SLOWER = (1.0, 0.999, 0.99)  # factors on the largest rates, in the order of the attempts


def parametrise_by_toppra(
    stage: Gridpoints, limits: Limits, ease: Array | None = None
) -> tuple[Array, Array]:
    """Do as `plan.trajectory.topp_ra.parametrise`, but with constant d2s/dt2 in straight intervals, too.

    Raises:
        ImpossibleError: toppra gives no answer, as for a few paths of a thousand.
    """
    # its tolerances are absolute: a parameter whose rate is at most about 1
    with np.errstate(divide="ignore"):
        rate = float(np.minimum((limits.velocity / np.abs(stage.first)).min(axis=(1, 2)), stage.cap).max())
    unit = rate if np.isfinite(rate) else 1.0
    for factor in _SLOWER:
        found = _solved(stage, limits, np.ones(len(stage.cap)) if ease is None else ease, unit, factor)
        if found is not None and np.isfinite(found).all():
            return stage.s, found * unit
    raise ImpossibleError(
        "toppra finds no timing of a path; plan with timing = own",
        timing="toppra",
        gridpoints=len(stage.s),
    )


def _solved(stage: Gridpoints, limits: Limits, ease: Array, unit: float, factor: float) -> Array | None:
    """Return the rates (n + 1,) of s / unit at the grid points, or None."""
    toppra = _library()
    step = 2.0 * np.diff(stage.s)[:, None]
    first, second = stage.first * unit, stage.second * unit**2
    # rows of each interval: at its beginning, and at its end with the same second derivative of s
    A = np.concatenate([first[:, 0], first[:, -1] + step / unit * second[:, -1]], axis=1)
    B = np.concatenate([second[:, 0], second[:, -1]], axis=1)
    bound = np.concatenate([limits.acceleration, limits.acceleration])
    A, B = (np.concatenate([M, M[-1:]]) * np.append(ease, 1.0)[:, None] / bound for M in (A, B))
    with np.errstate(divide="ignore", invalid="ignore"):
        inside = np.minimum((limits.velocity / np.abs(first)).min(axis=-1), stage.cap[:, None] / unit) ** 2
        caps = np.minimum(factor**2 * speed_caps(inside), 10.0)
    rows = A.shape[1]
    both = np.concatenate([np.eye(rows), -np.eye(rows)])

    class Stages(toppra.constraint.LinearConstraint):  # type: ignore[misc, name-defined]
        """|A u + B x| <= 1 and 0 <= x <= caps at every grid point."""

        def __init__(self) -> None:
            super().__init__()
            self.identical = True

        def compute_constraint_params(self, path: object, gridpoints: Array, *_: object) -> tuple[Any, ...]:
            x = np.stack([np.zeros(len(caps)), caps], axis=1)
            return A, B, np.zeros_like(A), both, np.ones(2 * rows), None, x

    class Interval:
        """The least that toppra asks of a path whose stages are known."""

        dof, waypoints = first.shape[-1], None
        path_interval = stage.s[[0, -1]] / unit

    solver = toppra.algorithm.TOPPRA(
        [Stages()], Interval(), gridpoints=stage.s / unit, solver_wrapper="seidel"
    )
    with np.errstate(all="ignore"):
        _, rate, _ = solver.compute_parameterization(0.0, 0.0)
    return None if rate is None else np.asarray(rate)


@lru_cache(maxsize=1)
def _library() -> ModuleType:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of its docstrings and its own imports
        import toppra
        import toppra.algorithm
        import toppra.constraint
    logging.getLogger("toppra").setLevel(logging.CRITICAL)  # its failures show in the result
    module: ModuleType = toppra
    return module
