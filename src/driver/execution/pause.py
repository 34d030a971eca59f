"""A pause: the arm stops on its path, and resumes only if it is still there.

During a stream the driver sends no more segments. The unit then brings the arm to rest on the path, at the end of the
last segment that it holds (docs/sources.md, "Coordinated motion", row 13). Between steps the arm is already at rest.
"""

from __future__ import annotations

from arm.errors import ExecutionStopped
from driver.execution.control import Control
from driver.line.link import NoAnswer
from driver.mars.mars import RELEASE_MARGIN_S, Mars
from driver.mars.ready import SETTLE_S, refuse_failure
from driver.mars.refusals import off_by
from driver.mars.stopping import STILL_COUNTS, farthest

POLL_S = 0.25  # between two samples of a pause between steps
DISPLACED_SAMPLES = 2  # in a row: a single sample may be damaged on the line


class Pause:
    """One pause, followed by samples of the position.

    Args:
        mars: the arm.
        control: the control that requested the pause.
        here: approximate position of the arm, (6,) counts, with which the first sample is compared.

    Attributes:
        stood: where the arm first came to rest, (6,) counts; None before that.
    """

    def __init__(self, mars: Mars, control: Control, here: tuple[int, ...]) -> None:
        self.mars = mars
        self.control = control
        self.stood: tuple[int, ...] | None = None
        self._last = here
        self._away = 0
        self._since: float | None = None  # when the unit had executed all its segments
        self._resumed_at: float | None = None  # when the resume was noticed
        self._in_place_at: float | None = None  # when the arm was last found at its place

    def begin(self, ahead_s: float) -> None:
        """Report the beginning of the pause; the unit still holds `ahead_s` seconds of motion."""
        self.mars.note("pause", ahead_s=round(ahead_s, 3))
        self.control.tell(
            f"pausing: the arm keeps moving for about {ahead_s:.1f} s" if ahead_s else "pausing"
        )

    def take(self, counts: tuple[int, ...], place: tuple[int, ...]) -> None:
        """Check a sample taken after the unit has executed all its segments. The arm should come to rest at `place`.

        Raises:
            ExecutionStopped: the arm is elsewhere, or moves; or the pause is so long that the unit would release it.
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
        if self._away >= DISPLACED_SAMPLES:
            unit = self.mars.unit
            why = (
                f"pause: the arm is {off} counts from where it should be, must be at most {unit.rest_tolerance} "
                f"({off_by(unit, counts, place)}); was it pushed?"
            )
            raise ExecutionStopped(why, counts=list(counts), expected=list(place), reason="displaced")
        if self._away == 0:
            self._in_place_at = now
            if self.stood is None:
                self._settle(counts)
        release_s = self.mars.unit.idle_release_s
        if release_s and now > since + release_s - RELEASE_MARGIN_S:
            raise ExecutionStopped(
                f"paused for {(now - since) / 60.0:.0f} min: the unit is about to release the arm; "
                "resume from where it is",
                reason="idle",
            )

    def _settle(self, counts: tuple[int, ...]) -> None:
        self.stood = counts
        self.control.standing = True
        self.mars.note("standing", counts=list(counts))
        self.control.tell("paused: the arm has stopped and is still under power")

    def over(self, dry: bool) -> bool:
        """Whether to resume. A stopped arm must have been found at its place after the resume was requested."""
        if self.control.paused:
            self._resumed_at = None
            return False
        now = self.mars.clock.now()
        requested = self._resumed_at = now if self._resumed_at is None else self._resumed_at
        return not dry or (
            self.stood is not None and self._in_place_at is not None and self._in_place_at > requested
        )

    def end(self, segments_sent: int) -> None:
        """Report that the motion resumes."""
        self.control.standing = False
        self.mars.note("go_on", segments_sent=segments_sent)
        self.control.tell("resuming: the arm moves again")


def pause_between_steps(mars: Mars, control: Control) -> None:
    """Wait while a pause is requested, and check that the arm stays at rest.

    Raises:
        ExecutionStopped: aborted, a fault, displaced, or too long; with the state.
    """
    control.require()
    if not control.paused:
        return
    with mars.guarded("pause"):
        place = mars.settled_counts()
        hold = Pause(mars, control, place)
        hold.begin(0.0)
        while not hold.over(dry=True):
            refuse_failure(mars.link, mars.status(), "pause")
            hold.take(mars.counts(), place)
            until = mars.clock.now() + POLL_S
            while control.paused and mars.clock.now() < until:
                mars.link.receive(until)
        hold.end(0)
