"""A pause: the arm stands where it ran out of motion, and goes on only if it still stands there.

Inside a stream nothing more is sent, so the unit brings the arm to rest on the path, at the last point that it was
given (fact sheet, section 2, row 13). Between steps the arm stands already.
"""

from __future__ import annotations

from arm.errors import ExecutionStopped
from driver.execution.control import Control
from driver.line.link import NoAnswer
from driver.mars.mars import RELEASE_MARGIN_S, Mars
from driver.mars.ready import SETTLE_S, refuse_failure
from driver.mars.refusals import off_by
from driver.mars.stopping import STILL_COUNTS, farthest

POLL_S = 0.25
LOOKS = 2  # samples in a row that tell that the arm was displaced: one may be a digit lost on the line


class Hold:
    """One pause, as samples of the position tell of it.

    Args:
        mars: the arm.
        control: that asked for it.
        here: where the arm is about, (6,) counts; only to begin with.

    Attributes:
        stood: where the arm was first seen to stand, (6,) counts.
    """

    def __init__(self, mars: Mars, control: Control, here: tuple[int, ...]) -> None:
        self.mars = mars
        self.control = control
        self.stood: tuple[int, ...] | None = None
        self._last = here
        self._away = 0
        self._since: float | None = None  # when the unit had run out of motion
        self._asked_on: float | None = None  # when the pause was seen to be over
        self._sound: float | None = None  # when the arm was last seen at its place

    def begin(self, ahead_s: float) -> None:
        """Say that the pause begins; the unit still holds so much motion."""
        self.mars.note("pause", ahead_s=round(ahead_s, 3))
        self.control.tell(f"paused: the arm plays out {ahead_s:.1f} s of motion" if ahead_s else "paused")

    def take(self, counts: tuple[int, ...], place: tuple[int, ...]) -> None:
        """A sample after the unit has run out of motion; the arm should come to stand at `place`.

        Raises:
            ExecutionStopped: it is elsewhere, or moves; or the pause lasts so long that the unit would release the arm.
        """
        now = self.mars.clock.now()
        since = self._since = now if self._since is None else self._since
        still, off = farthest(counts, self._last) <= STILL_COUNTS, farthest(counts, place)
        self._last = counts
        if self.stood is None and not still:
            if now > since + self.mars.link.patience(SETTLE_S):
                raise NoAnswer(f"pause: the arm does not settle within {SETTLE_S:g} s", reason="settle")
            return
        self._away = self._away + 1 if off > self.mars.unit.rest_tolerance else 0
        if self._away >= LOOKS:
            unit = self.mars.unit
            raise ExecutionStopped(
                f"pause: the arm is {off} counts from where it should stand, at most {unit.rest_tolerance} are "
                f"allowed ({off_by(unit, counts, place)}): was it pushed?",
                counts=list(counts),
                expected=list(place),
                reason="displaced",
            )
        if self._away == 0:
            self._sound = now
            if self.stood is None:
                self._stands(counts)
        release_s = self.mars.unit.idle_release_s
        if release_s and now > since + release_s - RELEASE_MARGIN_S:
            raise ExecutionStopped(
                f"paused for {(now - since) / 60.0:.0f} min: the unit is about to release the arm; "
                "resume from where it is",
                reason="idle",
            )

    def _stands(self, counts: tuple[int, ...]) -> None:
        self.stood = counts
        self.control.standing = True
        self.mars.note("standing", counts=list(counts))
        self.control.tell("paused: the arm stands, under power")

    def over(self, dry: bool) -> bool:
        """Whether motion may go on: asked for, and the arm seen at its place since, if it had run out of motion."""
        if self.control.paused:
            self._asked_on = None
            return False
        now = self.mars.clock.now()
        asked = self._asked_on = now if self._asked_on is None else self._asked_on
        return not dry or (self.stood is not None and self._sound is not None and self._sound > asked)

    def end(self, segments_sent: int) -> None:
        """Say that motion goes on."""
        self.control.standing = False
        self.mars.note("go_on", segments_sent=segments_sent)
        self.control.tell("goes on")


def hold_between_steps(mars: Mars, control: Control) -> None:
    """Wait while a pause is asked for; the arm stands, and is watched.

    Raises:
        ExecutionStopped: aborted, a fault, displaced, or too long; with the state.
    """
    control.require()
    if not control.paused:
        return
    with mars.guarded("pause"):
        place = mars.settled_counts()
        hold = Hold(mars, control, place)
        hold.begin(0.0)
        while not hold.over(dry=True):
            refuse_failure(mars.link, mars.status(), "pause")
            hold.take(mars.counts(), place)
            until = mars.clock.now() + POLL_S
            while control.paused and mars.clock.now() < until:
                mars.link.receive(until)
        hold.end(0)
