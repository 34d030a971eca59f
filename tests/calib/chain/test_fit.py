"""The fit of a chain: exact readings, honest covariances, priors, and points that were not seen."""

import numpy as np
import pytest

from arm.se3 import frozen
from calib.chain.fit import Problem, Sightings, fit_chains
from recorded.seen_chains import COUNT, READINGS, eye_to_hand, gains, readings
from vision.camera.model import Camera

CAMERA = Camera(
    np.array([[900.0, 0, 640], [0, 900.0, 480], [0, 0, 1]]),
    np.array([-0.1, 0.02, 1e-4, -2e-4, 0.0]),
    (1280, 960),
    np.eye(4),
)

TARGET = frozen([(0.03 * i, 0.03 * j, 0.0) for i in range(-2, 3) for j in range(-2, 2)])


def problem(seed: int, pixel: float = 0.2, encoder: float = 0.0, shared: int = 1, known_encoder: bool = True):
    """Images of the target, `shared` of them at each reading of the arm, and the truth."""
    rng = np.random.default_rng(seed)
    truth = np.concatenate([rng.normal(0, 0.01, 3), rng.normal(0, 0.02, 3), rng.normal(0, 0.01, 3), [0.02]])
    truth[6] = 0.0  # slides into the camera's place
    q = np.repeat(readings(seed, 40), shared, axis=0)
    stances = np.repeat(np.arange(40), shared)
    error = encoder * rng.standard_normal((40, READINGS))[stances]
    chain = eye_to_hand()
    T = chain.evaluate(q + error, truth, gains(q + error, truth)).T
    points = np.einsum("nij,mj->nmi", T[:, :3, :3], TARGET) + T[:, None, :3, 3]
    pixels = CAMERA.project(points)
    pixels += pixel * rng.standard_normal(pixels.shape)
    free = np.ones(COUNT, dtype=bool)
    free[6] = False
    ids = np.tile(stances[:, None], (1, READINGS))
    sightings = Sightings(chain, q, ids, stances, TARGET, pixels, gains)
    sigma = np.full(READINGS, encoder if known_encoder else 0.0)
    start = np.zeros(COUNT)
    return (
        Problem([sightings], CAMERA, start, np.full(COUNT, np.inf), np.full(2, pixel), sigma, free),
        truth,
    )


def test_exact_readings_give_the_unknowns_with_their_covariance():
    scores, chi2 = [], []
    for seed in range(12):
        given, truth = problem(seed)
        fit = fit_chains(given)
        off = (fit.unknowns - truth)[given.free]
        scores.append(off @ fit.information @ off / len(off))
        chi2.append(fit.chi2_dof)
        assert fit.iterations <= 8
    assert np.mean(scores) == pytest.approx(
        1.0, abs=0.35
    )  # 108 degrees of freedom: 0.14 a standard deviation
    assert np.mean(chi2) == pytest.approx(1.0, abs=0.02)


@pytest.mark.slow
def test_errors_of_readings_are_weighed_and_the_covariance_stays_honest():
    scores, plain_scores, better, chi2 = [], [], [], []
    for seed in range(12):
        given, truth = problem(100 + seed, encoder=2e-3, shared=3)
        fit = fit_chains(given)
        off = (fit.unknowns - truth)[given.free]
        scores.append(off @ fit.information @ off / len(off))
        chi2.append(fit.chi2_dof)
        naive, _ = problem(100 + seed, encoder=2e-3, shared=3, known_encoder=False)
        plain = fit_chains(naive)
        wrong = (plain.unknowns - truth)[given.free]
        plain_scores.append(wrong @ plain.information @ wrong / len(wrong))
        better.append(np.linalg.norm(off[6:]) / np.linalg.norm(wrong[6:]))
    assert np.mean(scores) == pytest.approx(1.0, abs=0.4)
    assert np.mean(chi2) == pytest.approx(1.0, abs=0.03)
    assert np.mean(plain_scores) > 10.0
    assert np.median(better) < 0.9


def test_the_prior_holds_what_is_not_free_to_go():
    given, _ = problem(7)
    stiff = np.full(COUNT, np.inf)
    stiff[8] = 1e-9
    held = Problem(
        given.sightings, CAMERA, given.start, stiff, given.pixel_sigma, given.reading_sigma, given.free
    )
    fit = fit_chains(held)
    assert fit.unknowns[8] == pytest.approx(0.0, abs=1e-8)
    assert np.sqrt(fit.covariance(given.free)[8, 8]) == pytest.approx(1e-9, rel=0.01)
    assert fit.chi2_dof > 1.5


def test_points_that_were_not_seen_count_for_nothing():
    given, truth = problem(8)
    pixels = given.sightings[0].pixels.copy()
    pixels[::3, ::2] = np.nan
    s = given.sightings[0]
    fewer = Sightings(s.chain, s.readings, s.reading_ids, s.stances, s.points, pixels, s.gains)
    fit = fit_chains(
        Problem(
            [fewer],
            CAMERA,
            given.start,
            given.prior_sigma,
            given.pixel_sigma,
            given.reading_sigma,
            given.free,
        )
    )
    sigma = np.sqrt(np.diag(fit.covariance(given.free)))[given.free]
    assert (np.abs((fit.unknowns - truth)[given.free]) < 4.0 * sigma).all()
    assert fit.freedom == int(np.isfinite(pixels).sum()) - 9
