"""Every byte between host and unit with its time, and the gate through which only questions pass."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from arm.errors import A465Error
from driver.line.clock import Clock
from driver.line.port import Port
from driver.record.questions import is_question

STEP, SENT, RECEIVED = "step", "sent", "received"
MOST_BYTES = 4_000_000  # received; half an hour of a full line is less


@dataclass(frozen=True)
class Event:
    """What happened at a time.

    Attributes:
        time_s: since the tape was begun, on the host's clock.
        kind: `STEP`, `SENT` or `RECEIVED`.
        data: the step's name, or the bytes, one character per byte (Latin-1).
    """

    time_s: float
    kind: str
    data: str


class Tape:
    """Events in their order. The port's thread adds what is received, so `events` only ever grows at its end."""

    def __init__(self, clock: Clock) -> None:
        self.events: list[Event] = []
        self.heard = ""  # all that was received
        self.heard_at = 0.0  # when the latest bytes came
        self._clock = clock
        self._begun = clock.now()

    def step(self, name: str) -> None:
        """What follows belongs to this step."""
        self._add(STEP, name)

    def sent(self, data: bytes) -> None:
        """Keep bytes that are about to be sent."""
        self._add(SENT, data.decode("latin-1"))

    def received(self, data: bytes) -> None:
        """Keep bytes that came.

        Raises:
            OSError: more than `MOST_BYTES` have come.
        """
        if len(self.heard) + len(data) > MOST_BYTES:
            raise OSError(f"flooded by more than {MOST_BYTES // 1_000_000} MB")
        text = data.decode("latin-1")
        self._add(RECEIVED, text)
        self.heard_at = self._clock.now()  # before the text, which another thread reads
        self.heard += text

    def _add(self, kind: str, data: str) -> None:
        self.events.append(Event(round(self._clock.now() - self._begun, 6), kind, data))


class QuestionPort:
    """A port that keeps all bytes on a tape and sends nothing but whole questions, whatever its user wants to send.

    Args:
        port: see `driver.line.port.Port`.
        tape: gets every byte.
    """

    def __init__(self, port: Port, tape: Tape) -> None:
        self.url = port.url
        self._port = port
        self._tape = tape

    def listen(self, deliver: Callable[[bytes], None], lose: Callable[[OSError], None]) -> None:
        """Keep what is received, and pass it on; see `Port.listen`."""

        def keep(data: bytes) -> None:
            self._tape.received(data)
            deliver(data)

        self._port.listen(keep, lose)

    @property
    def out_waiting(self) -> int:
        """Bytes written that have not left this host."""
        return self._port.out_waiting

    def write(self, data: bytes) -> None:
        """Send one whole question; raises one of `driver.line.port.PORT_ERRORS`.

        Raises:
            A465Error: it is none; nothing was sent.
        """
        line = data.decode("latin-1")
        if not line.endswith("\n") or not is_question(line[:-1]):
            raise A465Error(f"{line!r} not sent: a recording only asks", line=line)
        self._tape.sent(data)
        self._port.write(data)

    def reset_output_buffer(self) -> None:
        """Drop what has not left this host."""
        self._port.reset_output_buffer()

    def close(self) -> None:
        """Close the port."""
        self._port.close()
