"""Errors that are shared between two poses stay correlated; others do not."""

from __future__ import annotations

import numpy as np
import pytest

from cell.accuracy.linear_error import ErrorGroup, LinearError


def _group(seed: int, *counts: int) -> ErrorGroup:
    root = np.random.default_rng(seed).normal(size=(sum(counts), sum(counts)))
    return ErrorGroup(root @ root.T, {f"{seed}.{k}": count for k, count in enumerate(counts)})


def _error(seed: int, *groups: ErrorGroup) -> LinearError:
    rng = np.random.default_rng(100 + seed)
    return LinearError({group: rng.normal(size=(6, len(group.covariance))) for group in groups})


def _drawn(error: LinearError, errors: dict[ErrorGroup, np.ndarray]) -> np.ndarray:
    return sum((G @ errors[group] for group, G in error.jacobians.items()), np.zeros(6))


@pytest.mark.parametrize("seed", range(5))
def test_sums_and_maps_are_those_of_the_drawn_errors(seed: int) -> None:
    shared, one, other = _group(seed, 2, 3), _group(seed + 50, 4), _group(seed + 70, 1)
    a, b = _error(0, shared, one), _error(1, shared, other)
    rng = np.random.default_rng(seed)
    M = rng.normal(size=(6, 6))
    errors = {g: rng.normal(size=len(g.covariance)) for g in (shared, one, other)}
    assert _drawn(a + b, errors) == pytest.approx(_drawn(a, errors) + _drawn(b, errors))
    assert _drawn((a - b).transformed(M), errors) == pytest.approx(
        M @ (_drawn(a, errors) - _drawn(b, errors))
    )


def test_an_error_that_is_the_same_at_both_places_cancels() -> None:
    shared = _group(3, 5)
    error = _error(0, shared)
    assert np.abs((error - error).covariance).max() == 0.0
    assert (error + error).covariance == pytest.approx(4.0 * error.covariance)
    again = LinearError({ErrorGroup.of("again", shared.covariance): error.jacobians[shared]})
    assert (error - again).covariance == pytest.approx(2.0 * error.covariance)  # an error of its own does not


@pytest.mark.parametrize("seed", range(5))
def test_parts_add_up_to_the_covariance_and_sources_alone_do_not_know_each_other(seed: int) -> None:
    pair, single = _group(seed, 2, 3), _group(seed + 50, 4)
    error = _error(0, pair, single)
    sources = error.by_source()
    assert list(sources) == [f"{seed}.0", f"{seed}.1", f"{seed + 50}.0"]
    assert sum((part for _, part in sources.values()), np.zeros((6, 6))) == pytest.approx(error.covariance)
    G, C = error.jacobians[pair], pair.covariance
    assert sources[f"{seed}.1"][0] == pytest.approx(G[:, 2:] @ C[2:, 2:] @ G[:, 2:].T)
    alone, part = sources[f"{seed + 50}.0"]
    assert alone == pytest.approx(part)  # independent of the others
    assert np.abs(sources[f"{seed}.0"][0] - sources[f"{seed}.0"][1]).max() > 1e-3


def test_one_source_in_several_groups_is_one_row() -> None:
    both = LinearError(
        {
            ErrorGroup.of("scatter", np.eye(2)): np.ones((6, 2)),
            ErrorGroup.of("scatter", np.eye(1)): np.ones((6, 1)),
        }
    )
    ((alone, part),) = both.by_source().values()
    assert alone == pytest.approx(3.0 * np.ones((6, 6)))
    assert part == pytest.approx(alone)
