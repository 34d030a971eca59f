"""The broadphase of certificates: lower bounds on the distances of all pairs, for many configurations at once.

Balls cover the moving bodies. They are compared with each other, and with rounded boxes around the bodies that stand
still. Where many of those stand, one ball around each body comes first: at each configuration, only what these leave
open is compared ball by ball.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm.numerics.products import mul
from arm.robot.model import LinkBody
from arm.se3 import Array, Bools, Indices
from plan.collision.covers import ROUNDING, cover, rounded_box

# Up to this many bodies that stand still, comparing all of them at once is faster than choosing among them.
_FEW_BODIES = 40


@dataclass(frozen=True)
class OpenPairs:
    """r pairs at some of m configurations that bounds on their distance leave open.

    Attributes:
        row, pair: (r,) indices of configuration and pair, in ascending order.
        bound: (r,) m, less motion and paddings; -inf where nothing is known.
        least: (m,) least bound of the other pairs at each configuration, m; inf if there are none.
    """

    row: Indices
    pair: Indices
    bound: Array
    least: Array


class Separation:
    """Lower bounds on the distance of the pairs of one world.

    Args:
        parts: all bodies; moving ones have a joint above 0.
        poses: of the bodies in the base frame at q = 0, (b, 4, 4).
        pairs: (p, 2) indices into `parts`; the body with the lower joint comes first.
        paddings: (p,) subtracted from the distance of each pair, m.

    Attributes:
        box_pairs: indices of the pairs of a moving body and one that stands still.
        ball_pairs: indices of the others.
    """

    def __init__(self, parts: Sequence[LinkBody], poses: Array, pairs: Indices, paddings: Array) -> None:
        joints = np.array([part.joint for part in parts], dtype=np.intp)
        moving, still = np.flatnonzero(joints > 0), np.flatnonzero(joints == 0)
        covers = [cover(parts[i].shape) for i in moving.tolist()]
        counts = np.array([len(points) for points, _ in covers], dtype=np.intp)
        body = np.repeat(moving, counts)  # of each ball
        local = np.concatenate([points for points, _ in covers]) if covers else np.zeros((0, 3))
        self.centres = (mul(poses[body, :3, :3], local[..., None]))[..., 0] + poses[body, :3, 3]
        self.joint = joints[body]
        size = np.repeat([radius for _, radius in covers], counts)

        boxes = [rounded_box(parts[i].shape) for i in still.tolist()]
        self.turn = poses[still, :3, :3]
        middle = np.array([B[0] for B in boxes]).reshape(-1, 3)
        # in the axes of each box
        self.middle = mul(poses[still, None, :3, 3], self.turn)[:, 0] + middle
        self.half = np.array([B[1] + (B[2], B[2], 0.0) for B in boxes]).reshape(-1, 3)
        # axis after axis of box after box, as columns
        self.columns = np.swapaxes(self.turn, 0, 1).reshape(3, -1, 1)
        self.middles, self.halves = self.middle.reshape(-1, 1), self.half.reshape(-1, 1)
        self.extra = np.array([B[3] for B in boxes])

        # for each pair: the balls of one body against a box, or every ball of one against every ball of the other
        first_ball, ball_count, column, row = (np.zeros(len(parts), dtype=np.intp) for _ in range(4))
        first_ball[moving], ball_count[moving] = np.cumsum(counts) - counts, counts
        column[still], row[moving] = np.arange(len(still)), np.arange(len(moving))
        self.first, self.size = first_ball[moving], size
        is_box = joints[pairs[:, 0]] == 0
        self.box_pairs, self.ball_pairs = np.flatnonzero(is_box), np.flatnonzero(~is_box)
        inner, outer = pairs[self.box_pairs].T
        self.boxes = row[outer], column[inner]
        inner, outer = pairs[self.ball_pairs].T
        each = ball_count[inner] * ball_count[outer]
        self.first_ball = np.cumsum(each) - each
        of = np.repeat(np.arange(len(inner)), each)
        a, b = np.divmod(np.arange(len(of)) - self.first_ball[of], ball_count[inner][of])
        self.ball_rows = np.stack([first_ball[outer][of] + a, first_ball[inner][of] + b])
        self.ball_gap = size[self.ball_rows[0]] + size[self.ball_rows[1]]

        shape = len(moving), len(still)
        self.checked: Bools = np.zeros(shape, dtype=bool)
        self.pair_of, self.padding = np.zeros(shape, dtype=np.intp), np.zeros(shape)
        self.checked[self.boxes], self.pair_of[self.boxes] = True, self.box_pairs
        self.padding[self.boxes] = paddings[self.box_pairs]
        self.ball_padding, self.box_padding = paddings[self.ball_pairs], paddings[self.box_pairs]
        if len(still) > _FEW_BODIES:
            self._cover_joints(joints[moving], size, poses[still], middle)

    def _cover_joints(self, joints: Indices, size: Array, T_base_still: Array, middle: Array) -> None:
        """Put one ball around all bodies on a joint, and one around each body that stands still.

        Args:
            joints: of the moving bodies.
            size: radius of each ball, m.
            T_base_still, middle: poses of the bodies that stand still, and the middles of their boxes.
        """
        self.joints = np.unique(self.joint)
        self.by_joint = np.argsort(joints, kind="stable")
        self.first_of_joint = np.searchsorted(joints[self.by_joint], self.joints)
        of_joint = [self.joint == k for k in self.joints.tolist()]
        middles = [(self.centres[on].min(axis=0) + self.centres[on].max(axis=0)) / 2.0 for on in of_joint]
        self.joint_middle = np.array(middles).reshape(-1, 3)
        sizes = [
            float((np.linalg.norm(self.centres[on] - centre, axis=1) + size[on]).max())
            for on, centre in zip(of_joint, middles, strict=True)
        ]
        self.still_middle = mul(T_base_still[:, :3, :3], middle[..., None])[..., 0] + T_base_still[:, :3, 3]
        still_size = np.linalg.norm(self.half, axis=1) + self.extra
        self.joint_reach = np.array(sizes)[:, None] + (
            still_size + self.padding.max(axis=0, initial=0.0) + 2.0 * ROUNDING
        )

    def distances(self, R: Array, t: Array) -> Array:
        """Return lower bounds (m, p) m at m configurations; -inf where balls and boxes overlap.

        Args:
            R, t: product of exponentials up to each joint, (m, n + 1, 3, 3) and (m, n + 1, 3) m.
        """
        centres = self._centres(R, t)
        return self._all(self._from_all_boxes(centres), self._from_balls(centres))

    def _all(self, boxes: Array, balls: Array) -> Array:
        """Return (m, p) of all pairs, from those of the `box_pairs` (m, i) and of the `ball_pairs` (m, j)."""
        out = np.empty((len(boxes), len(self.box_pairs) + len(self.ball_pairs)))
        out[:, self.box_pairs], out[:, self.ball_pairs] = boxes, balls
        return out

    def open_pairs(
        self, R: Array, t: Array, enough: float, box_motion: Array, ball_motion: Array
    ) -> OpenPairs:
        """Return the pairs whose bound, less motion and paddings, is below `enough` m.

        Args:
            R, t: see `distances`.
            box_motion: (m, moving) m, motion of each moving body relative to what stands still.
            ball_motion: (m, k) m, relative motion of the `ball_pairs`.
        """
        centres = self._centres(R, t)
        balls = self._from_balls(centres) - (ball_motion + self.ball_padding)
        if self.padding.shape[1] <= _FEW_BODIES:
            boxes = self._from_all_boxes(centres) - (box_motion[:, self.boxes[0]] + self.box_padding)
            bounds = self._all(boxes, balls)
            is_open = bounds < enough
            least = np.where(is_open, np.inf, bounds).min(axis=1, initial=np.inf)
            row, pair = np.nonzero(is_open)
            return OpenPairs(row, pair, bounds[is_open], least)
        row, still, boxes = self._chosen(R, t, centres, box_motion, enough)
        box_open, ball_open = boxes < enough, balls < enough
        least = np.where(ball_open, np.inf, balls).min(axis=1, initial=np.inf)
        np.minimum.at(least, row, np.where(box_open, np.inf, boxes).min(axis=1, initial=np.inf))
        place, body = np.nonzero(box_open)
        ball_row, ball_pair = np.nonzero(ball_open)
        rows = np.concatenate([row[place], ball_row])
        pairs = np.concatenate([self.pair_of[body, still[place]], self.ball_pairs[ball_pair]])
        bound = np.concatenate([boxes[box_open], balls[ball_open]])
        order = np.lexsort((pairs, rows))
        return OpenPairs(rows[order], pairs[order], bound[order], least)

    def _centres(self, R: Array, t: Array) -> Array:
        return np.asarray((mul(R[:, self.joint], self.centres[..., None]))[..., 0] + t[:, self.joint])

    def _chosen(
        self, R: Array, t: Array, centres: Array, motion: Array, enough: float
    ) -> tuple[Indices, Indices, Array]:
        """Return configurations (k,), bodies that stand still (k,), and `_box_bounds` (k, moving) where needed.

        They are needed where one ball around all bodies on a joint does not show that they are at least `enough`; and
        for the least bound of each configuration that is.
        """
        middle = mul(R[:, self.joints], self.joint_middle[..., None])[..., 0] + t[:, self.joints]
        apart = np.zeros((len(R), *self.joint_reach.shape))
        for i in range(3):
            between = middle[:, :, i, None] - self.still_middle[:, i]
            between *= between
            apart += between
        np.sqrt(apart, out=apart)
        apart -= self.joint_reach
        apart -= np.maximum.reduceat(motion[:, self.by_joint], self.first_of_joint, axis=1)[:, :, None]
        rough = apart.min(axis=1)  # inf once a body that stands still was compared ball by ball
        least = np.full(len(R), np.inf)  # of those that were
        parts = []
        while True:
            most = np.where(least < np.inf, least, rough.min(axis=1))
            # balls that overlap show nothing, whatever is enough
            needed = (rough <= np.maximum(most, max(enough, 0.0))[:, None]) & (rough < np.inf)
            row, still = np.nonzero(needed)
            if not len(row):
                break
            found = self._box_bounds(centres, motion, row, still)
            parts.append((row, still, found))
            rough[needed] = np.inf
            np.minimum.at(least, row, np.where(found < enough, np.inf, found).min(axis=1))
        rows, stills, bounds = zip(*parts, strict=True)
        return np.concatenate(rows), np.concatenate(stills), np.concatenate(bounds)

    def _box_bounds(self, centres: Array, motion: Array, row: Indices, still: Indices) -> Array:
        """Return bounds (k, moving) m less motion and paddings, inf for what is no pair."""
        bounds = self._from_boxes(centres[row], still) - (motion[row] + self.padding.T[still])
        return np.where(self.checked.T[still], bounds, np.inf)

    def _from_balls(self, centres: Array) -> Array:
        """Return bounds (m, k) m of the `ball_pairs`."""
        if not len(self.ball_pairs):
            return np.zeros((len(centres), 0))
        between = centres[:, self.ball_rows[0]] - centres[:, self.ball_rows[1]]
        apart = np.sqrt(np.einsum("mbi,mbi->mb", between, between)) - self.ball_gap
        return _bounds(np.minimum.reduceat(apart, self.first_ball, axis=1))

    def _from_boxes(self, centres: Array, still: Indices) -> Array:
        """Return bounds (k, moving) m; balls about (k, balls, 3) against k boxes."""
        away = _from_box(centres, self.turn[still, None], self.middle[still, None], self.half[still, None])
        away -= self.size
        return _bounds(np.minimum.reduceat(away, self.first, axis=1) - self.extra[still, None])

    def _from_all_boxes(self, centres: Array) -> Array:
        """Return bounds (m, i) m of the `box_pairs`.

        Long rows for few bodies: a row for each axis of each box, with all balls of all configurations.
        """
        points = centres.reshape(-1, 3).T
        away = self.columns[0] * points[0]
        away += self.columns[1] * points[1]
        away += self.columns[2] * points[2]
        away -= self.middles
        np.abs(away, out=away)
        away -= self.halves
        np.maximum(away, 0.0, out=away)
        away *= away
        square = away[0::3]
        square += away[1::3]
        square += away[2::3]
        away = np.sqrt(square).reshape(len(self.half), *centres.shape[:2])
        away -= self.size
        nearest = np.minimum.reduceat(away, self.first, axis=2)[self.boxes[1], :, self.boxes[0]]
        return _bounds(nearest.T - self.extra[self.boxes[1]])


def _bounds(distances: Array) -> Array:
    """Return distances of balls and boxes as bounds: less their rounding, and -inf where they overlap."""
    distances -= ROUNDING
    distances[distances <= 0.0] = -np.inf
    return distances


def _from_box(points: Array, turn: Array, middle: Array, half: Array) -> Array:
    """Return distances (...) of points (..., 3) from boxes with axes `turn` (..., 3, 3); `middle` is in these axes."""
    square: Array | float = 0.0
    for i in range(3):
        along = points[..., 0] * turn[..., 0, i]
        along += points[..., 1] * turn[..., 1, i]
        along += points[..., 2] * turn[..., 2, i]
        along -= middle[..., i]
        np.abs(along, out=along)
        along -= half[..., i]
        np.maximum(along, 0.0, out=along)
        along *= along
        square = square + along
    return np.sqrt(square)
