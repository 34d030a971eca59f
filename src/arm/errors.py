"""One tree of errors. Each carries its data and knows the exit code that a command ends with."""

from __future__ import annotations

from typing import Any

MOST_MESSAGE = 500  # characters of a message; what a file or a name puts into it may have any length
MOST_VALUE = 200  # characters of a value inside a message


def shortened(text: str, most: int = MOST_MESSAGE) -> str:
    """A text of at most `most` characters: its begin and its end, and between them how many were left out."""
    if len(text) <= most:
        return text
    room = most - len(f" .. {len(text)} characters left out .. ")
    end = room // 3
    out = len(text) - room
    return f"{text[: room - end]} .. {out} characters left out .. {text[-end:]}"


class A465Error(Exception):
    """Base of every error of this project.

    The message is one line for a person, of at most `MOST_MESSAGE` characters; `data` holds the same facts for a
    program.

    Args:
        message: what happened, with name, value, rule and what would help.
        **data: the facts of the message under their own names (SI units, JSON types).
    """

    exit_code = 1
    word = "refused"  # which a command's message begins with

    def __init__(self, message: str, **data: Any) -> None:
        super().__init__(shortened(message))
        self.data = data


class InputError(A465Error):
    """Something that a person gave is wrong: a file, a key, a value, a flag, a port."""

    exit_code = 2
    word = "wrong input"


class FileInputError(InputError):
    """A value in a file breaks a rule; the message names file, key, value and rule."""

    def __init__(self, file: object, key: str, value: object, rule: str, help: str = "") -> None:
        where = f"{file}: {key}" if key else f"{file}"
        shown = "" if value is None else f" = {shortened(repr(value), MOST_VALUE)}"
        super().__init__(
            f"{where}{shown}: {rule}" + (f" ({help})" if help else ""),
            file=str(file),
            key=key,
            value=value,
            rule=rule,
            help=help,
        )


class CameraError(InputError):
    """A camera gives no photographs that may be used.

    Args:
        camera: which, as its user named it.
        reason: why, in a word or two (docs/cameras.md lists them).
        rule: the message.
    """

    word = "no photographs"

    def __init__(self, camera: object, reason: str, rule: str, **data: Any) -> None:
        super().__init__(f"camera {camera}: {rule}", camera=str(camera), reason=reason, **data)


class ImpossibleError(A465Error):
    """The request is well formed but cannot be done; nothing has moved."""

    exit_code = 3


class ExecutionStopped(A465Error):
    """Motion stopped before its end; `data` says in which state the cell was left."""

    exit_code = 4
    word = "stopped"


class CalibrationRefused(A465Error):
    """A calibration is not good enough to be used; `data` says by how much."""

    exit_code = 5
