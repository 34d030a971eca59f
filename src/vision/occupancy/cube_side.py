"""Likelihood of the place of one side of a cube's top, from the grey profiles across it.

A profile runs outwards from the top over what the image shows beside it: the cube's own face, the pocket's wall, the
plate. For a given place of the side, the geometry determines where these begin. Their brightness is unknown. The places
of foot and mouth and the blur of the lens are known approximately. All of these are unknowns with a Gaussian prior, and
they are integrated out in closed form (the evidence of a linear model: C. Bishop, Pattern Recognition and Machine
Learning, 2006, section 3.5). So an unknown that the image does not determine makes the likelihood flat, instead of
sharp and wrong. An image of the place without the cube gives the brightness of wall and plate, and the place of the
mouth. Without such an image their priors are wide.

Some unknowns belong to one piece (light across the side). Others are shared by all pieces of a side (brightness of the
wall), so averaging over pieces does not reduce them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp, ndtr

from arm.se3 import Array, Bools, frozen

SPAN = 2.7e-3  # m, length of a profile on both sides of the expected side
STEP = 0.1e-3  # m between its samples
ACROSS: Array = frozen(np.arange(-round(SPAN / STEP), round(SPAN / STEP) + 1) * STEP)
STRAIGHT = 1.2e-3  # m of a wall beside its corner, to which a line is fitted
LEAST_STRAIGHT = 5  # samples
SMOOTH = 3  # samples, see `_slope`
NOWHERE = 4.0 * SPAN  # m: place of a side outside the window
PEAK = float(np.sqrt(2.0 * np.pi))  # the slope of a blurred step is height / (blur PEAK)

# standard deviations of the priors, unless another meaning is given
TOP_GREY, TOP_SLOPE = 25.0, 6.0  # grey levels; grey levels per SPAN
FACE_SHARE = (0.75, 0.3)  # mean and deviation of a face's grey, relative to the top's
FACE_GREY, FACE_OWN, FACE_OWN_SHARE = 8.0, 3.0, 0.03  # grey levels; of a piece; relative to its grey
FACE_SLOPE = 0.3  # per SPAN, relative to the top's grey: plate and pocket shade it
WIDE = 1.0e-3  # m: a narrower face has no such slope
UNEVEN = 15e-6  # m, of a piece from the side's line: residual rotation, chamfers
BLUR_SHARE = 0.05  # relative, of the blur, for a step from black to the plate or the top
FOOT, FOOT_STEP = 0.06e-3, 0.4  # m, of a foot's place; height of its step relative to the plate's grey
PLATE_OWN, PLATE_SLOPE = 0.1, 0.06  # relative, of a piece's light; of its slope per SPAN
WALL_OWN, WALL_SLOPE = 0.06, 0.3
_COSINES = np.cos(np.pi * np.arange(2, 7)[:, None] * (ACROSS / (2.0 * SPAN) + 0.5))
WAVES = [(frozen(wave), frozen(np.gradient(wave, STEP))) for wave in _COSINES]  # light, and its slope
PLATE_WAVES = 2  # light changes slowly on a plate, but within 1 mm on a wall that a cube shades
WALL_SHAPE, PLATE_SHAPE = 0.06, 0.02  # relative to the light, of each wave
WALL_MOVED = 40e-6  # m, of a wall from its place in the image of the empty hole
BACKGROUND = 150e-6  # m, of the plate's image; large, as a border that meets the side is blurred only once
BEYOND_PLATE = 0.12  # relative, of the light beyond a border, in addition to the change of the plate's light

TEXTURE, GREY = 0.007, 0.15  # correlated noise: relative to the grey; in grey levels
TEXTURE_PX, NOISE_PX, HIDDEN_PX = 1.2, 0.55, 3.0  # correlation lengths
WHITE = 0.15  # grey levels, uncorrelated noise of each sample
HIDDEN = 30.0  # grey levels, noise of samples to be ignored


@dataclass(frozen=True)
class _Prior:
    """Priors of what is beside a top.

    Attributes:
        plate: standard deviation of the plate's light.
        wall: mean and standard deviation of the wall's light.
        mouth: standard deviation of the mouth's place, m.
    """

    plate: float
    wall: tuple[float, float]
    mouth: float


# relative to the image without the cube: its shadow, other light
SEEN_EMPTY = _Prior(0.12, (0.75, 0.25), 25e-6)
NEVER_SEEN = _Prior(0.35, (0.5, 0.25), 0.1e-3)  # relative to the plate's grey


@dataclass(frozen=True, eq=False)
class Beside:
    """What the image would show beside the top if the cube were absent.

    Attributes:
        wall, plate: grey levels of the pocket's wall and of the plate, each extended over the profile, (pieces, n).
        mouth: where the wall ends and the plate begins, m outwards; -inf: plate alone; inf: wall alone.
        known: whether it comes from an image without the cube.
        light: present brightness relative to that image.
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
        grey: profile of each piece, (pieces, n).
        white: whitening matrix: inverse of a Cholesky factor of the noise covariance, (n, n).
        feet: possible distances of the cube's foot beyond the side, (feet,) m: evenly from -2 to 2 standard
            deviations, or a single one; 0 if the face is not visible.
        top_grey, plate_grey: median grey levels.
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
    """Return the whitening matrix of a side's profiles: inverse of a Cholesky factor of their covariance, (n, n).

    Args:
        level: median profile, grey levels, (n,): texture, sharpening and dust scale with it.
        hidden: how far to ignore each sample, 0 to 1, (n,).
        noise: standard deviation of a sample's noise, grey levels.
        px_per_m: scale of the image.
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
    """Separate wall and plate in the profiles without a cube.

    Args:
        empty: profiles without the cube, (pieces, n).
        mouth: expected place of the pocket's mouth, m outwards; -inf: there is no pocket.
        corner: where the pocket's floor ends and its wall begins, m outwards.
        blur: standard deviation, m.
        light: see `Beside`.
    """
    if mouth > SPAN - 0.7e-3:
        ends = mouth if mouth > SPAN + 3.0 * blur else np.inf
        return Beside(_from_corner(empty, corner, min(mouth, SPAN), blur), empty, ends, True, light)
    if mouth < -SPAN + 0.7e-3:
        return Beside(empty, empty, -np.inf, True, light)
    near = np.abs(ACROSS - mouth) < 1.2e-3
    x, y = ACROSS[near], empty[:, near].T
    tried = []
    for shift in np.arange(-16, 17) * 0.0125e-3:
        step, along = ndtr((x - mouth - shift) / blur), (x - mouth - shift) / SPAN
        A = np.stack([1.0 - step, along * (1.0 - step), step, along * step], axis=-1)
        lines = np.linalg.solve(A.T @ A + 1e-9 * np.eye(4), A.T @ y)
        tried.append((float(((y - A @ lines) ** 2).sum()), mouth + float(shift), lines))
    _, place, lines = min(tried, key=lambda one: one[0])
    along = (ACROSS - place) / SPAN
    inner, outer = ACROSS - place < -3.0 * blur, ACROSS - place > 3.0 * blur
    wall = np.where(inner, empty, lines[0][:, None] + lines[1][:, None] * along)
    plate = np.where(outer, empty, lines[2][:, None] + lines[3][:, None] * along)
    wall = np.maximum(_from_corner(wall, corner, place, blur), 0.0)
    return Beside(wall, np.maximum(plate, 0.0), place, True, light)


def _from_corner(wall: Array, corner: float, ends: float, blur: float) -> Array:
    """A wall, (pieces, n), extended inwards over the floor, which a cube hides."""
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
    """Assume a uniform plate, and the mouth at its expected place, if there is no image without the cube."""
    grey = np.full((pieces, len(ACROSS)), plate_grey)
    return Beside(grey, grey, mouth, False, 1.0)


def own_evidence(side: Side, at: Beside, places: Array, blur: float) -> Array:
    """Log evidence (k, pieces) of each single piece with the side at `places` (k, pieces) or (k, 1) m outwards."""
    mean, own, shared = _columns(side, at, places, blur, side.foot)
    left = (side.grey - mean) @ side.white.T
    A = side.white @ np.concatenate([own, shared], axis=-1)
    At = np.swapaxes(A, -1, -2)
    M, v = At @ A + np.eye(A.shape[-1]), At @ left[..., None]
    chi2 = (left**2).sum(axis=-1) - (v * np.linalg.solve(M, v)).sum(axis=(-1, -2))
    return np.asarray(-0.5 * (chi2 + np.linalg.slogdet(M)[1]))


def evidence(side: Side, at: Beside, places: Array, blur: float, pieces: Bools) -> tuple[Array, Array]:
    """Log evidence (k,) of some pieces together, and their mean squared normalised residual (k,).

    Only the place of the foot distinguishes a narrow face from a top, and that place is uncertain. So the result is the
    weighted sum of the evidence over the side's feet.

    Args:
        side: the side's profiles.
        at: what the image shows beside it.
        places: place of the side at each piece, (k, pieces) m outwards.
        blur: standard deviation, m.
        pieces: which pieces count, (pieces,).
    """
    each = [_evidence(side, at, places, blur, pieces, float(foot)) for foot in side.feet]
    log = np.stack([one for one, _ in each])
    if len(log) > 1:
        weights = -0.5 * np.linspace(-2.0, 2.0, len(log)) ** 2
        log = log + (weights - np.log(np.exp(weights).sum()))[:, None]
    left = np.take_along_axis(np.stack([one for _, one in each]), log.argmax(axis=0)[None], axis=0)[0]
    return np.asarray(logsumexp(log, axis=0)), left


def _evidence(
    side: Side, at: Beside, places: Array, blur: float, pieces: Bools, foot: float
) -> tuple[Array, Array]:
    """`evidence` with the cube's foot at `foot` m beyond the side."""
    mean, own, shared = _columns(side, at, places, blur, foot)
    left = (side.grey - mean) @ side.white.T
    A = side.white @ own
    X = np.concatenate([side.white @ shared, left[..., None]], axis=-1)
    At = np.swapaxes(A, -1, -2)
    M, R = At @ A + np.eye(A.shape[-1]), At @ X
    G = np.swapaxes(X, -1, -2) @ X - np.swapaxes(R, -1, -2) @ np.linalg.solve(M, R)
    G = G[:, pieces].sum(axis=1)  # of the shared columns, and of the residual
    K, v = G[:, :-1, :-1] + np.eye(G.shape[-1] - 1), G[:, :-1, -1:]
    chi2 = G[:, -1, -1] - (v * np.linalg.solve(K, v)).sum(axis=(-1, -2))
    sizes = np.linalg.slogdet(M)[1][:, pieces].sum(axis=1) + np.linalg.slogdet(K)[1]
    return np.asarray(-0.5 * (chi2 + sizes)), np.asarray(chi2 / (pieces.sum() * len(ACROSS)))


