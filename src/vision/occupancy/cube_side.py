"""How likely a side of a cube's top lies here or there, by the grey across it.

A profile runs from the top outwards, over whatever is seen beside it: the cube's own face, the pocket's wall, the
plate. Where these begin is known from the geometry once the side's place is given; how bright they are is not, and
neither exactly where a foot or a mouth lies nor how much the lens blurs. All of these are unknowns with a Gaussian
prior, so that they integrate out in closed form (the evidence of a linear model: C. Bishop, Pattern Recognition and
Machine Learning, 2006, section 3.5), and what the picture cannot tell makes the likelihood flat instead of sharp and
wrong. A photograph of the same place when it was empty tells the wall's and the plate's brightness, and where the
mouth is; without one their priors are wide.

Some unknowns are each piece's own (light across the side), others all pieces of a side share (a wall's brightness):
what is shared is not averaged away.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr

from arm.se3 import Array, frozen

SPAN = 2.7e-3  # m, of a profile on both sides of where the side should be
STEP = 0.1e-3  # m, between its samples
ACROSS: Array = frozen(np.arange(-round(SPAN / STEP), round(SPAN / STEP) + 1) * STEP)
STRAIGHT = 1.2e-3  # m, of a wall beside its corner, that tells how it goes on
LEAST_STRAIGHT = 5  # samples
NOWHERE = 4.0 * SPAN  # m: a side that is not in the window
PEAK = float(np.sqrt(2.0 * np.pi))  # a step's slope is its height / (blur PEAK)

# priors, standard deviations unless said otherwise
TOP_GREY, TOP_SLOPE = 25.0, 6.0  # grey levels, and those over a span
FACE_SHARE = (0.75, 0.3)  # mean and deviation of a face's grey, of the top's
FACE_GREY, FACE_OWN, FACE_OWN_SHARE = 8.0, 3.0, 0.03  # grey levels; of a piece; and of its grey
FACE_SLOPE = 0.3  # of the top's grey, over a span: the plate and the pocket keep light from it
WIDE = 1.0e-3  # m, of a face that shows a slope at all
UNEVEN = 15e-6  # m, of a side's place at a piece from its line: what is left of the turn, chamfers
BLUR_SHARE = 0.05  # of the blur, by what it makes of a whole step
FOOT, FOOT_STEP = 0.06e-3, 0.4  # m, of a foot's place; height of its step, of the plate's grey
PLATE_OWN, PLATE_SLOPE = 0.1, 0.06  # share of a piece's light; and over a span
WALL_OWN, WALL_SLOPE = 0.06, 0.3
WAVES: Array = frozen(np.cos(np.pi * np.arange(2, 7)[:, None] * (ACROSS / (2.0 * SPAN) + 0.5)))
PLATE_WAVES = (
    2  # of these: light changes slowly on a plate, and within 1 mm on a wall that a cube keeps light from
)
WALL_SHAPE, PLATE_SHAPE = 0.06, 0.02  # share of the light, each wave
WALL_MOVED = 40e-6  # m, of a wall from where the empty place showed it
BACKGROUND = (
    150e-6  # m, of what lies beyond it; much, for a border that meets the side's is blurred with it, once
)
BEYOND_PLATE = 0.12  # share, by which the light beyond a border may have changed otherwise than the plate's

TEXTURE, GREY = 0.007, 0.15  # noise that neighbours share: of the grey, and grey levels
TEXTURE_PX, NOISE_PX, HIDDEN_PX = 1.2, 0.55, 3.0  # how far it reaches
WHITE = 0.15  # grey levels, of each sample
HIDDEN = 30.0  # grey levels, of what is not to be believed


@dataclass(frozen=True)
class _Prior:
    """What is known of a plate's light (deviation), a wall's (mean, deviation), and a mouth's place (deviation, m)."""

    plate: float
    wall: tuple[float, float]
    mouth: float


SEEN_EMPTY = _Prior(0.12, (0.75, 0.25), 25e-6)  # of what it was then: a cube's shadow, another light
NEVER_SEEN = _Prior(0.35, (0.5, 0.25), 0.1e-3)  # of the plate's grey


