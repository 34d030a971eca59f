"""What the emulated gripper acts upon."""

from __future__ import annotations

from typing import Protocol


class Plant(Protocol):
    """What the gripper acts upon."""

    def jaws(self, counts: tuple[int, ...], from_adc: int, to_adc: int) -> int:
        """The jaws start from one position to another; where they stop, ADC counts.

        Called in the emulator's thread, with the arm's true counts in the homed convention.
        """
