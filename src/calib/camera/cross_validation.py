"""What views say that the lens has not seen: each is held out once, in groups.

Every group's lens is fitted without it; the group's corners then check that lens (their own poses free), and how much
the lenses of the groups differ at the work points gives their error without any assumption on noise (delete-a-group
jackknife; B. Efron, 1982). Where that is much larger than the error predicted from the residuals, the residuals are
not independent and the prediction is too good.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm.se3 import Array
from calib.camera.bundle_adjustment import (
    Blocks,
    Bools,
    Bundle,
    View,
    adjust,
    blocks_of,
    information,
    residual_of,
    solve_scaled,
)
from calib.camera.initial_guess import pose_of
from calib.camera.working_volume import WorkPoints
from calib.model.intrinsics import vector_of

GROUPS = 5


@dataclass(frozen=True, eq=False)
class CrossCheck:
    """What held-out views say.

    Attributes:
        sigma_px: error of their corners' coordinates, px, free of what the poses' six numbers a view take up and of
            what the lens without them may be off: one view at an edge of the image that no other reaches misses the
            lens of the others by much more than its corners err, and nothing is wrong.
        work_sigmas: (n,) m jackknife standard deviation of each work point.
    """

    sigma_px: float
    work_sigmas: Array


def _owed_to_lens(blocks: Blocks, known: Array, free: Bools) -> float:
    """Squares, px^2, of a view's residuals that a lens takes up which moves as far as `known` (9, 9) lets it."""
    S = (known + blocks.reduced())[np.ix_(free, free)]
    g = (blocks.lens_gradient - blocks.both @ np.linalg.solve(blocks.pose, blocks.pose_gradient))[free]
    return float(g @ solve_scaled(S, g))


def cross_check(bundle: Bundle, views: Sequence[View], work: WorkPoints) -> CrossCheck:
    """Hold out every view of an adjustment once.

    Args:
        bundle: of all `views`.
        views: at least three; they are dealt to at most `GROUPS` groups.
        work: where errors count.
    """
    groups = min(GROUPS, len(views))
    group = np.arange(len(views)) % groups
    squares, free, lenses = 0.0, 0, []
    for g in range(groups):
        rest = [i for i in range(len(views)) if group[i] != g]
        fit = adjust(
            [views[i] for i in rest],
            bundle.camera,
            [bundle.poses[i] for i in rest],
            bundle.free,
            bundle.prior,
        )
        lenses.append(vector_of(fit.camera))
        known = np.diag((bundle.corner_sigma / bundle.prior.sigma) ** 2)
        known += sum(information(fit, [views[i] for i in rest]))
        for i in map(int, np.flatnonzero(group == g)):
            T = pose_of(views[i], fit.camera)
            residual = residual_of(fit.camera, T, views[i])
            blocks = blocks_of(fit.camera, T, views[i].points, residual)
            squares += float((residual**2).sum()) - _owed_to_lens(blocks, known, bundle.free)
            free += residual.size - 6
    changes = np.stack(lenses) - np.mean(lenses, axis=0)
    scatter = np.stack([work.shifts(change) for change in changes])
    sigmas = np.sqrt((groups - 1) / groups * (scatter**2).sum(axis=0))
    return CrossCheck(float(np.sqrt(squares / max(free, 1))), np.asarray(sigmas))