@dataclass(frozen=True, eq=False)
class Beside:
    """What is seen beside the top, as if the cube were not there.

    Attributes:
        wall, plate: grey levels of the pocket's wall and of the plate, each as if it went on, (pieces, n).
        mouth: where the wall ends and the plate begins, m out; -inf: plate alone; inf: wall alone.
        known: by a photograph of the empty place.
        light: how bright the place is now, of what it was then.
    """

    wall: Array
    plate: Array
    mouth: float
    known: bool
    light: float


@dataclass(frozen=True, eq=False)
class Side:
    """The profiles across one side of a top.

    Attributes:
        grey: across its pieces, (pieces, n).
        white: inverse of a Cholesky factor of their noise, (n, n): makes it white.
        feet: how far beyond the side the cube's foot may be seen, m, from -2 to 2 deviations in even steps, or one
            alone; 0: its face is not seen. (feet,)
        top_grey, plate_grey: usual grey levels.
    """

    grey: Array
    white: Array
    feet: Array
    top_grey: float
    plate_grey: float

    @property
    def foot(self) -> float:
        """The likeliest of `feet`, m."""
        return float(self.feet[len(self.feet) // 2])


def whitening(level: Array, hidden: Array, noise: float, px_per_m: float) -> Array:
    """The whitening of a side's profiles: inverse of a Cholesky factor of their covariance, (n, n).

    Args:
        level: usual grey levels across it, (n,): texture, sharpening and dust scale with them.
        hidden: 0 to 1, (n,): how little a sample is to be believed.
        noise: standard deviation of a sample's noise, grey levels.
        px_per_m: scale.
    """
    apart = np.abs(ACROSS[:, None] - ACROSS[None]) * px_per_m
    texture = TEXTURE * level + GREY
    covariance = (
        noise**2 * np.exp(-0.5 * (apart / NOISE_PX) ** 2)
        + np.outer(texture, texture) * np.exp(-apart / TEXTURE_PX)
        + HIDDEN**2 * np.outer(hidden, hidden) * np.exp(-apart / HIDDEN_PX)
        + WHITE**2 * np.eye(len(ACROSS))
    )
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))


def beside(empty: Array, mouth: float, corner: float, blur: float, light: float) -> Beside:
    """What an empty place shows across a side.

    Args:
        empty: profiles of the empty place, (pieces, n).
        mouth: where its pocket's mouth should be seen, m out; -inf: there is no pocket.
        corner: where the pocket's floor ends and its wall begins, m out.
        blur: m.
        light: see `Beside`.
    """
    if mouth > SPAN - 0.7e-3:
        ends = mouth if mouth > SPAN + 3.0 * blur else np.inf
        return Beside(_from_corner(empty, corner, min(mouth, SPAN), blur), empty, ends, True, light)
    if mouth < -SPAN + 0.7e-3:
        return Beside(empty, empty, -np.inf, True, light)
    near = np.abs(ACROSS - mouth) < 1.2e-3
    x, y = ACROSS[near], empty[:, near].T
    best: tuple[float, float, Array] | None = None
    for shift in np.arange(-16, 17) * 0.0125e-3:
        step, along = ndtr((x - mouth - shift) / blur), (x - mouth - shift) / SPAN
        A = np.stack([1.0 - step, along * (1.0 - step), step, along * step], axis=-1)
        lines = np.linalg.solve(A.T @ A + 1e-9 * np.eye(4), A.T @ y)
        left = float(((y - A @ lines) ** 2).sum())
        if best is None or left < best[0]:
            best = left, mouth + float(shift), lines
    _, place, lines = best if best is not None else (0.0, mouth, np.zeros((4, len(empty))))
    along = (ACROSS - place) / SPAN
    inner, outer = ACROSS - place < -3.0 * blur, ACROSS - place > 3.0 * blur
    wall = np.where(inner, empty, lines[0][:, None] + lines[1][:, None] * along)
    plate = np.where(outer, empty, lines[2][:, None] + lines[3][:, None] * along)
    wall = np.maximum(_from_corner(wall, corner, place, blur), 0.0)
    return Beside(wall, np.maximum(plate, 0.0), place, True, light)


