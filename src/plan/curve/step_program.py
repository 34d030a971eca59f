"""The quadratic program of one step of the smoothing of a way along a curve.

The variables are changes x of the free coordinates at every station, which move the joints by D x, the clearance that
is missing, and the least distance. With the joint motions d_i from station to station, the program minimises

    sum over i, joints k of  w_ik (d_ik / velocity_k)^2  +  b ((d_ik - d_jk) / velocity_k)^2,  with j = i - 1,

subject to the limits of the coordinates and of the joints, a trust region, and linearised distances of all near pairs.
The weights w are those of iteratively reweighted least squares for a norm of high order over the joints, because the
slowest joint alone decides the time of a step (E. Candès, M. Wakin, S. Boyd, "Enhancing sparsity by reweighted l1
minimization", 2008, for the method). With the clearance as the aim, the least distance is maximised.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module

import numpy as np
from scipy.sparse import coo_array, csc_array, vstack

from arm.numerics.products import mul
from arm.se3 import Array, Bools, Indices
from plan.collision.world import Near

_ORDER = 3  # of the norm over the joints
_BEND = 4.0  # weight of changes of motion from step to step
_SMALL = 1e-5  # curvature of every variable, relative to the largest
_PENALTY = 100.0  # per mm of missing clearance, relative to the largest curvature
# the solver's build for any processor: what it loads by itself depends on the processor, and so would the last digits
_piqp = import_module("piqp.piqp_python")
_MM = 1e-3  # m; clearances of the quadratic program are in mm
_WIDENING = 1e-2  # weight of time against 1 per mm of distance, if distance is the aim


@dataclass(frozen=True, eq=False)
class Rows:
    """k inequalities over the changes at a station and at the next one.

    here[i] . x[station[i]] + there[i] . x[station[i] + 1] <= room[i] + missing[i] (clearance) - least[i] (distance)

    Attributes:
        station: (k,).
        here, there: (k, f) per unit of the coordinates.
        room: (k,) m or rad.
        missing, least: m per mm of these two variables; both the same for all rows.
    """

    station: Indices
    here: Array
    there: Array
    room: Array
    missing: float = 0.0
    least: float = 0.0

    def chosen(self, some: Bools) -> Rows:
        """Return some (k,) of them."""
        parts = self.here[some], self.there[some], self.room[some]
        return Rows(self.station[some], *parts, self.missing, self.least)

    @staticmethod
    def of_distances(near: Near, D: Array, room: Array, missing: bool) -> Rows:
        """Return the rows of pairs that may come nearer by `room` (k,) m.

        Args:
            near: pairs at m stations and at the middles between them.
            D: (m, n, f), derivative of the joints by the coordinates.
            room: (k,) m.
            missing: whether clearance may be missing; else the rows bound the least distance.
        """
        inner = near.row >= len(D)
        station = np.where(inner, near.row - len(D), near.row)
        part = np.where(inner, -0.5, -1.0)[:, None]
        here = part * mul(near.gradient[:, None], D[station])[:, 0]
        there = np.zeros_like(here)
        there[inner] = -0.5 * mul(near.gradient[inner, None], D[station[inner] + 1])[:, 0]
        return Rows(station, here, there, room, *((_MM, 0.0) if missing else (0.0, _MM)))


class StepProgram:
    """The program at one way, for any trust region.

    Args:
        D: (m, n, f), derivative of the joints by the free coordinates at m stations.
        steps: (m - 1, n) s, joint motions from station to station at full velocity.
        velocity: (n,) of the joints.
        rows: inequalities whose room does not depend on the trust region.
        widened: whether the least distance is the aim.
    """

    def __init__(self, D: Array, steps: Array, velocity: Array, rows: list[Rows], widened: bool) -> None:
        self.D, self.widened = D, widened
        m, _, f = D.shape
        P, linear = np.zeros((m, f, m, f)), np.zeros((m, f))
        W = _weights(steps)
        S = D / velocity[:, None]
        for weight, parts in (
            (W, (-1.0, 1.0)),
            (np.full((m - 2, len(velocity)), _BEND * float(W.mean())), (1.0, -2.0, 1.0)),
        ):
            value = steps if len(parts) == 2 else np.diff(steps, axis=0)
            for a, one in enumerate(parts):
                here = np.arange(a, a + len(value))
                of_a = one * S[here] * weight[..., None]
                np.add.at(linear, here, (of_a * value[..., None]).sum(axis=1))
                for b, two in enumerate(parts):
                    there = np.arange(b, b + len(value))
                    P[here, :, there, :] += mul(np.swapaxes(of_a, 1, 2), two * S[there])
        size = m * f + 2
        matrix = np.zeros((size, size))
        matrix[:-2, :-2] = P.reshape(m * f, m * f)
        scale = (_WIDENING if widened else 1.0) / max(float(np.abs(matrix).max()), 1e-12)
        matrix *= scale
        matrix[range(size), range(size)] += _SMALL
        matrix[-2, -2] = matrix[-1, -1] = 1e-2
        self._P = matrix
        self._linear = np.concatenate([scale * linear.ravel(), [_PENALTY, -1.0 if widened else 0.0]])
        self._rows = rows

    def solved(self, low: Array, high: Array, more: Rows) -> Array | None:
        """Return the best change (m, f) of the coordinates between bounds (m, f); None if there is none.

        Rows that no change between the bounds can reach are left out, and so are coordinates that cannot move.

        Args:
            low, high: (m, f); 0 is between them.
            more: rows for these bounds.
        """
        G, room = self._sparse([rows.chosen(_reached(rows, low, high)) for rows in (*self._rows, more)])
        free = np.flatnonzero(np.append(high > low, [True, True]))
        solver = _piqp.SparseSolver()
        bounds = (np.append(low.ravel(), [0.0, -1e3])[free], np.append(high.ravel(), [1e3, 1e3])[free])
        P = csc_array(self._P[np.ix_(free, free)])
        solver.setup(P, self._linear[free], None, None, G[:, free], None, room, *bounds)
        if solver.solve() != _piqp.Status.PIQP_SOLVED:
            return None
        x = np.zeros(len(self._linear))
        x[free] = solver.result.x
        return np.clip(x[:-2].reshape(low.shape), low, high)

    def _sparse(self, every: list[Rows]) -> tuple[csc_array, Array]:
        """Return rows as a matrix (k, m f + 2), and their room (k,)."""
        m, _, f = self.D.shape
        parts = []
        for rows in every:
            k = len(rows.room)
            first = rows.station[:, None] * f + np.arange(f)
            columns = np.hstack(
                [first, np.minimum(first + f, m * f - 1), np.full((k, 2), [m * f, m * f + 1])]
            )
            values = np.hstack([rows.here, rows.there, np.full((k, 2), [-rows.missing, rows.least])])
            line = np.repeat(np.arange(k), 2 * f + 2)
            parts.append(coo_array((values.ravel(), (line, columns.ravel())), shape=(k, m * f + 2)))
        return vstack(parts, format="csc"), np.concatenate([rows.room for rows in every])


def _reached(rows: Rows, low: Array, high: Array) -> Bools:
    """Return which rows (k,) a change between bounds (m, f) can violate."""
    after = np.minimum(rows.station + 1, len(low) - 1)
    ends = np.array([(rows.here * side[rows.station], rows.there * side[after]) for side in (low, high)])
    most = ends.max(axis=0).sum(axis=(0, 2))
    # the least distance cannot exceed what any of its rows leaves at best
    top = (rows.room - ends.min(axis=0).sum(axis=(0, 2))).min(initial=np.inf) if rows.least else 0.0
    return np.asarray(most > rows.room - top)


def _weights(steps: Array) -> Array:
    """Return the weights (m, n) of steps (m, n), s, whose weighted squares stand for a norm of high order."""
    size = np.abs(steps) + 1e-4
    largest = size.max(axis=1, keepdims=True)
    ratio = size / largest
    whole = (ratio**_ORDER).sum(axis=1, keepdims=True) ** (1.0 / _ORDER)
    return np.asarray(ratio ** (_ORDER - 2) / (whole ** (_ORDER - 1) * largest))
