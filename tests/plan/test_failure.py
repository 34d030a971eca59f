"""Why a task cannot be planned, in figures."""

from __future__ import annotations

from plan.failure import (
    nearness,
)


def test_a_rounded_distance_stays_below_the_required_one() -> None:
    assert nearness(("palm", "wall"), 0.00499, 0.005) == "palm comes within 4.99 mm of wall (required: 5 mm)"
    assert nearness(("palm", "wall"), 0.0042, 0.005) == "palm comes within 4.2 mm of wall (required: 5 mm)"
    assert nearness(("palm", "wall"), 0.005 - 1e-10, 0.005).startswith(
        "palm comes within less than 5 mm of wall"
    )
    assert nearness(("palm", "table"), -0.03, 0.005) == "palm is inside table (required: 5 mm)"
