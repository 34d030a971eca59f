"""What the emulated gripper acts upon."""

from __future__ import annotations

from typing import Protocol, runtime_checkable


class Plant(Protocol):
    """The objects between the jaws."""

    def jaws(self, counts: tuple[int, ...], from_adc: int, to_adc: int) -> int:
        """Return where jaws that start to move between two positions stop, ADC counts.

        Called in the emulator's thread, with the arm's true counts in the homed convention.
        """


@runtime_checkable
class HoldingPlant(Plant, Protocol):
    """A plant in which jaws may lose what they hold: they then close further by themselves."""

    def jaws_now(self, counts: tuple[int, ...], adc: int) -> int:
        """Return where jaws that stopped at `adc` are now; called like `jaws`."""
