"""Cross-validation: groups of views are held out in turn.

The intrinsics are fitted without a group, and the corners of that group validate them (with free poses). The scatter of
the fits at the work points is an error estimate without any noise model (delete-a-group jackknife; B. Efron, 1982). If
it is much larger than the error predicted from the residuals, the residuals are not independent, and the prediction is
too optimistic.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm.se3 import Array
from calib.camera.bundle_adjustment import Bundle, View, adjust, information, residual_of, view_equations
from calib.camera.initial_guess import pose_of
from calib.camera.working_volume import WorkingVolume
from calib.model.intrinsics import vector_of
from calib.model.least_squares import solve_scaled

GROUPS = 5


@dataclass(frozen=True, eq=False)
class CrossValidation:
    """Result of cross-validation.

    Attributes:
        sigma_px: error of held-out corner coordinates, px. It excludes the degrees of freedom of each view's pose, and
            what the uncertainty of the fitted intrinsics explains. Otherwise a correct view at an image edge would look
            wrong if no other view reaches that edge.
        work_sigmas: (n,) m jackknife standard deviation of each work point.
    """

    sigma_px: float
    work_sigmas: Array


def cross_validate(bundle: Bundle, views: Sequence[View], work: WorkingVolume) -> CrossValidation:
    """Hold out every view of an adjustment once.

    Args:
        bundle: of all `views`.
        views: at least three; split into at most `GROUPS` groups.
        work: where errors count.
    """
    groups = min(GROUPS, len(views))
    group = np.arange(len(views)) % groups
    squares, freedom, intrinsics = 0.0, 0, []
    prior = np.diag((bundle.corner_sigma / bundle.prior.sigma) ** 2)
    for g in range(groups):
        held = group == g
        rest = [view for view, out in zip(views, held, strict=True) if not out]
        poses = [T for T, out in zip(bundle.poses, held, strict=True) if not out]
        fit = adjust(rest, bundle.camera, poses, bundle.free, bundle.prior)
        intrinsics.append(vector_of(fit.camera))
        known = np.asarray(sum(information(fit, rest), prior))
        for i in map(int, np.flatnonzero(held)):
            T = pose_of(views[i], fit.camera)
            residual = residual_of(fit.camera, T, views[i])
            own = view_equations(fit.camera, T, views[i].points, residual)
            of_free, score = (known + own.S)[np.ix_(bundle.free, bundle.free)], own.g[bundle.free]
            explained = float(score @ solve_scaled(of_free, score))  # by the uncertainty of the intrinsics
            squares += float((residual**2).sum()) - explained
            freedom += residual.size - 6
    changes = np.stack(intrinsics) - np.mean(intrinsics, axis=0)
    scatter = np.stack([work.shifts(change) for change in changes])
    sigmas = np.sqrt((groups - 1) / groups * (scatter**2).sum(axis=0))
    return CrossValidation(float(np.sqrt(squares / max(freedom, 1))), np.asarray(sigmas))
