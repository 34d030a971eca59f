"""Legs between the sites of a task."""

from __future__ import annotations

import pytest

from plan.program.assignment.legs import AT_HOME, HOME, Leg, Site, Stop

SOURCE, PLACE = Stop(Site(False, 3), 1), Stop(Site(True, 2), 5)


@pytest.mark.parametrize(
    ("leg", "carries", "own"),
    [
        (Leg(AT_HOME, SOURCE), False, {SOURCE.site}),
        (Leg(SOURCE, PLACE), True, set()),
        (Leg(PLACE, SOURCE), False, {PLACE.site, SOURCE.site}),
        (Leg(PLACE, AT_HOME), False, {PLACE.site}),
    ],
)
def test_a_cube_is_carried_to_places_only_and_rests_where_the_arm_leaves_or_fetches_it(
    leg: Leg, carries: bool, own: set[Site]
) -> None:
    assert leg.carries is carries
    assert leg.own == own
    assert leg.grasps == (leg.origin.grasp, leg.goal.grasp)


def test_sources_come_before_places_and_home_is_none_of_them() -> None:
    sites = [Site(True, 0), Site(False, 1), Site(True, 1), Site(False, 0)]
    assert sorted(sites) == [Site(False, 0), Site(False, 1), Site(True, 0), Site(True, 1)]
    assert HOME not in sites
