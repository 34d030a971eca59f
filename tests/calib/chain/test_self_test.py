"""The self-test: sound calibrations pass, and one whose errors are larger than it says does not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from scipy.special import chdtr

from arm.robot.dh import A465
from arm.se3 import Array, frozen, rotation, transform
from calib.chain.fit import ChainFit, Problem, Sightings, fit_chains
from calib.chain.result import ChainCalibration
from calib.chain.self_test import SelfTest, _twin, self_test
from calib.hand_eye.calibrate import calibrate_hand_eye
from calib.hand_eye.chain import OFFSETS, arm_chain, unknown_names
from calib.recordings.arm import ArmRecording
from vision.camera.model import Camera

SIGMA = 0.3


@pytest.fixture(scope="module")
def calibration() -> ChainCalibration:
    rng = np.random.default_rng(4)
    lens = Camera(
        np.array([[1500.0, 0.0, 960.0], [0.0, 1500.0, 600.0], [0.0, 0.0, 1.0]]),
        np.zeros(5),
        (1920, 1200),
        np.eye(4),
    )
    T_base_camera = transform(rotation([np.pi, 0.0, 0.0]), (0.5, 0.0, 1.4))
    T_gripper_target = transform(rotation([0.0, 0.1, 0.0]), (0.1, 0.0, 0.1))
    points = np.array([(x, y, 0.0) for x in np.linspace(0, 0.06, 4) for y in np.linspace(0, 0.06, 4)])
    chain = arm_chain(A465, T_base_camera, T_gripper_target)
    joints = rng.uniform(-1.2, 1.2, (60, 6))
    offsets = np.zeros(len(unknown_names(6)))
    T = chain.evaluate(joints, offsets).T
    at = np.einsum("nij,mj->nmi", T[:, :3, :3], points) + T[:, None, :3, 3]
    seen = (at[..., 2] > 0.2).all(axis=1)
    pixels = lens.project(at[seen])
    pixels = pixels + rng.normal(0.0, SIGMA, pixels.shape)
    recording = ArmRecording(lens, A465, frozen(points), "points", frozen(joints[seen]), frozen(pixels))
    found = calibrate_hand_eye(recording).chain
    assert found.accepted
    return found


@dataclass
class Fits:
    """What the self-test solved, and what came out."""

    problems: list[Problem] = field(default_factory=list)
    weights: list[Sequence[Array]] = field(default_factory=list)
    fits: list[ChainFit] = field(default_factory=list)


@pytest.fixture
def fits(monkeypatch: pytest.MonkeyPatch) -> Fits:
    seen = Fits()

    def noted(problem: Problem, weights: Sequence[Array]) -> ChainFit:
        seen.problems.append(problem)
        seen.weights.append(weights)
        seen.fits.append(fit_chains(problem, weights))
        return seen.fits[-1]

    monkeypatch.setattr("calib.chain.self_test.fit_chains", noted)
    return seen


def with_sightings(c: ChainCalibration, images: int, **changes: object) -> ChainCalibration:
    """The first images of a calibration, with something changed in them."""
    s = c.problem.sightings[0]
    fewer = {
        name: getattr(s, name)[:images]
        for name in ("readings", "reading_ids", "stances", "pixels", "noise", "effects")
    }
    problem = replace(c.problem, sightings=[replace(s, **{**fewer, **changes})])
    weights = (c.fit.weights[0][:images],)
    return replace(c, problem=problem, fit=replace(c.fit, weights=weights))


def test_figures_are_those_of_the_twins_own_fits(calibration: ChainCalibration, fits: Fits) -> None:
    c = calibration
    test = self_test(c, 4, 3)
    free = c.problem.free
    off = [(fit.unknowns - c.fit.unknowns)[free] for fit in fits.fits]
    count = 4 * int(free.sum())
    squares = sum(x @ fit.information @ x for x, fit in zip(off, fits.fits, strict=True))
    assert test.nees_dof == pytest.approx(squares / count, rel=1e-9)
    scores = [
        np.abs(x) / np.sqrt(np.diag(np.linalg.inv(fit.information)))
        for x, fit in zip(off, fits.fits, strict=True)
    ]
    assert test.worst == pytest.approx(np.max(scores), rel=1e-5)
    twin, worst = np.unravel_index(np.argmax(scores), np.shape(scores))
    assert twin < 3, "it is not only that of the last"
    assert off[twin][worst] < 0.0, "nor of those that are positive"
    assert chdtr(count, np.array(test.limits) * count) == pytest.approx([5e-4, 1.0 - 5e-4], rel=1e-3)
    assert SelfTest(1.0, (1.0, 1.0), 0.0).passed


def test_twins_are_solved_as_the_data_were(calibration: ChainCalibration, fits: Fits) -> None:
    """From the same start, without what was left out and without corners that were not seen."""
    s = calibration.problem.sightings[0]
    pixels = np.array(s.pixels)
    pixels[2, 5] = pixels[7, :4] = np.nan
    c = with_sightings(calibration, len(pixels), pixels=pixels)
    weights = np.ones(len(pixels))
    weights[[1, 4]] = 0.0
    c = replace(c, fit=replace(c.fit, weights=(weights,)))
    self_test(c, 1)
    (twin,), ((used,),) = fits.problems, fits.weights
    assert np.array_equal(used, weights)
    drawn = twin.sightings[0].pixels
    assert np.array_equal(np.isnan(drawn), np.isnan(pixels))
    assert np.nanmin(np.abs(drawn - pixels)) > 0.0
    unknown = np.isinf(c.problem.prior_sigma)
    assert np.array_equal(twin.start[unknown], c.problem.start[unknown])
    assert np.array_equal(twin.free, c.problem.free)


def test_what_is_known_beforehand_is_drawn_as_surely_as_it_is_known(calibration: ChainCalibration) -> None:
    """Zeros that are known far better than the images tell: all that is found of them is the prior."""
    offsets = np.zeros(len(calibration.names), dtype=bool)
    offsets[OFFSETS + 1 : OFFSETS + 5] = True
    sigma = np.where(offsets, 1e-8, np.inf)
    problem = replace(calibration.problem, free=offsets, prior_sigma=sigma)
    known = with_sightings(replace(calibration, problem=problem), 12)
    test = self_test(known, 12)
    assert test.passed
    assert test.nees_dof == pytest.approx(1.0, abs=0.6)  # of 48 squares


def test_images_of_other_noise_are_drawn_with_it(calibration: ChainCalibration) -> None:
    n = len(calibration.problem.sightings[0].readings)
    blurred = with_sightings(calibration, n, noise=np.where(np.arange(n) % 2 == 0, 1.0, 6.0))
    assert self_test(blurred, 6).passed
    s = blurred.problem.sightings[0]
    drawn = _twin(blurred.problem, s, blurred.fit.unknowns, np.random.default_rng(0)).pixels
    clean = blurred.problem.camera.project(_points(s, blurred.fit.unknowns))
    for first, noise in ((0, 1.0), (1, 6.0)):
        spread = (drawn - clean)[first::2] / blurred.problem.pixel_sigma
        assert float(np.std(spread)) == pytest.approx(noise, rel=0.1)


def test_coarse_encoders_are_drawn_once_a_reading(calibration: ChainCalibration) -> None:
    """Three images at each reading, which all are off by the same."""
    s = calibration.problem.sightings[0]
    stances = np.arange(24) // 3
    c = with_sightings(
        calibration,
        24,
        readings=s.readings[stances],
        reading_ids=np.tile(stances[:, None], (1, 6)),
        stances=stances,
    )
    step = np.full(6, 2e-3)
    c = replace(c, problem=replace(c.problem, reading_sigma=step, pixel_sigma=np.full(2, 1e-6)))
    s = c.problem.sightings[0]
    rng = np.random.default_rng(0)
    off = []
    exact = c.problem.camera.project(_points(s, c.fit.unknowns))
    for _ in range(20):
        moved = _twin(c.problem, s, c.fit.unknowns, rng).pixels - exact
        assert np.abs(moved[0::3] - moved[1::3]).max() < 1e-4
        assert np.abs(moved[1::3] - moved[2::3]).max() < 1e-4
        off.append(moved[0::3].mean(axis=1))
    squares = np.zeros((8, 2))
    for error in np.diag(step):
        shifted = c.problem.camera.project(_points(s, c.fit.unknowns, np.tile(error, (24, 1))))
        squares += (shifted - exact)[0::3].mean(axis=1) ** 2
    assert float(np.mean(np.square(off) / squares)) == pytest.approx(1.0, abs=0.3)


def _points(s: Sightings, unknowns: Array, errors: Array | None = None) -> Array:
    T = s.evaluate(unknowns, np.zeros_like(s.readings) if errors is None else errors).T
    return np.asarray(np.einsum("nij,mj->nmi", T[:, :3, :3], s.points) + T[:, None, :3, 3])


def test_a_sound_calibration_passes_with_every_seed(calibration: ChainCalibration) -> None:
    tests = [self_test(calibration, 4, seed) for seed in range(6)]
    assert all(t.passed for t in tests)
    assert np.mean([t.nees_dof for t in tests]) == pytest.approx(1.0, abs=0.25)
    assert max(t.worst for t in tests) < 5.0
    assert self_test(calibration, 4, 1) == tests[1]


@pytest.mark.few(1)
@pytest.mark.parametrize(("times", "passes"), [(1.0, True), (2.0, False), (0.5, False)])
def test_corners_that_are_better_or_worse_than_they_are_said_to_be_are_noticed(
    calibration: ChainCalibration, monkeypatch: pytest.MonkeyPatch, times: float, passes: bool
) -> None:
    """Twins are drawn with another noise than the fit believes."""
    import calib.chain.self_test as twin

    drawn = twin._twin

    def other(problem, s, unknowns, rng):  # type: ignore[no-untyped-def]
        louder = replace(problem, pixel_sigma=times * problem.pixel_sigma)
        return drawn(louder, s, unknowns, rng)

    monkeypatch.setattr(twin, "_twin", other)
    assert self_test(calibration, 6).passed == passes
