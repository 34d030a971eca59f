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
from calib.bundle import Bundle, View, adjust, residual_of
from calib.camera_start import pose_of
from calib.intrinsics import vector_of
from calib.work_points import WorkPoints

GROUPS = 5


@dataclass(frozen=True, eq=False)
class CrossCheck:
    """What held-out views say.

    Attributes:
        sigma_px: error of their corners' coordinates, px, the poses' six numbers a view allowed for.
        work_sigmas: (n,) m jackknife standard deviation of each work point.
    """

    sigma_px: float
    work_sigmas: Array


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
        for i in map(int, np.flatnonzero(group == g)):
            residual = residual_of(fit.camera, pose_of(views[i], fit.camera), views[i])
            squares += float((residual**2).sum())
            free += residual.size - 6
    changes = np.stack(lenses) - np.mean(lenses, axis=0)
    scatter = np.stack([work.shifts(change) for change in changes])
    sigmas = np.sqrt((groups - 1) / groups * (scatter**2).sum(axis=0))
    return CrossCheck(float(np.sqrt(squares / max(free, 1))), np.asarray(sigmas))
