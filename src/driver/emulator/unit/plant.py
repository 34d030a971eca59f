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
class ContactPlant(Plant, Protocol):
    """A plant that acts on jaws and arm: all methods are called like `jaws`."""

    def jaws_now(self, counts: tuple[int, ...], adc: int) -> int:
        """Return where jaws that stopped at `adc` are now: they close further when what they hold slips out."""

    def pushed_back(self, counts: tuple[int, ...]) -> tuple[int, ...]:
        """Return how far contact holds each axis from `counts`, where it would be without, as its encoder reads it."""
