"""Steps of a plan: moves, which are stored as they will be sent, and what happens at rest between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from arm.controller.segments import CountPath, chain
from arm.former import renamed_arguments


@dataclass(frozen=True)
class Move:
    """A part of a motion in which the held body and the allowed collisions do not change.

    Attributes:
        name: such as "cube 1: approach 01-02/2".
        role: home, transit, approach, line or retract.
        cube: index of the task's cube that the move serves, or None.
        path: the segments that are sent.
        held: name of the body in the jaws, or None.
        jaw_opening: distance of the fingers during the move, m.
        clearance: smallest distance between any two checked bodies over the whole move, m; a proved lower bound if
            `certified`.
        closest: names of the two bodies at that distance.
        certified: whether `clearance` is proved between samples too.
        allowed_collisions: names of bodies that the held cube may touch: what it is lifted off, or placed on.
        clearances: proved lower bound on the clearance of every segment, m; the smallest is `clearance` up to rounding.
            May be empty if the move is not certified.
        allowed_pairs: further pairs of bodies that may touch during the move, such as a finger and what it grips.
        threaded: name of the wire that a ring on the tool stays threaded on, or None.
    """

    name: str
    role: str
    cube: int | None
    path: CountPath
    held: str | None
    jaw_opening: float
    clearance: float
    closest: tuple[str, str]
    certified: bool = False
    allowed_collisions: tuple[str, ...] = ()
    clearances: tuple[float, ...] = ()
    allowed_pairs: tuple[tuple[str, str], ...] = ()
    threaded: str | None = None


def touching_pairs(move: Move) -> frozenset[frozenset[str]]:
    """Return all pairs of bodies that may touch during a move."""
    held = [frozenset((move.held, name)) for name in move.allowed_collisions if move.held is not None]
    return frozenset((*held, *map(frozenset, move.allowed_pairs)))


@dataclass(frozen=True)
class GripperStep:
    """Open or close the jaws at rest. `fraction_closed` is the target, `settle_s` the shortest wait after it."""

    name: str
    action: str
    cube: int | None
    fraction_closed: float
    settle_s: float


@dataclass(frozen=True)
class LookStep:
    """Look again from rest; execution compares the result with the observation that the plan is based on.

    Attributes:
        name: of the step.
        cube: of a second look, on the way into a place: index of the task's cube that is about to be put there; None
            for looks after which nothing is in the jaws.
    """

    name: str
    cube: int | None = None


@renamed_arguments(target="name")
@dataclass(frozen=True)
class Pause:
    """The arm at rest at a goal.

    Attributes:
        name: of the goal.
        dwell_s: for how long, s.
        attached, detached: name of the body that begins to move with the tool, or that stays here; or None.
    """

    name: str
    dwell_s: float
    attached: str | None = None
    detached: str | None = None


Step = Move | GripperStep | LookStep | Pause


def duration_of(step: Step) -> float:
    """Return how long a step takes at least, s; a look takes no time."""
    match step:
        case Move():
            return step.path.duration_s
        case GripperStep():
            return step.settle_s
        case Pause():
            return step.dwell_s
    return 0.0


@dataclass(frozen=True)
class Motion:
    """Consecutive moves that are streamed as one: at rest at both ends only.

    Attributes:
        first: index of the first move among the steps.
        moves: in order.
    """

    first: int
    moves: tuple[Move, ...]

    @property
    def path(self) -> CountPath:
        """The segments of all moves.

        Raises:
            InputError: a move does not start at the counts where the previous one ends.
        """
        return chain([move.path for move in self.moves])

    @property
    def starts(self) -> tuple[int, ...]:
        """Index of the first segment of each move in the motion's path."""
        lengths = [len(move.path.segments) for move in self.moves]
        return tuple(sum(lengths[:i]) for i in range(len(lengths)))


def motions(steps: Sequence[Step]) -> tuple[Motion, ...]:
    """Join consecutive moves to motions, in order; any other step ends a motion."""
    found: list[Motion] = []
    for index, step in enumerate(steps):
        if not isinstance(step, Move):
            continue
        last = found[-1] if found else None
        if last is not None and last.first + len(last.moves) == index:
            found[-1] = Motion(last.first, (*last.moves, step))
        else:
            found.append(Motion(index, (step,)))
    return tuple(found)
