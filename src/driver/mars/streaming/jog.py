"""Jog: append short straight steps while keys are pressed, so that the arm rests soon after the last one.

The unit ends at rest at the last point that it has, and blends steps in the same direction (docs/sources.md,
"Coordinated motion", rows 12 to 14). So nothing has to be sent to end a motion: the arm stops by itself if this program
hangs or is killed. Before a step is sent, it is computed when the arm will be at rest with it. A step that would end
later than `REST_S` after its key arrived is not sent.

As in a stream, no step begins before its echo was compared (`driver.mars.lookahead`): from rest it waits behind a
dwell, and in motion it is sent early enough.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm.controller.segments import Segment
from arm.errors import ExecutionStopped, InputError
from driver.execution.rest import farthest
from driver.line.echo import Mismatch
from driver.line.link import ANSWER_S, NoAnswer, line_damaged
from driver.line.protocol import (
    BYTES_PER_SECOND,
    VERTEX_STEPS,
    Answer,
    MalformedAnswer,
    Reply,
    Status,
    encode,
    encode_dwell,
    encode_query,
    encode_segment,
    parse_position,
    parse_status,
)
from driver.line.unit_time import SLACK_S
from driver.mars.lookahead import ANSWERS_BYTES, BUSY_HOST_S, Needs
from driver.mars.ready import refuse_failure
from driver.mars.session import Session

REST_S = 0.38  # from the arrival of a key until the arm is at rest, at most
LEAST_STEP_S = 0.06  # shortest step: the line carries no more of them
RAMP_S = 0.03  # longest time from the speed of a step to rest
JITTER_S = 0.02  # allowance for a host that sends a step late
LEAST_DWELL_S = 0.02
POLL_S, IDLE_POLL_S = 0.2, 0.5  # between two polls, in motion and at rest
REPEAT_S, REPEAT_WALL_S = 0.5, 0.1  # an unanswered poll is repeated after this time, and this much wall time
STALL_S = 2.0  # a motion may take this much longer than computed
ASTRAY, ASTRAY_COUNTS = 2, 500  # samples in a row, and counts, off the steps that are being executed


@dataclass(frozen=True)
class _Motion:
    """Steps in one direction that the unit executes without a rest; times of the controller's clock, s.

    Attributes:
        direction: of its steps.
        begins: earliest beginning of its first step.
        ends: earliest end of its last step.
        rests: latest time at which the arm comes to rest.
    """

    direction: str
    begins: float
    ends: float
    rests: float


class Jog:
    """Sends steps on an initialised arm at rest. Use it inside `Mars.guarded`, and call `serve` all the time.

    Args:
        mars: the arm; its reference must be known (`Mars.anchor`).
        speed: limits of the axes, counts/s, (6,); set as registers while jogging.

    Attributes:
        end: counts at which all that was sent ends, (6,).
        steps: number of steps sent.

    Raises:
        InputError: the unit does not echo, so that a damaged step could not be noticed in time.
        ExecutionStopped: the arm is not ready.
    """

    def __init__(self, mars: Session, speed: Sequence[float]) -> None:
        if not mars.link.echoes:
            raise InputError(
                "jog: the unit does not echo, so a damaged step would move the arm; use a465 move"
            )
        if mars.reference is None:
            raise InputError("jog: the reference of the unit is not known; call anchor() first")
        self.mars, self._link = mars, mars.link
        self.end = mars.reference
        self.steps = 0
        registers = [
            max(1, min(int(256e-3 * v), r)) for v, r in zip(speed, mars.speed_registers, strict=True)
        ]
        self._before = mars.speed_registers
        mars.set_registers(registers, mars.acceleration_registers)
        self._speed = np.array(registers) * 1e3 / 256.0  # counts/s
        self._acceleration = np.array(mars.acceleration_registers) * 1e6 / 256.0  # counts/s^2
        mars.registers.tell(encode("COORDDISCONT", VERTEX_STEPS))
        mars.require_ready()
        self._motion: _Motion | None = None
        self._unverified: deque[tuple[int, float, str]] = deque()  # number, latest time to stop, line
        self._polled_at = mars.clock.now()
        self._unheard_since: float | None = None  # the first poll that is not answered yet
        self._asked = 0  # answers that are awaited
        self._astray = 0
        self._at = self.end  # the last sample
        self._low, self._high = np.array(self.end), np.array(self.end)  # box around what is being executed

    @property
    def moving(self) -> bool:
        """Whether the arm may move; False once it was found at rest at `end`."""
        return self._motion is not None

    def lasts_s(self, by: Sequence[int]) -> float:
        """Return the shortest duration of a step that keeps speed and ramp, s."""
        away = np.abs(np.asarray(by, dtype=float))
        ramp = float((away / self._acceleration).max()) / RAMP_S
        return max(LEAST_STEP_S, float((away / self._speed).max()), ramp)

    def step(self, by: Sequence[int], direction: str, asked_s: float, least_s: float = 0.0) -> bool:
        """Send a step if the arm is at rest in time with it; return whether it was sent.

        Args:
            by: displacement of the axes, (6,) counts.
            direction: steps with the same one are blended.
            asked_s: when the key arrived, controller clock.
            least_s: shortest duration.

        Raises:
            LinkLost, Aborted: as `Link.send`.
        """
        by = tuple(int(c) for c in by)
        lasts_ms = int(np.ceil(1e3 * max(self.lasts_s(by), least_s) - 1e-9))
        lasts = lasts_ms / 1e3
        ramp = float((np.abs(by) / self._acceleration).max()) / lasts
        target = tuple(a + b for a, b in zip(self.end, by, strict=True))
        line = encode_segment(Segment(lasts_ms, (by,)), target)
        now, motion = self._link.line_free_at, self._motion
        if motion is not None and motion.direction == direction:
            decided = now + (len(line) + 1) / BYTES_PER_SECOND + self._echo_s(len(line) + 1)
            due = motion.ends - self._needs(ramp).last_s(motion.ends - motion.begins)
            if decided + JITTER_S <= due:
                rests = motion.rests + lasts
                if rests > asked_s + REST_S:
                    return False
                self._send(line, due)
                self._motion = _Motion(direction, motion.begins, motion.ends + lasts, rests)
                self._done(target)
                return True
        return self._begin(line, direction, asked_s + REST_S, target, lasts, ramp)

    def _begin(
        self,
        line: str,
        direction: str,
        over: float,
        target: tuple[int, ...],
        lasts: float,
        ramp: float,
    ) -> bool:
        """Send a step behind a dwell, in which its echo is compared, if with it the arm is at rest by `over`."""
        now, motion, needs = self._link.line_free_at, self._motion, self._needs(ramp)
        axes = len(self.end)
        dwell_bytes, size = len(encode_dwell(1000, axes)) + 1, len(line) + 1
        arrives = now + dwell_bytes / BYTES_PER_SECOND
        decided = arrives + size / BYTES_PER_SECOND + self._echo_s(max(dwell_bytes, size))
        stands = arrives if motion is None else max(arrives, motion.ends)
        dwell = max(LEAST_DWELL_S, decided + JITTER_S + needs.last_s(0.0) - stands)
        rests = (arrives if motion is None else max(arrives, motion.rests)) + dwell + 1e-3 + lasts + ramp
        if rests > over:
            return False
        dwell_ms = int(np.ceil(1e3 * dwell))
        begins = stands + dwell_ms / 1e3
        self.mars.reference = None  # known again at rest
        due = begins - needs.last_s(0.0)
        self._send(encode_dwell(dwell_ms, axes), due)
        self._send(line, due)
        self._motion = _Motion(direction, begins, begins + lasts, rests)
        self._done(target)
        return True

    def _done(self, target: tuple[int, ...]) -> None:
        self.end = target
        self._low, self._high = np.minimum(self._low, target), np.maximum(self._high, target)
        self.steps += 1

    def _send(self, line: str, due: float) -> None:
        self._unverified.append((self._link.send(line), due, line))

    def _needs(self, ramp: float) -> Needs:
        return Needs(self._link.trip_s, self._link.stop_delivery_s, ramp)

    def _echo_s(self, size: int) -> float:
        """Time from the last byte of what is sent now to the end of its echo, behind echoes and answers before it."""
        trip = self._link.trip_s
        waiting = max(self._link.echo.unechoed_bytes - trip * BYTES_PER_SECOND, 0.0)
        answers = ANSWERS_BYTES if self._asked else 0
        return trip + (size + waiting + answers) / BYTES_PER_SECOND

    # -- while it moves

    def serve(self, until: float) -> None:
        """Take one reply, at latest until then, or return when the link is woken; check echoes, faults and position.

        Raises:
            LineDamaged: an echo differs or is late; the step has not begun.
            ExecutionStopped: a fault, a silent unit, or an arm that is not where it should be.
        """
        link, now = self._link, self._link.clock.now()
        every = POLL_S if self.moving else IDLE_POLL_S
        lost = self._asked and now >= self._polled_at + link.clock.at_least(REPEAT_S, REPEAT_WALL_S)
        if now >= self._polled_at + every and not self._unverified and (lost or not self._asked):
            self._polled_at, self._asked = now, 2
            self._unheard_since = now if self._unheard_since is None else self._unheard_since
            link.send(encode_query("COORDAP"))
            link.send(encode_query("ST"))
        due = self._unverified[0][1] if self._unverified else until
        reply = link.receive(max(min(until, due, now + every), now + 1e-3))
        while reply is not None:  # all that has come: the host may have been busy
            self._take(reply)
            reply = link.receive(link.clock.now())
        self._verify()
        now = link.clock.now()
        if self._unheard_since is not None and now > self._unheard_since + link.patience(ANSWER_S):
            raise NoAnswer(f"jog: no valid answer from the unit for {ANSWER_S:g} s", reason="silent")
        if self._motion is not None and now > self._motion.rests + link.patience(STALL_S):
            raise NoAnswer(f"jog: a step has not ended {STALL_S:g} s after its end", reason="deadline")

    def _verify(self) -> None:
        """Refuse to let a step begin whose echo has not come."""
        clock = self._link.clock
        while self._unverified and self._unverified[0][0] <= self._link.echo.verified:
            self._unverified.popleft()
        if not self._unverified:
            return
        _, due, line = self._unverified[0]
        if clock.now() >= due + clock.at_least(BUSY_HOST_S, BUSY_HOST_S) - BUSY_HOST_S:
            raise line_damaged(
                f"transmission error: no echo of {line!r} before it would begin", Mismatch(line, "")
            )

    def _take(self, reply: Reply) -> None:
        try:
            match reply:
                case Answer("COORDAP", text):
                    self._asked = max(self._asked - 1, 0)
                    position = parse_position(text, len(self.end))
                    if self._link.unit_time.jumped(
                        self._polled_at,
                        self._link.clock.now(),
                        position.time_ms,
                        self._link.patience(SLACK_S),
                    ):
                        self._link.restarted = True
                        refuse_failure(self._link, Status(0), "jog")
                    self._locate(position.counts)
                case Answer("ST", text):
                    self._asked = 0
                    self._unheard_since = None
                    self._judge(parse_status(text))
        except MalformedAnswer as error:  # the next poll counts
            self._asked = 0
            self.mars.note("damaged", text=str(error))

    def _locate(self, counts: tuple[int, ...]) -> None:
        """Compare a sample with the box around the steps that are being executed."""
        self._at = counts
        outside = np.maximum(self._low - counts, counts - self._high)
        worst = int(np.argmax(outside))
        self._astray = self._astray + 1 if outside[worst] > ASTRAY_COUNTS else 0
        if self._astray >= ASTRAY:
            axis = self.mars.unit.axes[worst]
            why = f"jog: axis {axis} is {int(outside[worst])} counts off its steps, must be at most {ASTRAY_COUNTS}"
            raise ExecutionStopped(why, axis=axis, counts=list(counts), reason="following")

    def _judge(self, status: Status) -> None:
        refuse_failure(self._link, status, "jog")
        motion, now = self._motion, self._link.clock.now()
        near = farthest(self._at, self.end) <= self.mars.unit.rest_tolerance
        if motion is not None and not status.busy and now >= motion.rests and near and not self._unverified:
            self._motion, self._low, self._high = None, np.array(self.end), np.array(self.end)
            self.mars.reference = self.end

    def finish(self) -> tuple[int, ...]:
        """Wait until the arm is at rest, and restore the speed registers; return its counts.

        Raises:
            ExecutionStopped: as `serve`; or it settled away from the end.
        """
        while self.moving:
            self.serve(self._link.clock.now() + POLL_S)
        counts = self.mars.arrived(self.end)
        self.mars.set_registers(self._before, self.mars.acceleration_registers)
        return counts
