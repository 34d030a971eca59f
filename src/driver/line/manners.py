"""How a unit speaks: whether it echoes what it receives, and whether its answers come in the middle of that.

Which of these a MARS-8 does is not known (fact sheet, section 1), so it is learnt anew at every opening, by ECHO and
STAMP alone.
"""

from __future__ import annotations

from dataclasses import dataclass

from driver.line.link import Link
from driver.line.protocol import Answer, Echoed, encode

ATTEMPTS = 3  # a bad line may lose ECHO or a stamp
BURST = 4  # stamps sent together, so that answers fall between echoes


@dataclass(frozen=True)
class Manners:
    """What was learnt.

    Attributes:
        echoes: lines come back after ``ECHO:1`` and only then.
        adapter: they come back after ``ECHO:0`` too: from what is between host and unit, so they prove nothing.
        takes_turns: echoes and answers come mixed.
        round_trip_s: between the last byte of a stamp and its echo, or its answer where nothing is echoed.
    """

    echoes: bool
    adapter: bool
    takes_turns: bool
    round_trip_s: float

    def describe(self) -> str:
        """One line for a person."""
        if self.echoes:
            mixed = ", mixed with its answers" if self.takes_turns else ""
            return f"the unit sends back what it receives{mixed}: damaged lines are noticed before they are executed"
        why = (
            "something between here and the unit sends everything back"
            if self.adapter
            else "the unit does not"
        )
        return (
            f"NO ECHO ({why}): a damaged line is noticed only when the arm is off its path, so clearances are "
            "not certain; a better line helps"
        )


def learn_manners(link: Link) -> Manners:
    """Find out, and set the link to it.

    Raises:
        NoAnswer, LinkLost: the unit says nothing any more.
    """
    link.echoes, link.takes_turns, link.echo.mixed = False, False, False
    link.echo.forget()
    adapter = all(_echoed(link, 0) for _ in range(ATTEMPTS))
    if adapter or not any(_echoed(link, 1) for _ in range(ATTEMPTS)):
        link.answer_trip_s = min(_set_echo(link, 0) for _ in range(ATTEMPTS))
        return Manners(False, adapter, False, link.answer_trip_s)
    link.echoes = True
    mixes = all(_mixes(link) for _ in range(2))  # a bad line spoils one
    link.takes_turns = mixes or link.echo.mixed  # by chance, one burst may come back whole
    link.synchronise(attempts=ATTEMPTS)  # from here on every line is awaited
    link.synchronise(attempts=ATTEMPTS)
    return Manners(True, False, link.takes_turns, link.echo.round_trip_s)


def _set_echo(link: Link, on: int) -> float:
    """Set it; the time from there to the answer of a stamp, s."""
    link.send(encode("ECHO", on))
    sent_s = link.line_free_at
    link.synchronise(attempts=ATTEMPTS)
    return link.clock.now() - sent_s


def _echoed(link: Link, on: int) -> bool:
    """Whether a stamp comes back. The next one's answer proves that all of it is here, in whatever order."""
    _set_echo(link, on)
    line = link.stamped
    link.synchronise(attempts=ATTEMPTS)
    return link.echo.came(line)


def _mixes(link: Link) -> bool:
    """Whether of a burst of stamps not every echo and every answer comes back as a whole line."""
    lines = [link.stamp() for _ in range(BURST)]
    wanted: set[object] = {Echoed(line) for line in lines}
    wanted |= {Answer("STAMP", line.partition(":")[2]) for line in lines}
    deadline = link.deadline(1.0)
    while wanted and link.clock.now() < deadline:
        wanted.discard(link.receive(deadline))
    link.synchronise(attempts=ATTEMPTS)
    return bool(wanted)
