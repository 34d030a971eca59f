"""What execution needs of a controller.

`driver.mars.mars.Mars` is one, that of ``examples/rows_over_a_socket.py`` another. Nothing else in `driver.execution`
knows which it has. `driver.execution.guard.Guarded` has what any session needs that can stop its arm.

Positions are encoder counts, (n,), in the order of `Unit.axes`; `Unit.positions` and `Unit.counts` convert. Times are
controller seconds of `Controller.clock`. Every wait has a deadline in them.

Two rules hold for every member. Before the other side has identified itself as the expected unit, nothing is sent but
what asks for its identity, and a member that would need more raises InputError. A member that cannot reach the unit
raises `LinkLost` or `NoAnswer`; it never waits without end and never returns an old reading.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Protocol

from arm.controller.segments import CountPath
from arm.controller.unit import Unit
from driver.execution.control import Control
from driver.execution.progress import Progress, Sent, StreamOptions
from driver.execution.rest import RestState
from driver.line.clock import Clock


class Jaws(Protocol):
    """Where the jaws rest after a move."""

    @property
    def fraction_closed(self) -> float:
        """0 open to 1 closed."""
        ...

    @property
    def stalled(self) -> bool:
        """Whether they rest short of their target, so that something is between them."""
        ...


class Controller(Protocol):
    """One arm on one controller, taken into use. Used by one thread, but for `wake` and `interrupt`."""

    @property
    def unit(self) -> Unit:
        """Counts, limits, rest tolerance (counts) and idle release (s, 0: never) of the arm."""
        ...

    @property
    def clock(self) -> Clock:
        """Controller time."""
        ...

    def counts(self) -> tuple[int, ...]:
        """Return the present position.

        Raises:
            NoAnswer, LinkLost.
            ExecutionStopped: the unit has lost its positions; reason ``restarted``.
        """
        ...

    def settled_counts(self) -> tuple[int, ...]:
        """Wait until two samples 0.1 s apart differ by at most `STILL_COUNTS` on every axis. Return the position.

        Raises:
            NoAnswer: still moving after 3 s, or as `counts`.
        """
        ...

    def require_well(self, what: str) -> None:
        """Ask for the unit's state, and refuse to continue if it has a fault or was switched off and on.

        Args:
            what: what goes on, for the message.

        Raises:
            ExecutionStopped: reason ``fault`` or ``restarted``.
            NoAnswer, LinkLost.
        """
        ...

    def follow(
        self,
        path: CountPath,
        on_progress: Callable[[Progress], None] | None,
        options: StreamOptions | None,
        control: Control,
    ) -> Sent:
        """Move along a path that starts where the arm is, and wait until the arm has settled at its end.

        The arm passes exactly the counts of the path, because the certificate holds for these alone: segments are
        followed as they are, in at least their durations. What does not arrive as it was sent must not move the arm.

        Args:
            path: certified; at least one segment, from rest to rest.
            on_progress: called with each sample, a few times a second, also during a pause. An error of it stops the
                arm.
            options: of streaming; those that the controller has no use for are ignored, except that it refuses
                ``preload`` and ``watch_jaws`` if it cannot do these.
            control: an abort stops the arm at once. A pause lets the unit execute what it holds, and then waits. The
                override, read at the beginning, makes all durations longer (`driver.execution.speed_override`).

        Raises:
            InputError: a segment cannot be sent; nothing moved.
            ImpossibleError: the path leaves the unit's limits, starts further from the arm than `Unit.rest_tolerance`,
                or an option cannot be had; nothing moved.
            ExecutionStopped: a fault, a silent or lost line, an abort, an axis that does not follow
                (``StreamOptions.following_counts``), or an end away from the path's; the arm was told to stop, and
                ``state`` tells whether it was seen at rest.
        """
        ...

    def gripper(self, fraction_closed: float) -> Jaws:
        """Move the jaws, 0 open to 1 closed, and wait until they rest, at the target or on an object; 10 s at most.

        Raises:
            InputError: not from 0 to 1, or the arm carries no gripper.
            ExecutionStopped: a fault, or the jaws do not come to rest in time; with the state.
        """
        ...

    def wait_until(self, until: float) -> None:
        """Wait until controller time `until` or until `wake`, whichever is first.

        Raises:
            Aborted: at once.
            LinkLost: if it is noticed meanwhile.
        """
        ...

    def wake(self) -> None:
        """Make a waiting `wait_until` or `follow` look at its `Control` now. May be called from anywhere."""
        ...

    def interrupt(self) -> None:
        """Make what waits or sends, or does so next, raise `Aborted`, once. May be called from anywhere."""
        ...

    def stop(self) -> RestState:
        """Stop the arm at once, under power, and wait until it is at rest, 10 s at most. Return its state.

        It must reach the unit at any time: nothing that was sent before may hold it up, for long enough to matter.
        Never raises for a failing line; the state says what is not known.
        """
        ...

    def guarded(self, what: str) -> AbstractContextManager[None]:
        """Stop the arm before any error inside is passed on, with its ``state`` (`Guarded.guarded`)."""
        ...

    def note(self, kind: str, **data: object) -> None:
        """Record an event in the log, if there is one."""
        ...
