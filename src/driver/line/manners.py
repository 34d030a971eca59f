"""How a unit echoes ("manners"): whether it sends back what it receives, and whether its answers interrupt the echo.

Which of these a MARS-8 does is not known (docs/sources.md, "What is not known of the controller"), so it is measured at
every opening, by ECHO and STAMP alone.
"""

from __future__ import annotations

from dataclasses import dataclass

from driver.line.link import Link
from driver.line.protocol import Answer, Echoed, encode

ATTEMPTS = 3  # a bad line may lose ECHO or a stamp
BURST = 4  # stamps sent together, so that answers come while lines are echoed


@dataclass(frozen=True)
class Manners:
    """How the unit echoes.

    Attributes:
        echoes: lines are echoed after ``ECHO:1`` and only then.
        adapter: lines are echoed after ``ECHO:0`` too. Then a device between host and unit echoes, which proves
            nothing.
        takes_turns: echoes and answers come interleaved, so the host has to wait for each in turn.
    """

    echoes: bool
    adapter: bool
    takes_turns: bool

    def describe(self) -> str:
        """Describe the echo in one line for the operator."""
        if self.echoes:
            mixed = ", interleaved with its answers" if self.takes_turns else ""
            return f"the unit echoes what it receives{mixed}: a damaged line is noticed before it is executed"
        why = (
            "a device between this computer and the unit echoes instead"
            if self.adapter
            else "the unit does not echo"
        )
        return (
            f"NO ECHO ({why}): a damaged line is noticed only once the arm has left its path, so the arm may hit "
            "something; use a better serial line"
        )


def learn_manners(link: Link) -> Manners:
    """Measure how the unit echoes, and configure the link for it.

    Raises:
        NoAnswer, LinkLost: the unit no longer answers.
    """
    link.echoes, link.takes_turns, link.echo.mixed = False, False, False
    link.echo.forget()
    adapter = all(_echoed(link, 0) for _ in range(ATTEMPTS))
    if adapter or not any(_echoed(link, 1) for _ in range(ATTEMPTS)):
        link.answer_trip_s = min(_set_echo(link, 0) for _ in range(ATTEMPTS))
        return Manners(False, adapter, False)
    link.echoes = True
    mixes = all(_mixes(link) for _ in range(2))  # a bad line may damage one burst
    link.takes_turns = mixes or link.echo.mixed  # a burst may come back whole by chance
    link.synchronise(attempts=ATTEMPTS)  # from here on every echo is checked
    link.synchronise(attempts=ATTEMPTS)
    return Manners(True, False, link.takes_turns)


def _set_echo(link: Link, on: int) -> float:
    """Switch the echo on or off. Return the time from there to the answer of a stamp, s."""
    link.send(encode("ECHO", on))
    sent_s = link.line_free_at
    link.synchronise(attempts=ATTEMPTS)
    return link.clock.now() - sent_s


def _echoed(link: Link, on: int) -> bool:
    """Whether a stamp is echoed. After the answer to the next one all of it has come, in whatever order."""
    _set_echo(link, on)
    line = link.stamped
    link.synchronise(attempts=ATTEMPTS)
    return link.echo.came(line)


def _mixes(link: Link) -> bool:
    """Whether any echo or answer to a burst of stamps does not come as a whole line."""
    lines = [link.stamp() for _ in range(BURST)]
    wanted: set[object] = {Echoed(line) for line in lines}
    wanted |= {Answer("STAMP", line.partition(":")[2]) for line in lines}
    deadline = link.deadline(1.0)
    while wanted and link.clock.now() < deadline:
        wanted.discard(link.receive(deadline))
    link.synchronise(attempts=ATTEMPTS)
    return bool(wanted)
