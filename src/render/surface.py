"""What real surfaces have and drawn ones lack: print that is not quite as designed, and a table with a texture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from arm.se3 import Array, Bools, inverse
from render.light import KIND_GREY, MARKER_BLACK, MARKER_WHITE
from render.rays import Floats, PixelRays, bundle_in
from render.solids import Cast, Solid

WARP_LENGTH = 0.025  # m over which a warped print changes
WARP_WAVES = 6
TOP_FACE = 2  # region of a box's upper side, see `render.solids.cast_box`
PITCH = 0.25e-3  # m, of the texture's map: a pixel of the lab's camera
TILE = 0.600  # m, after which the texture repeats; longer than the camera's view
STAIN_LENGTH = 0.030  # m over which the tone of the table changes


@dataclass(frozen=True)
class Print:
    """How a pattern was printed and glued; the default is as designed.

    Attributes:
        black, white: grey levels of ink and paper that face the lamp.
        spread: distance by which ink spreads beyond each edge, m. (Our marker detection measures and corrects it.)
        border: distance by which the outer border of a marker lies further outwards than its code says, m.
        scale: printed size over designed size.
        shift: x, y of its centre relative to where it belongs, m.
        turn: rotation about its centre, rad.
        warp: standard deviation of a smooth displacement of its points, along x and along y, m.
        seed: of the warp.
    """

    black: float = MARKER_BLACK
    white: float = MARKER_WHITE
    spread: float = 0.0
    border: float = 0.0
    scale: float = 1.0
    shift: tuple[float, float] = (0.0, 0.0)
    turn: float = 0.0
    warp: float = 0.0
    seed: tuple[int, ...] = (0,)

    @property
    def margin(self) -> float:
        """Largest distance by which it can reach beyond its place, m, for prints of up to 0.1 m."""
        far = 0.1 * (abs(self.scale - 1.0) + abs(self.turn))
        return far + max(abs(s) for s in self.shift) + WARP_WAVES * self.warp

    def designed(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Map points (x, y) m from the centre of where it belongs to the same points of the design."""
        if self.warp:
            dx, dy = _warped(self.seed, x, y)
            x, y = x - np.float32(self.warp) * dx, y - np.float32(self.warp) * dy
        if self.turn or self.scale != 1.0 or any(self.shift):
            x, y = x - np.float32(self.shift[0]), y - np.float32(self.shift[1])
            c, s = np.float32(np.cos(self.turn) / self.scale), np.float32(np.sin(self.turn) / self.scale)
            x, y = c * x + s * y, c * y - s * x
        return x, y

    def white_at(self, pattern: Callable[[Floats, Floats], Bools], x: Floats, y: Floats) -> Bools:
        """Whether paper shows at points of the design, where `pattern` tells what was to stay white."""
        white = pattern(x, y)
        for i, j in ((-1, -1), (-1, 1), (1, -1), (1, 1)) if self.spread else ():
            white = white & pattern(x + np.float32(i * self.spread), y + np.float32(j * self.spread))
        return white


