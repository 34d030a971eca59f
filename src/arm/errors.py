"""Errors of this project. Each has data for programs and the exit code of commands that end with it."""

from __future__ import annotations

from typing import Any

from arm.credentials import hide_credentials

MOST_MESSAGE = 500  # characters of a message; names and values from files may have any length
MOST_VALUE = 200  # characters of a value inside a message


def shortened(text: str, most: int = MOST_MESSAGE) -> str:
    """Shorten a string to at most `most` characters: its beginning, the number of characters left out, and its end."""
    if len(text) <= most:
        return text
    room = most - len(f" .. {len(text)} characters left out .. ")
    end = room // 3
    out = len(text) - room
    return f"{text[: room - end]} .. {out} characters left out .. {text[-end:]}"


class A465Error(Exception):
    """Base of every error of this project.

    The message is one line of at most `MOST_MESSAGE` characters; `data` has the same facts for programs. Neither has
    credentials of a URL (`hide_credentials`).

    Args:
        message: what happened, with name, value, rule and what would help.
        **data: the facts of the message by name (SI units, JSON types).
    """

    exit_code = 1
    word = "refused"  # first word of a command's message

    def __init__(self, message: str, **data: Any) -> None:
        super().__init__(shortened(hide_credentials(message)))
        self.data: dict[str, Any] = {
            key: hide_credentials(v) if isinstance(v, str) else v for key, v in data.items()
        }


class InputError(A465Error):
    """An input of the user is wrong: a file, a key, a value, a flag, a port."""

    exit_code = 2
    word = "wrong input"


class FileInputError(InputError):
    """A value in a file breaks a rule; the message names file, key, value and rule."""

    def __init__(self, file: object, key: str, value: object, rule: str, help: str = "") -> None:
        value = hide_credentials(value) if isinstance(value, str) else value  # before it is shortened
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
    """A camera delivers no usable images.

    Args:
        camera: the user's name of the camera.
        reason: one of the reasons in docs/cameras.md.
        rule: the message.
    """

    word = "no photographs"

    def __init__(self, camera: object, reason: str, rule: str, **data: Any) -> None:
        super().__init__(f"camera {camera}: {rule}", camera=str(camera), reason=reason, **data)


class ImpossibleError(A465Error):
    """The request is well formed but cannot be done; nothing has moved."""

    exit_code = 3


class ExecutionStopped(A465Error):
    """Motion stopped before its end; `data` has the state of the cell."""

    exit_code = 4
    word = "stopped"


class NoAnswer(ExecutionStopped):
    """The controller did not answer in time."""


class LinkLost(ExecutionStopped):
    """The line to the controller is gone."""


class Aborted(ExecutionStopped):
    """An abort was requested (`driver.execution.control.Control`)."""


class CalibrationRefused(A465Error):
    """A calibration is not good enough to be used; `data` has the deviations."""

    exit_code = 5
