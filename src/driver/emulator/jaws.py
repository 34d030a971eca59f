"""The gripper's analog servo axis: bounds of its own, stalls on an object, a target beyond its stroke is a force."""

from __future__ import annotations

import numpy as np

from arm.unit import GripperAxis
from driver.emulator.axis_motion import AxisMotion, brake, go_to
from driver.emulator.plant import Plant


class Jaws:
    """The jaws; positions are ADC counts.

    The generator runs to any target, while the jaws stop at an object or at the end of their stroke: so the unit's
    ``Rx!`` comes although the target is never reached.

    Args:
        gripper: the axis' figures.
        plant: what the jaws meet.
    """

    def __init__(self, gripper: GripperAxis, plant: Plant) -> None:
        self._low = min(gripper.open_adc, gripper.closed_adc)
        self._high = max(gripper.open_adc, gripper.closed_adc)
        self._plant = plant
        self._at = float(gripper.open_adc)
        self._stop_at = gripper.open_adc
        self._motion: AxisMotion | None = None
        self.busy_until = 0.0

    @property
    def busy(self) -> bool:
        """The generator runs."""
        return self._motion is not None

    def position(self) -> int:
        """Where the jaws are."""
        return round(self._at)

    def go(
        self, target: int, counts: tuple[int, ...], now_ms: int, speed: float, acceleration: float
    ) -> None:
        """Start towards a target with the arm at true `counts`; counts/ms and counts/ms^2."""
        inside = int(np.clip(target, self._low, self._high))
        self._stop_at = self._plant.jaws(counts, self.position(), inside)
        self._motion = go_to(now_ms, self._at, target, speed, acceleration)

    def stop(self, now_ms: int) -> None:
        """Brake."""
        if self._motion is not None:
            self._motion = brake(self._motion, now_ms)

    def freeze(self, now_ms: int) -> None:
        """No current any more: the gear holds the jaws where they are."""
        self._motion = None
        self.busy_until = float(now_ms)

    def advance(self, to_ms: int) -> None:
        """Execute up to a time."""
        if self._motion is None:
            return
        reference = float(self._motion.positions([to_ms])[0])
        closing = self._motion.cruise_speed < 0.0
        self._at = max(reference, self._stop_at) if closing else min(reference, self._stop_at)
        if self._motion.end_ms <= to_ms:
            self.busy_until = self._motion.end_ms
            self._motion = None
