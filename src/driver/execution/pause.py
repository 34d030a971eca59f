"""A pause: the arm stops on its path, and resumes only if it is still there.

During a motion the driver sends no more segments. The unit then brings the arm to rest on the path, at the end of the
last segment that it holds (docs/sources.md, "Coordinated motion", row 13). Between steps the arm is already at rest.
"""

from __future__ import annotations

from typing import Protocol

from arm.controller.unit import Unit
from arm.errors import ExecutionStopped, NoAnswer
from driver.execution.control import Control
from driver.execution.controller import Controller
from driver.execution.rest import SETTLE_S, STILL_COUNTS, farthest, off_by
from driver.line.clock import Clock

RELEASE_MARGIN_S = 60.0  # engage again this long before the unit would release an idle arm
POLL_S = 0.25  # between two samples of a pause between steps
DISPLACED_SAMPLES = 2  # in a row: a single sample may be damaged on the line


class _Arm(Protocol):
    """What a pause needs of a controller."""

    @property
    def unit(self) -> Unit: ...

    @property
    def clock(self) -> Clock: ...

    def note(self, kind: str, **data: object) -> None: ...


class Pause:
    """One pause, followed by samples of the position.

    Args:
        arm: that pauses.
        control: the control that requested the pause.
        here: approximate position of the arm, (6,) counts, with which the first sample is compared.

    Attributes:
        stood: where the arm first came to rest, (6,) counts; None before that.
    """

    def __init__(self, arm: _Arm, control: Control, here: tuple[int, ...]) -> None:
        self.arm = arm
        self.control = control
        self.stood: tuple[int, ...] | None = None
        self._last = here
        self._away = 0
        self._since: float | None = None  # when the unit had executed all its segments
        self._resumed_at: float | None = None  # when the resume was noticed
        self._in_place_at: float | None = None  # when the arm was last found at its place

    def begin(self, ahead_s: float) -> None:
        """Report the beginning of the pause; the unit still holds `ahead_s` seconds of motion."""
        self.arm.note("pause", ahead_s=round(ahead_s, 3))
        self.control.tell(
            f"pausing: the arm keeps moving for about {ahead_s:.1f} s" if ahead_s else "pausing"
        )

    def take(self, counts: tuple[int, ...], place: tuple[int, ...]) -> None:
        """Check a sample taken after the unit has executed all its segments. The arm should come to rest at `place`.

        Raises:
            ExecutionStopped: the arm is elsewhere, or moves; or the pause is so long that the unit would release it.
        """
        now = self.arm.clock.now()
        since = self._since = now if self._since is None else self._since
        still, off = farthest(counts, self._last) <= STILL_COUNTS, farthest(counts, place)
        self._last = counts
        if self.stood is None and not still:
            if now > since + self.arm.clock.patience(SETTLE_S):
                raise NoAnswer(f"pause: the arm does not settle within {SETTLE_S:g} s", reason="settle")
            return
        self._away = self._away + 1 if off > self.arm.unit.rest_tolerance else 0
        if self._away >= DISPLACED_SAMPLES:
            unit = self.arm.unit
            why = (
                f"pause: the arm is {off} counts from where it should be, must be at most {unit.rest_tolerance} "
                f"({off_by(unit, counts, place)}); was it pushed?"
            )
            raise ExecutionStopped(why, counts=list(counts), expected=list(place), reason="displaced")
        if self._away == 0:
            self._in_place_at = now
            if self.stood is None:
                self._settle(counts)
        release_s = self.arm.unit.idle_release_s
        if release_s and now > since + release_s - RELEASE_MARGIN_S:
            raise ExecutionStopped(
                f"paused for {(now - since) / 60.0:.0f} min: the unit is about to release the arm; "
                "resume from where it is",
                reason="idle",
            )

    def _settle(self, counts: tuple[int, ...]) -> None:
        self.stood = counts
        self.control.standing = True
        self.arm.note("standing", counts=list(counts))
        self.control.tell("paused: the arm has stopped and is still under power")

    def over(self, dry: bool) -> bool:
        """Whether to resume. A stopped arm must have been found at its place after the resume was requested."""
        if self.control.paused:
            self._resumed_at = None
            return False
        now = self.arm.clock.now()
        requested = self._resumed_at = now if self._resumed_at is None else self._resumed_at
        return not dry or (
            self.stood is not None and self._in_place_at is not None and self._in_place_at > requested
        )

    def end(self, segments_sent: int) -> None:
        """Report that the motion resumes."""
        self.control.standing = False
        self.arm.note("go_on", segments_sent=segments_sent)
        self.control.tell("resuming: the arm moves again")


def pause_between_steps(arm: Controller, control: Control) -> None:
    """Wait while a pause is requested, and check that the arm stays at rest.

    Raises:
        ExecutionStopped: aborted, a fault, displaced, or too long; with the state.
    """
    control.require()
    if not control.paused:
        return
    with arm.guarded("pause"):
        place = arm.settled_counts()
        hold = Pause(arm, control, place)
        hold.begin(0.0)
        while not hold.over(dry=True):
            arm.require_well("pause")
            hold.take(arm.counts(), place)
            until = arm.clock.now() + POLL_S
            while control.paused and arm.clock.now() < until:
                arm.wait_until(until)
        hold.end(0)