def _warped(seed: tuple[int, ...], x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """A smooth random field of unit variance at points, its two components: waves of random direction and phase."""
    rng = np.random.default_rng(seed)
    waves = rng.normal(0.0, 1.0 / WARP_LENGTH, (2, WARP_WAVES, 2)).astype(np.float32)
    phases = rng.uniform(0.0, 2.0 * np.pi, (2, WARP_WAVES)).astype(np.float32)
    fields = [np.zeros(x.shape, dtype=np.float32) for _ in range(2)]
    for field, vectors, offsets in zip(fields, waves, phases, strict=True):
        for (kx, ky), phase in zip(vectors, offsets, strict=True):
            field += np.cos(kx * x + (ky * y + phase))
        field *= np.float32(np.sqrt(2.0 / WARP_WAVES))
    return fields[0], fields[1]


@dataclass(frozen=True)
class Texture:
    """How a table looks that is in use; the default is one even grey.

    Attributes:
        grain: standard deviation of its fine grain, grey levels of a fully lit table.
        stain: the same of slow changes of its tone.
        specks: dark crumbs and chips, per m^2.
        scratches: per m^2.
        seed: of all of them.
    """

    grain: float = 0.0
    stain: float = 0.0
    specks: float = 0.0
    scratches: float = 0.0
    seed: int = 0

    @property
    def plain(self) -> bool:
        """Whether there is none."""
        return not (self.grain or self.stain or self.specks or self.scratches)


class TexturedSolid:
    """A solid whose upper side has a texture that is fixed to it."""

    def __init__(self, solid: Solid, texture: Texture) -> None:
        self.T_base_solid, self.half_extent = solid.T_base_solid, solid.half_extent
        self._solid = solid
        self._factors = texture_map(texture)

    def cast(self, T_base_camera: Array, rays: PixelRays) -> Cast:
        """Cast the rays of a camera at it."""
        cast = self._solid.cast(T_base_camera, rays)
        top = (cast.region == TOP_FACE) & np.isfinite(cast.depth)
        bundle = bundle_in(inverse(self.T_base_solid) @ T_base_camera, rays)
        depth = np.where(top, cast.depth, np.float32(0.0))
        columns = (np.float32(bundle.origin[0]) + depth * bundle.dx) / np.float32(PITCH)
        rows = (np.float32(bundle.origin[1]) + depth * bundle.dy) / np.float32(PITCH)
        factor = sampled(self._factors, columns, rows, cv2.BORDER_WRAP)
        grey = np.where(top, cast.grey * factor, cast.grey)
        return Cast(cast.depth, grey, cast.region)


def sampled(field: Floats, columns: Floats, rows: Floats, border: int = cv2.BORDER_REPLICATE) -> Floats:
    """Interpolate a map. OpenCV allows at most 32767 positions a side, so long lists are passed as several rows."""
    shape = columns.shape
    if columns.ndim == 1:
        padded = -len(columns) % 1024
        columns, rows = (np.pad(f, (0, padded)).reshape(-1, 1024) for f in (columns, rows))
    values = cv2.remap(field, columns, rows, cv2.INTER_LINEAR, borderMode=border)
    return np.asarray(values, dtype=np.float32).reshape(-1)[: int(np.prod(shape))].reshape(shape)


@lru_cache(maxsize=2)
def texture_map(texture: Texture) -> Floats:
    """Factors on a table's grey level, (n, n) with a pitch of `PITCH`; the map repeats after `TILE`."""
    rng = np.random.default_rng([texture.seed, 1])
    n = round(TILE / PITCH)
    field = texture.grain * _noise(rng, n, 1.5) if texture.grain else np.zeros((n, n), dtype=np.float32)
    if texture.stain:
        coarse = round(TILE / STAIN_LENGTH)
        tones = np.pad(_noise(rng, coarse, 1.0), 2, mode="wrap")
        size = (coarse + 4) * (n // coarse)
        smooth = cv2.resize(tones, (size, size), interpolation=cv2.INTER_CUBIC)
        cut = 2 * (n // coarse)
        field += np.float32(texture.stain) * smooth[cut : cut + n, cut : cut + n]
    tone = KIND_GREY["table"]
    for _ in range(round(texture.scratches * TILE**2)):
        _scratch(field, rng, n, tone)
    for _ in range(round(texture.specks * TILE**2)):
        _speck(field, rng, n, tone)
    field /= np.float32(tone)
    field += np.float32(1.0)
    return np.asarray(np.maximum(field, 0.0, out=field))


def _noise(rng: np.random.Generator, n: int, sigma: float) -> Floats:
    """Periodic smooth noise (n, n) of unit variance, correlated over `sigma` cells."""
    edge = int(4 * sigma) + 1
    padded = np.pad(rng.standard_normal((n, n), dtype=np.float32), edge, mode="wrap")
    smooth = cv2.GaussianBlur(padded, (0, 0), sigma)[edge:-edge, edge:-edge]
    return np.asarray(smooth / smooth.std(), dtype=np.float32)


def _drawn(
    field: Floats, at: Array, strength: float, draw: Callable[[Floats, Array], object], blur: float
) -> None:
    """Draw a stroke with soft edges around `at` (2,) into a periodic map; `draw` gets a patch and its middle."""
    half, n = 130, len(field)
    patch = np.zeros((2 * half, 2 * half), dtype=np.float32)
    whole = np.floor(at).astype(int)
    draw(patch, half + at - whole)
    patch = np.asarray(cv2.GaussianBlur(patch, (0, 0), blur), dtype=np.float32)
    index = [(np.arange(-half, half) + w) % n for w in whole]
    field[np.ix_(index[1], index[0])] += np.float32(strength) * patch


def _scratch(field: Floats, rng: np.random.Generator, n: int, tone: float) -> None:
    """A slightly curved line, 4 to 50 mm long and some tenths of a mm wide, darker or lighter than the table."""
    at, angle, bend = rng.uniform(0.0, n, 2), rng.uniform(0.0, 2.0 * np.pi), rng.normal(0.0, 0.4)
    half = 0.5e-3 * np.exp(rng.uniform(np.log(4.0), np.log(50.0))) / PITCH
    strength = tone * rng.uniform(0.05, 0.25) * rng.choice([-1.0, -1.0, 1.0])
    s = np.linspace(-1.0, 1.0, 9)
    along = half * np.stack([np.cos(angle + bend * s), np.sin(angle + bend * s)], axis=-1) * s[:, None]

    def draw(patch: Floats, middle: Array) -> None:
        points = np.rint((along + middle) * 16.0).astype(np.int32)
        cv2.polylines(patch, [points], False, 1.0, 2, cv2.LINE_8, 4)

    _drawn(field, at, strength, draw, rng.uniform(0.6, 1.0))


def _speck(field: Floats, rng: np.random.Generator, n: int, tone: float) -> None:
    """A dark spot of irregular outline, 0.5 to 4 mm across."""
    at, strength = rng.uniform(0.0, n, 2), -tone * rng.uniform(0.15, 0.6)
    radius = 0.5e-3 * np.exp(rng.uniform(np.log(0.5), np.log(4.0))) / PITCH
    angles = np.linspace(0.0, 2.0 * np.pi, 7, endpoint=False)
    outline = radius * rng.uniform(0.5, 1.2, 7)[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)

    def draw(patch: Floats, middle: Array) -> None:
        cv2.fillPoly(patch, [np.rint((outline + middle) * 16.0).astype(np.int32)], 1.0, cv2.LINE_8, 4)

    _drawn(field, at, strength, draw, 0.8)