def _columns(side: Side, at: Beside, places: Array, blur: float, foot: float) -> tuple[Array, Array, Array]:
    """Return the linear model with the side at `places` (k, p) or (k, 1) and the foot at `foot` m beyond it.

    Its parts are the mean (k, p, n), the columns of each piece's own unknowns, and those of the shared unknowns,
    (k, p, n, c). Each column is scaled to a standard deviation of 1.
    """
    prior = SEEN_EMPTY if at.known else NEVER_SEEN
    # without an image of wall and plate alone, the waves' slopes at an edge would make its place too certain
    waves = [(wave, slope * at.known) for wave, slope in WAVES]
    x, u = ACROSS, places[..., None]
    z = (x - u) / blur
    ends = np.maximum(np.minimum(u + foot, at.mouth), u) if foot > 0.0 else u
    begin, end, mouth = _beyond(u, blur), _beyond(ends, blur), _beyond(np.maximum(ends, at.mouth), blur)
    top, face, wall, plate = _Part(np.ones(1), np.zeros(1)) - begin, begin - end, end - mouth, mouth
    mean = top.share * side.top_grey
    usual = side.grey.mean(axis=0)
    step = np.abs(np.interp(u + 2.0 * blur, x, usual) - np.interp(u - 2.0 * blur, x, usual))
    bell = np.exp(-0.5 * z**2)
    own = [
        bell * step * (UNEVEN / (blur * PEAK)),
        top.share * TOP_GREY,
        top.lit(x - u, 1.0) * (TOP_SLOPE / SPAN),
    ]
    shared = [bell * z * BLUR_SHARE * max(side.plate_grey, side.top_grey)]
    if foot > 0.0:
        grey = FACE_SHARE[0] * side.top_grey
        mean = mean + face.share * grey
        sloping = face.lit(x - u, 1.0) / SPAN
        own += [face.share * (FACE_OWN + FACE_OWN_SHARE * grey), sloping * TOP_SLOPE]
        at_foot = np.exp(-0.5 * ((x - ends) / blur) ** 2) * (u + foot < at.mouth)
        shared += [
            face.share * (FACE_SHARE[1] * side.top_grey + FACE_GREY),
            sloping * (FACE_SLOPE * side.top_grey * np.clip(foot / WIDE - 1.0, 0.0, 1.0)),
            at_foot * (FOOT / (blur * PEAK) * FOOT_STEP * side.plate_grey),
        ]
    if at.mouth < SPAN + 3.0 * blur:
        lit = plate.lit(at.plate, _slope(at.plate))
        mean = mean + lit * at.light
        own += [lit * PLATE_OWN, plate.lit(x, 1.0) * (PLATE_SLOPE * side.plate_grey / SPAN)]
        shared += [lit * prior.plate]
        shared += [plate.lit(*wave) * (PLATE_SHAPE * side.plate_grey) for wave in waves[:PLATE_WAVES]]
        if at.known:
            shared += [plate.share * np.gradient(at.plate, STEP, axis=1) * (BACKGROUND * at.light)]
            shared += [(lit * at.light - plate.share * side.plate_grey) * BEYOND_PLATE]
    if at.mouth > -SPAN:
        usual = at.wall.mean(axis=1)[:, None]
        lit, (share, deviation) = wall.lit(at.wall, _slope(at.wall)) * at.light, prior.wall
        mean = mean + lit * share
        own += [lit * WALL_OWN]
        shared += [lit * deviation, wall.lit(x - min(at.mouth, SPAN), 1.0) * (WALL_SLOPE * usual / SPAN)]
        shared += [wall.lit(*wave) * (WALL_SHAPE * usual) for wave in waves]
        if at.known:
            shared += [wall.share * np.gradient(at.wall, STEP, axis=1) * (WALL_MOVED * at.light * share)]
        if at.mouth < SPAN:
            middle = int(np.searchsorted(x, at.mouth))
            step = np.abs(at.plate[:, middle] - share * at.wall[:, middle])[:, None] * at.light
            z = (x - at.mouth) / blur
            bump = np.exp(-0.5 * z**2) * (ends < at.mouth) * step
            shared += [bump * (prior.mouth / (blur * PEAK)), bump * z * BLUR_SHARE]
    like = np.broadcast_to(mean, (len(places), *side.grey.shape))
    columns = [np.stack([np.broadcast_to(c, like.shape) for c in group], axis=-1) for group in (own, shared)]
    return like, columns[0], columns[1]