def _from_corner(wall: Array, corner: float, ends: float, blur: float) -> Array:
    """A wall, (pieces, n), as if it began before its corner: a cube hides the floor that is seen there without it."""
    begins = corner + 3.0 * blur
    straight = (begins < ACROSS) & (min(begins + STRAIGHT, ends - 3.0 * blur) > ACROSS)
    if straight.sum() < LEAST_STRAIGHT:
        return wall
    x = ACROSS[straight]
    A = np.stack([np.ones_like(x), (x - begins) / SPAN], axis=-1)
    line = np.linalg.solve(A.T @ A, A.T @ wall[:, straight].T)
    along = line[0][:, None] + line[1][:, None] * (ACROSS - begins) / SPAN
    return np.where(begins > ACROSS, along, wall)


def beside_unseen(plate_grey: float, pieces: int, mouth: float) -> Beside:
    """The same of a place that was never seen empty: a plate of that grey, and a mouth where it should be."""
    grey = np.full((pieces, len(ACROSS)), plate_grey)
    return Beside(grey, grey, mouth, False, 1.0)


def own_evidence(side: Side, at: Beside, places: Array, blur: float) -> Array:
    """Log evidence of each piece by itself with the side at `places` (k, pieces) m out, (k, pieces)."""
    mean, own, shared = _columns(side, at, places, blur, side.foot)
    left = (side.grey - mean) @ side.white.T
    A = side.white @ np.concatenate([own, shared], axis=-1)
    At = np.swapaxes(A, -1, -2)
    M, v = At @ A + np.eye(A.shape[-1]), At @ left[..., None]
    chi2 = (left**2).sum(axis=-1) - (v * np.linalg.solve(M, v)).sum(axis=(-1, -2))
    return np.asarray(-0.5 * (chi2 + np.linalg.slogdet(M)[1]))


