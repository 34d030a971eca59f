"""The sizes of an arm's errors come out of how far its images disagree, each with its own joint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import check_grad

from calib.chain.scatter import Reduced, Sizes, _Likelihood, equations_of, estimate_sizes

RAD = np.radians(0.01)


def drawn(seed: int, scatter: list[float], smooth: float = 0.0, images: int = 120) -> Reduced:
    """Images of two joints and three unknowns, of which the last is a smooth error."""
    rng = np.random.default_rng(seed)
    F, M = rng.normal(size=(images, 6, 3)), 3e4 * rng.normal(size=(images, 6, 2))
    F[..., 2] *= 1e4
    e = np.array(scatter) * rng.standard_normal((images, 2))
    y = np.einsum("nij,nj->ni", M, e) + rng.standard_normal((images, 6)) + F[..., 2] * smooth
    nothing = np.zeros(3)
    return Reduced(np.arange(images), y, F, M, nothing, nothing, np.zeros(2), np.array([2]))


def test_the_gradient_is_that_of_the_value() -> None:
    data, weights = drawn(1, [RAD, RAD / 3.0], RAD, 20), np.ones(20)
    weights[3] = 0.5

    def both(theta: np.ndarray) -> tuple[float, np.ndarray]:
        return _Likelihood(data, theta, weights).value_and_gradient

    at = np.log([0.7 * RAD, 0.5 * RAD, 1.5 * RAD])
    off = check_grad(lambda t: both(t)[0], lambda t: both(t)[1], at, epsilon=1e-6)
    assert off < 1e-4 * np.linalg.norm(both(at)[1])


def test_each_joint_has_its_own_scatter() -> None:
    found = estimate_sizes(drawn(2, [RAD, RAD / 4.0]))
    assert found.scatter == pytest.approx([RAD, RAD / 4.0], rel=0.15)
    assert found.distances.mean() == pytest.approx(6.0, rel=0.15)


def test_no_scatter_is_found_where_there_is_none() -> None:
    assert estimate_sizes(drawn(3, [0.0, 0.0])).scatter.max() < 0.1 * RAD


def test_errors_of_readings_that_are_known_are_no_scatter() -> None:
    data = replace(drawn(6, [RAD, RAD]), base=np.full(2, RAD))
    assert estimate_sizes(data).scatter.max() < 0.5 * RAD


def test_images_of_no_weight_are_as_if_not_taken() -> None:
    data, half = drawn(7, [RAD, RAD / 2.0]), np.tile([1.0, 0.0], 60)
    taken = {name: getattr(data, name)[::2] for name in ("images", "y", "F", "M")}
    assert estimate_sizes(data, half).scatter == pytest.approx(
        estimate_sizes(replace(data, **taken)).scatter, rel=1e-3
    )


def test_wrong_images_do_not_pass_for_scatter() -> None:
    data = drawn(4, [RAD, RAD])
    y = data.y.copy()
    y[::6] += 300.0
    wrong = replace(data, y=y)
    assert estimate_sizes(wrong, robust=True).scatter == pytest.approx([RAD, RAD], rel=0.4)
    right = np.ones(len(y))
    right[::6] = 0.0
    left_out = estimate_sizes(wrong, right)
    assert left_out.scatter == pytest.approx([RAD, RAD], rel=0.15)
    assert left_out.distances[::6].min() > 10.0 * left_out.distances[1::6].max()


def test_what_scatters_tells_less_and_smooth_errors_stay_within_their_size() -> None:
    data = drawn(5, [RAD, RAD], RAD)
    loose, exact = (
        equations_of(data, Sizes(np.full(2, size), RAD, np.zeros(0))).S.sum(axis=0) for size in (RAD, 1e-9)
    )
    assert (np.diag(loose) < 0.9 * np.diag(exact)).all()
    prior, _ = equations_of(data, Sizes(np.full(2, RAD), RAD, np.zeros(0))).prior
    assert np.diag(prior) == pytest.approx([0.0, 0.0, RAD**-2])
    assert estimate_sizes(data).smooth == pytest.approx(RAD, rel=1.0)