@dataclass(frozen=True, eq=False)
class _Part:
    """A part of a profile between two blurred edges.

    Attributes:
        share: share of each sample's light that comes from this part.
        bend: distance of that light's origin from the sample, towards the part, times `share`, m.
    """

    share: Array
    bend: Array

    def __sub__(self, other: _Part) -> _Part:
        return _Part(self.share - other.share, self.bend - other.bend)

    def lit(self, light: Array, slope: Array | float) -> Array:
        """What the part adds to the profile, from its light and that light's slope per m; exact for a straight line."""
        return np.asarray(self.share * light + self.bend * slope)


def _beyond(edge: Array, blur: float) -> _Part:
    """The part beyond an edge: light at x comes from x + blur t, t normal; E[t | x + blur t > edge] = pdf / cdf."""
    z = (ACROSS - edge) / blur
    return _Part(ndtr(z), np.exp(-0.5 * z**2) * (blur / PEAK))


def _slope(light: Array) -> Array:
    """Slope of light (pieces, n) per m, over `SMOOTH` samples on both sides, which suppresses texture."""
    padded = np.pad(light, ((0, 0), (SMOOTH, SMOOTH)), mode="reflect", reflect_type="odd")
    return np.asarray((padded[:, 2 * SMOOTH :] - padded[:, : -2 * SMOOTH]) / (2 * SMOOTH * STEP))