def evidence(
    side: Side, at: Beside, places: Array, blur: float, pieces: npt.NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Log evidence of some pieces together, (k,), and what is left of each sample, in squared deviations, (k,).

    Where the cube's foot is seen is known to a deviation only, and a narrow face is told from a top by it alone: each
    of the side's feet has its own evidence, and their weighted sum counts.

    Args:
        side: with its profiles.
        at: what is beside it.
        places: of the side at each piece, (k, pieces) m out.
        blur: m.
        pieces: that count, (pieces,).
    """
    each = [_evidence(side, at, places, blur, pieces, float(foot)) for foot in side.feet]
    log = np.stack([one for one, _ in each])
    if len(log) > 1:
        weights = -0.5 * np.linspace(-2.0, 2.0, len(log)) ** 2
        log = log + (weights - np.log(np.exp(weights).sum()))[:, None]
    most = log.max(axis=0)
    left = np.take_along_axis(np.stack([one for _, one in each]), log.argmax(axis=0)[None], axis=0)[0]
    return np.asarray(most + np.log(np.exp(log - most).sum(axis=0))), left


def _evidence(
    side: Side, at: Beside, places: Array, blur: float, pieces: npt.NDArray[np.bool_], foot: float
) -> tuple[Array, Array]:
    """The same with the cube's foot so many m beyond the side."""
    mean, own, shared = _columns(side, at, places, blur, foot)
    left = (side.grey - mean) @ side.white.T
    A = side.white @ own
    X = np.concatenate([side.white @ shared, left[..., None]], axis=-1)
    At = np.swapaxes(A, -1, -2)
    M, R = At @ A + np.eye(A.shape[-1]), At @ X
    G = np.swapaxes(X, -1, -2) @ X - np.swapaxes(R, -1, -2) @ np.linalg.solve(M, R)
    G = G[:, pieces].sum(axis=1)  # of what all pieces share, and of what is left
    K, v = G[:, :-1, :-1] + np.eye(G.shape[-1] - 1), G[:, :-1, -1:]
    chi2 = G[:, -1, -1] - (v * np.linalg.solve(K, v)).sum(axis=(-1, -2))
    sizes = np.linalg.slogdet(M)[1][:, pieces].sum(axis=1) + np.linalg.slogdet(K)[1]
    return np.asarray(-0.5 * (chi2 + sizes)), np.asarray(chi2 / (pieces.sum() * len(ACROSS)))


def _columns(side: Side, at: Beside, places: Array, blur: float, foot: float) -> tuple[Array, Array, Array]:
    """The linear model with the side at `places` (k, p) and a foot so many m beyond it.

    Returns its mean (k, p, n), and the columns of what is a piece's own and of what is shared, (k, p, n, c), each
    scaled to a deviation of 1.
    """
    prior = SEEN_EMPTY if at.known else NEVER_SEEN
    x, u = ACROSS, places[..., None]
    z = (x - u) / blur
    beyond = ndtr(z)
    face_ends = np.maximum(np.minimum(u + foot, at.mouth), u) if foot > 0.0 else u
    open_ = ndtr((x - face_ends) / blur)
    mean = (1.0 - beyond) * side.top_grey
    usual = side.grey.mean(axis=0)
    step = np.abs(np.interp(u + 2.0 * blur, x, usual) - np.interp(u - 2.0 * blur, x, usual))
    uneven = np.exp(-0.5 * z**2) * step * (UNEVEN / (blur * PEAK))
    own = [uneven, (1.0 - beyond) * TOP_GREY, (1.0 - beyond) * z * (blur / SPAN) * TOP_SLOPE]
    shared = [z * np.exp(-0.5 * z**2) * BLUR_SHARE * max(side.plate_grey, side.top_grey)]
    if foot > 0.0:
        face, grey = beyond - open_, FACE_SHARE[0] * side.top_grey
        mean = mean + face * grey
        own += [face * (FACE_OWN + FACE_OWN_SHARE * grey), face * z * (blur / SPAN) * TOP_SLOPE]
        at_foot = np.exp(-0.5 * ((x - face_ends) / blur) ** 2) * (u + foot < at.mouth)
        shared += [
            face * (FACE_SHARE[1] * side.top_grey + FACE_GREY),
            face * z * (blur / SPAN) * (FACE_SLOPE * side.top_grey * np.clip(foot / WIDE - 1.0, 0.0, 1.0)),
            at_foot * (FOOT / (blur * PEAK) * FOOT_STEP * side.plate_grey),
        ]
    plate = ndtr((x - np.maximum(face_ends, at.mouth)) / blur)
    if at.mouth < SPAN + 3.0 * blur:
        lit = plate * at.plate
        mean = mean + lit * at.light
        own += [lit * PLATE_OWN, plate * (x / SPAN) * (PLATE_SLOPE * side.plate_grey)]
        shared += [lit * prior.plate]
        shared += [plate * wave * (PLATE_SHAPE * side.plate_grey) for wave in WAVES[:PLATE_WAVES]]
        if at.known:
            shared += [plate * np.gradient(at.plate, STEP, axis=1) * (BACKGROUND * at.light)]
            shared += [plate * (at.plate * at.light - side.plate_grey) * BEYOND_PLATE]
    if at.mouth > -SPAN:
        wall, usual = open_ - plate, at.wall.mean(axis=1)[:, None]
        lit, (share, deviation) = wall * at.wall * at.light, prior.wall
        mean = mean + lit * share
        own += [lit * WALL_OWN]
        shared += [lit * deviation, wall * ((x - min(at.mouth, SPAN)) / SPAN) * (WALL_SLOPE * usual)]
        shared += [wall * wave * (WALL_SHAPE * usual) for wave in WAVES]
        if at.known:
            shared += [wall * np.gradient(at.wall, STEP, axis=1) * (WALL_MOVED * at.light * share)]
        if at.mouth < SPAN:
            middle = int(np.searchsorted(x, at.mouth))
            step = np.abs(at.plate[:, middle] - share * at.wall[:, middle])[:, None] * at.light
            z = (x - at.mouth) / blur
            bump = np.exp(-0.5 * z**2) * (face_ends < at.mouth) * step
            shared += [bump * (prior.mouth / (blur * PEAK)), bump * z * BLUR_SHARE]
    like = np.broadcast_to(mean, (*places.shape, len(x)))
    columns = [np.stack([np.broadcast_to(c, like.shape) for c in group], axis=-1) for group in (own, shared)]
    return like, columns[0], columns[1]
