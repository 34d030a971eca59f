"""The verdict on a calibration: why it is refused, and further notes for a person."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, eq=False, kw_only=True)
class Judged:
    """A calibration with its verdict.

    Attributes:
        reasons: why it is refused; empty if it is accepted.
        remarks: further notes for a person.
    """

    reasons: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def accepted(self) -> bool:
        """Whether there is no reason to refuse it."""
        return not self.reasons
