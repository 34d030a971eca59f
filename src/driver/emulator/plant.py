"""What the jaws meet when they move: the emulator's only way to the world around the arm."""

from __future__ import annotations

from typing import Protocol


class Plant(Protocol):
    """The world that the gripper acts on."""

    def jaws(self, counts: tuple[int, ...], from_adc: int, to_adc: int) -> int:
        """The jaws start to move; called in the emulator's thread.

        Args:
            counts: where the arm truly is, (6,), 0 at the homing marks.
            from_adc: where the jaws are.
            to_adc: where they would go, inside their stroke.

        Returns:
            ADC position where they stop: `to_adc`, or short of it on an object.
        """
        ...


class FreeJaws:
    """A world with nothing in it."""

    def jaws(self, counts: tuple[int, ...], from_adc: int, to_adc: int) -> int:
        """The jaws always arrive."""
        return to_adc
