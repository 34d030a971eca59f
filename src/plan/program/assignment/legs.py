"""Sites of a task, where cubes may rest, and legs: motions of the arm from a grasp at one site to one at another."""

from __future__ import annotations

from typing import NamedTuple


class Site(NamedTuple):
    """The source of a cube (number of the transfer) or, if `placed`, a place (number of the place)."""

    placed: bool
    number: int


HOME = Site(False, -1)  # start and end of the task, where no cube rests
Arrangement = frozenset[Site]  # the sites at which cubes rest


class Stop(NamedTuple):
    """A site, and the number of the grasp (yaw and branch) with which the arm is there; home has one."""

    site: Site
    grasp: int


AT_HOME = Stop(HOME, 0)


class Leg(NamedTuple):
    """The motion between two stops: home to source, source to place, place to source, or place to home."""

    origin: Stop
    goal: Stop

    @property
    def sites(self) -> tuple[Site, Site]:
        """The sites of its ends."""
        return self.origin.site, self.goal.site

    @property
    def grasps(self) -> tuple[int, int]:
        """The numbers of the grasps at its ends."""
        return self.origin.grasp, self.goal.grasp

    @property
    def carries(self) -> bool:
        """Whether the cube of its origin is carried."""
        return self.goal.site.placed

    @property
    def own(self) -> Arrangement:
        """The sites of its ends at which a cube rests whenever it is used: a place that it leaves, a source ahead."""
        origin, goal = self.sites
        own = ([origin] if origin.placed else []) + ([] if goal.placed or goal == HOME else [goal])
        return frozenset(own)
