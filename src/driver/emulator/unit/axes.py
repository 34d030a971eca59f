"""Independent moves of single axes, and the gripper."""

from __future__ import annotations

import math
from dataclasses import dataclass

_SLOW = 0.05  # counts, and counts/ms: an axis this close to its target and this slow has arrived


@dataclass(eq=False)
class AxisMove:
    """A trapezoidal move of one axis to a target, or a constant speed for a time. One `tick` per millisecond.

    Attributes:
        at: present position, counts; at first the start.
        target: end, counts, or None for a constant speed.
        speed: counts/ms; signed for a constant speed.
        acceleration: counts/ms^2.
        left_ms: of a constant speed; infinite: until stopped.
    """

    at: float
    target: float | None
    speed: float
    acceleration: float
    left_ms: float = math.inf
    velocity: float = 0.0
    done: bool = False

    def __post_init__(self) -> None:
        self.at, self.acceleration = float(self.at), max(self.acceleration, 1e-3)

    def stop(self) -> None:
        """Brake to rest."""
        self.target, self.speed, self.left_ms = None, 0.0, 0.0

    def tick(self) -> None:
        """Advance by one millisecond."""
        a = self.acceleration
        if self.target is None:
            wanted = self.speed if self.left_ms > 0.0 else 0.0
            self.left_ms -= 1.0
        else:
            left = self.target - self.at
            brake = -a / 2.0 + math.sqrt(a * a / 4.0 + 2.0 * a * abs(left))
            wanted = math.copysign(min(abs(self.speed), brake, abs(left)), left)
        self.velocity += min(max(wanted - self.velocity, -a), a)
        self.at += self.velocity
        if self.target is None:
            self.done = self.left_ms <= 0.0 and self.velocity == 0.0
        elif abs(self.target - self.at) <= _SLOW and abs(self.velocity) <= a + _SLOW:
            self.at, self.done = float(self.target), True


class GripperJaws:
    """The gripper's analog axis. Its reference moves to any target; the jaws stop at an object or at their ends.

    Args:
        open_adc, closed_adc: ends of the stroke.
    """

    def __init__(self, open_adc: int, closed_adc: int) -> None:
        self._low, self._high = sorted((open_adc, closed_adc))
        self._at = float(open_adc)
        self._free = (self._low, self._high)  # range of the present move
        self.move: AxisMove | None = None

    @property
    def adc(self) -> int:
        """Position of the jaws."""
        return round(self._at)

    def within_stroke(self, target: float) -> int:
        """Return the nearest position that the jaws can reach."""
        return round(min(max(target, self._low), self._high))

    def go(self, target: float, stop_adc: int, speed: float, acceleration: float) -> None:
        """Start a move to a target. The jaws stop at `stop_adc`."""
        self._free = (min(self.adc, stop_adc), max(self.adc, stop_adc))
        self.move = AxisMove(self._at, target, speed, acceleration)

    def slip(self, adc: int) -> None:
        """Put resting jaws to where the plant has them."""
        if adc != self.adc:
            self._at = float(adc)

    def release(self) -> None:
        """Switch off the current. The jaws stay where they are (the drive is self-locking)."""
        self.move = None

    def tick(self) -> None:
        """Advance by one millisecond."""
        if self.move is None:
            return
        self.move.tick()
        low, high = self._free
        self._at = min(max(self.move.at, low), high)
        if self.move.done:
            self.move = None
