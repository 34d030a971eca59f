"""Motion of one axis by itself: trapezoids for ``G`` and ``HH``, constant speed for ``SPD``, braking.

Times are milliseconds of the unit's clock, positions counts, speeds counts/ms, accelerations counts/ms^2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from arm.se3 import Array


@dataclass(frozen=True)
class AxisMotion:
    """Accelerate, cruise, brake.

    Attributes:
        begin_ms: when it starts.
        start: position there.
        first_speed: speed there, signed.
        cruise_speed: signed.
        last_speed: signed; 0 unless the motion goes on for ever.
        acceleration: above 0.
        cruise_ms: time at cruise speed; may be infinite.
        homes: the position becomes 0 at its end.
    """

    begin_ms: int
    start: float
    first_speed: float
    cruise_speed: float
    last_speed: float
    acceleration: float
    cruise_ms: float
    homes: bool = False

    @property
    def _rise_ms(self) -> float:
        return abs(self.cruise_speed - self.first_speed) / self.acceleration

    @property
    def _fall_ms(self) -> float:
        return abs(self.last_speed - self.cruise_speed) / self.acceleration

    @property
    def end_ms(self) -> float:
        """When it is over."""
        return self.begin_ms + self._rise_ms + self.cruise_ms + self._fall_ms

    def positions(self, times_ms: npt.ArrayLike) -> Array:
        """Positions at times (m,)."""
        t = np.maximum(np.asarray(times_ms, dtype=float) - self.begin_ms, 0.0)
        t1 = np.minimum(t, self._rise_ms)
        t2 = np.clip(t - self._rise_ms, 0.0, self.cruise_ms)
        t3 = np.clip(t - self._rise_ms - self.cruise_ms, 0.0, self._fall_ms)
        up = math.copysign(self.acceleration, self.cruise_speed - self.first_speed)
        down = math.copysign(self.acceleration, self.last_speed - self.cruise_speed)
        rise = self.first_speed * t1 + 0.5 * up * t1**2
        fall = self.cruise_speed * t3 + 0.5 * down * t3**2
        return np.asarray(self.start + rise + self.cruise_speed * t2 + fall)

    def speed(self, time_ms: float) -> float:
        """Speed at a time, signed."""
        after, before = self.positions([time_ms + 0.5, time_ms - 0.5])
        return float(after - before)


def go_to(
    begin_ms: int, start: float, target: float, speed: float, acceleration: float, homes: bool = False
) -> AxisMotion:
    """From rest to rest in the shortest time."""
    distance = abs(target - start)
    peak = min(speed, math.sqrt(distance * acceleration))
    cruise_ms = (distance - peak**2 / acceleration) / peak if peak > 0.0 else 0.0
    signed = math.copysign(peak, target - start)
    return AxisMotion(begin_ms, start, 0.0, signed, 0.0, acceleration, max(cruise_ms, 0.0), homes)


def keep_speed(begin_ms: int, start: float, speed: float, acceleration: float, time_ms: float) -> AxisMotion:
    """At constant speed from rest for a time (its ramp included), then to rest; infinite time is for ever."""
    cruise_ms = max(time_ms - abs(speed) / acceleration, 0.0)
    return AxisMotion(begin_ms, start, 0.0, speed, 0.0, acceleration, cruise_ms)


def brake(motion: AxisMotion, now_ms: int) -> AxisMotion:
    """From where a motion is to rest."""
    speed = motion.speed(now_ms)
    start = float(motion.positions([now_ms])[0])
    return AxisMotion(now_ms, start, speed, speed, 0.0, motion.acceleration, 0.0)
