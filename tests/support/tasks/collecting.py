"""A collection of poses, fast, and what it says."""

from __future__ import annotations

from cell.console import Console
from cell.session.connection import WhichCell


class Heard(Console):
    """What a person would have read."""

    def __init__(self) -> None:
        super().__init__()
        self.told: list[str] = []

    def say(self, text: str = "") -> None:
        self.told.append(text)


FAST = WhichCell(speed=1.0, time_scale=100.0)
