"""What a run does about cubes that are not where they should be.

A cube that was not gripped, or did not seat, is located in the next look and taken again from where it is, by a plan of
its own that is certified like any other. How often is limited (`recovery.attempts`). A cube that does not seat is then
put back into its hole. A cube that no plan can move stays where it is, and the others go around it. Only a cube that no
look locates ends the run, because the arm could hit it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from arm.errors import ImpossibleError
from cell.cubes.confirm_placed import Release, T_base_of, seated, width_at
from cell.cubes.locate import locate_displaced
from cell.cubes.search import Search
from cell.files.task import Task
from cell.report.cubes import UNDECIDED
from cell.scene.build import RELEASE_GAP, cube_name, hole_station, table_station
from cell.scene.displaced import BESIDE, DisplacedCube, is_beside, is_displaced
from plan.scene import Station
from vision.observation import Observation
from vision.occupancy.seated import CubeWidth


@dataclass(eq=False)
class Recovery:
    """The cubes of a run that are not where they should be, and what was tried with each.

    Attributes:
        task: of the run.
        most: how often a cube is taken again.
        displaced: located cubes that are to be taken again, by name.
        stuck: located cubes that stay where they are, by name.
        tried: how often each cube was not gripped or did not seat.
        targets: place at which each cube did not seat.
        searches: releases that did not seat a cube, by cube.
        widths: measured widths, by cube.
        not_located: why a cube was not located in the last look for it, by cube.
    """

    task: Task
    most: int
    displaced: dict[str, DisplacedCube] = field(default_factory=dict)
    stuck: dict[str, DisplacedCube] = field(default_factory=dict)
    tried: Counter[str] = field(default_factory=Counter)
    targets: dict[str, str] = field(default_factory=dict)
    searches: dict[str, Search] = field(default_factory=dict)
    widths: dict[str, CubeWidth] = field(default_factory=dict)
    not_located: dict[str, str] = field(default_factory=dict)
    _empty: dict[str, Observation] = field(default_factory=dict)
    _seen: dict[str, Observation] = field(default_factory=dict)  # the last look in which a cube was searched
    _waiting: list[str] = field(default_factory=list)  # cubes that no plan moves before the others have moved
    _waited: set[str] = field(default_factory=set)  # those, and cubes that waited before

    @property
    def cubes(self) -> tuple[DisplacedCube, ...]:
        """All located cubes that are not in their seats."""
        return (*self.displaced.values(), *self.stuck.values())

    def keep_empty(self, observation: Observation) -> None:
        """Keep a look for the places that are certainly empty in it, and have no displaced cube beside them."""
        for board in observation.boards:
            for hole in board.holes("empty"):
                if hole.name not in observation.moved_since and not is_beside(hole, self.cubes):
                    self._empty[hole.name] = observation

    def empty_look(self, place: str) -> Observation | None:
        """The last look with an empty place; None if there was none."""
        return self._empty.get(place)

    def survey(self, observation: Observation) -> list[str]:
        """Locate the cubes that stand oblique or beside a hole of the source board; return a line for each."""
        source = observation.board(self.task.from_board.name)
        if source is None or not self.most:
            return []
        lines = []
        for hole, now in zip(source.pose.holes, source.occupancy, strict=True):
            cube = cube_name(hole.name)
            if not is_displaced(now) or cube in self.displaced or cube in self.stuck:
                continue
            found = locate_displaced(
                self.task, observation, cube, [hole.name], None, self.cubes, self.empty_look(hole.name)
            )
            if isinstance(found, DisplacedCube) and not self._is_known(found):
                self.displaced[cube], self._seen[cube] = found, observation
                lines.append(
                    f"{cube} is {found.describe(self.task.cell, hole.T_base_hole)}; it is taken from there"
                )
        return lines

    def locate_again(self, observation: Observation) -> list[str]:
        """Update where cubes are that an earlier look located, because their board may have moved since.

        Returns:
            A line for each cube to be taken that this look does not locate. It stays, and is assumed to be on its board
            where the last look located it.
        """
        lines = []
        for cube in self.cubes:
            before = self._seen.get(cube.name)
            if before is observation:
                continue
            self._seen[cube.name] = observation
            others = [other for other in self.cubes if other.name != cube.name]
            width = self.widths.get(cube.name)
            found = locate_displaced(self.task, observation, cube.name, [cube.near], width, others)
            now = self._carried(cube, before, observation) if isinstance(found, str) else found
            (self.displaced if cube.name in self.displaced else self.stuck)[cube.name] = now
            if isinstance(found, str) and cube.name in self.displaced:
                self.leave(cube)
                lines.append(
                    f"{cube.name} stays {cube.place}, where it was located before; in this look not: {found}"
                )
        return lines

    def _carried(self, cube: DisplacedCube, before: Observation | None, now: Observation) -> DisplacedCube:
        """A cube that moved with its board between two looks, as far as they show the board."""
        T_before = None if before is None else T_base_of(self.task, before, cube.near)
        T_now = T_base_of(self.task, now, cube.near)
        return cube if T_before is None or T_now is None else cube.carried(T_before, T_now)

    def assume(self, cubes: Iterable[DisplacedCube], then: Observation) -> None:
        """Take over cubes of a stopped run, which located them while the boards were as in `then`; they stay."""
        for cube in cubes:
            self.most = self.task.cell.recovery_attempts
            self.stuck[cube.name], self._seen[cube.name] = cube, then

    def find(self, cube: str, target: str, observation: Observation) -> str | None:
        """Locate a cube that a stopped run was to bring to a target, so that it is brought there; else say why not."""
        known = self.stuck.pop(cube)
        found = locate_displaced(
            self.task, observation, cube, [known.near], self.widths.get(cube), self.cubes
        )
        if isinstance(found, str):
            self.stuck[cube] = known
            return found
        self.displaced[cube], self._seen[cube] = found, observation
        self.targets[cube], self.searches[cube] = target, Search()
        return None

    def _is_known(self, found: DisplacedCube) -> bool:
        half = self.task.cell.cube_size / 2.0
        return any(
            abs(found.T_base_cube[:3, 3] - other.T_base_cube[:3, 3]).max() < half for other in self.cubes
        )

    def keep_width(self, before: Observation, cube: str, place: str) -> None:
        """Measure the width of a cube in the last look before the jaws closed on it: later it may not be seated."""
        if self.most and cube not in self.widths and not self.tried[cube] and place not in before.moved_since:
            width = width_at(self.task, before, place)
            self.widths |= {} if width is None else {cube: width}

    def after_miss(self, observation: Observation, cube: str, place: str) -> str | None:
        """Determine where a cube is that the jaws did not hold; None without attempts.

        Args:
            observation: the look after it.
            cube: its name.
            place: where it was: a hole, or beside one.

        Returns:
            What happens now, in words; None if it is neither seated nor located.
        """
        self.displaced.pop(cube, None)
        if not self.most:
            return None
        self.tried[cube] += 1
        near = place.removeprefix(BESIDE)
        seat = seated(self.task, observation, near, self.widths.get(cube), self.empty_look(near))
        words = None if seat.state == "seated" else self._locate(observation, cube, [near])
        if words is None and near != self.home(cube):
            shown = near.startswith("table/") or observation.state(near) == "cube"
            return f"{cube} is seated in {near}" if shown and seat.state == "seated" else None
        shown = seat.state == "seated" or (observation.state(near) == "cube" and seat.state == "unsure")
        if words is None and shown:
            self.not_located.pop(cube, None)
            return f"{cube} is in {near}; {self._count(cube)}"
        return words

    def after_release(self, observation: Observation, cube: str, release: Release) -> str | None:
        """Take stock of a cube that did not seat where it was released; as `after_miss`."""
        if not self.most:
            return None
        if release.width is not None:
            self.widths[cube] = release.width
        self.tried[cube] += 1
        places = list(dict.fromkeys((release.target, release.source.removeprefix(BESIDE))))
        words = self._locate(observation, cube, places)
        found = self.displaced.get(cube)
        T_base_place = T_base_of(self.task, observation, release.target)
        if found is not None and T_base_place is not None:
            offset = found.release_offset(self.task.cell, T_base_place)
            search = self.searches.get(cube, Search())
            self.searches[cube] = search.after(T_base_place, release.T_base_tool, offset)
            self.targets[cube] = release.target
        return words

    def _count(self, cube: str) -> str:
        """Whether it is taken again, in words."""
        if self.tried[cube] <= self.most:
            return f"it is taken again ({self.tried[cube]} of {self.most})"
        return f"it was taken again {self._times()}"

    def _times(self) -> str:
        return f"{self.most} time{'' if self.most == 1 else 's'}"

    def _locate(self, observation: Observation, cube: str, places: list[str]) -> str | None:
        found = locate_displaced(
            self.task,
            observation,
            cube,
            places,
            self.widths.get(cube),
            self.cubes,
            self.empty_look(places[0]),
        )
        if isinstance(found, str):
            self.not_located[cube] = found
            return None
        T_base_place = T_base_of(self.task, observation, found.near)
        where = (
            f"{cube} is {found.describe(self.task.cell, T_base_place)}" if T_base_place is not None else ""
        )
        self.displaced[cube], self._seen[cube] = found, observation
        return f"{where}; {self._count(cube)}"

    def goes_on(self, cube: str) -> bool:
        """Whether a cube that the jaws did not hold and that is seated is taken again."""
        return 0 < self.tried[cube] <= self.most

    def where(self, cube: str, place: str) -> str:
        """Where a cube is that the jaws did not hold at a place: displaced, or seated there."""
        found = self.displaced.get(cube)
        return place.removeprefix(BESIDE) if found is None else found.place

    @staticmethod
    def home(cube: str) -> str:
        """The hole that a cube came from."""
        return cube.removeprefix(cube_name(""))

    def leave(self, cube: DisplacedCube) -> None:
        """Leave a cube where it is."""
        self.stuck[cube.name] = self.displaced.pop(cube.name)

    def wait(self, cube: DisplacedCube) -> bool:
        """Leave a cube that no plan moves now; return whether `take_up` gives it one more try."""
        self.leave(cube)
        if cube.name in self._waited or self.tried[cube.name] > self.most:
            return False
        self._waited.add(cube.name)
        self._waiting.append(cube.name)
        return True

    def take_up(self) -> bool:
        """Take the waiting cubes, now that the others have moved; return whether there are any."""
        taken = {name: self.stuck.pop(name) for name in self._waiting if name in self.stuck}
        self._waiting.clear()
        self.displaced |= taken
        return bool(taken)

    def target(self, cube: DisplacedCube) -> str:
        """Where a cube was to go, as far as that was decided."""
        return self.targets.get(cube.name, UNDECIDED)

    def goals(
        self, cube: DisplacedCube, observation: Observation, free: Callable[[], Sequence[Station]]
    ) -> Sequence[Station]:
        """The stations to which a cube may be brought, best first; `free` returns the free ones.

        A cube that did not seat goes to the same place with a correction; after the last attempt, back to its hole.

        Raises:
            ImpossibleError: there is none.
        """
        if self.tried[cube.name] > self.most + 1:
            raise ImpossibleError(
                f"it was taken again {self._times()}, and putting it back failed", cube=cube.name
            )
        home = self.home(cube.name)
        if self.tried[cube.name] > self.most:
            station = self._place(home, observation)
            if station is None or (cube.near != home and observation.state(home) != "empty"):
                raise ImpossibleError(f"its hole {home} is not free", cube=cube.name)
            return (station,)
        target = self.targets.get(cube.name)
        station = None if target is None else self._place(target, observation)
        T_base_place = None if target is None else T_base_of(self.task, observation, target)
        if station is None or T_base_place is None:
            goals = free()
            if not goals:
                raise ImpossibleError("no place is free and in reach", cube=cube.name)
            return goals
        return (self.searches[cube.name].station(station, T_base_place),)

    def _place(self, place: str, observation: Observation) -> Station | None:
        """A place as a station; None if its board was not seen."""
        name, _, number = place.rpartition("/")
        if name == "table":
            return table_station(self.task, place)
        board = observation.board(name)
        return (
            None
            if board is None
            else hole_station(self.task.cell, board.pose.holes[int(number) - 1], RELEASE_GAP)
        )
