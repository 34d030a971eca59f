"""Chains with unknowns, and what cameras at their ends say of them: derivatives, and estimates against the truth."""

import numpy as np
import pytest

from arm.se3 import inverse, rotation_vector
from recorded.seen_chains import COUNT, READINGS, eye_to_hand, gains, readings


@pytest.mark.parametrize("chain", [eye_to_hand(), eye_to_hand().inverse()], ids=["there", "back"])
def test_twists_are_the_derivatives(chain):
    rng = np.random.default_rng(1)
    q, x = readings(2, 5), rng.normal(0.0, 0.05, COUNT)
    given = gains(q, x)
    at = chain.evaluate(q, x, given)

    def twist(T, T_near):
        E = inverse(T) @ T_near
        return np.concatenate([E[:3, 3], rotation_vector(E[:3, :3])])

    h = 1e-6
    for k in range(COUNT):
        near = chain.evaluate(q, x + h * np.eye(COUNT)[k], given)
        for n in range(len(q)):
            assert at.by_unknown[n, k] == pytest.approx(twist(at.T[n], near.T[n]) / h, abs=1e-5)
    for j in range(READINGS):
        near = chain.evaluate(q + h * np.eye(READINGS)[j], x, given)
        for n in range(len(q)):
            assert at.by_reading[n, j] == pytest.approx(twist(at.T[n], near.T[n]) / h, abs=1e-5)


def test_a_chain_turned_round_is_the_inverse():
    q, x = readings(3, 4), np.random.default_rng(4).normal(0.0, 0.1, COUNT)
    there, back = (c.evaluate(q, x, gains(q, x)).T for c in (eye_to_hand(), eye_to_hand().inverse()))
    assert there @ back == pytest.approx(np.tile(np.eye(4), (4, 1, 1)), abs=1e-12)
