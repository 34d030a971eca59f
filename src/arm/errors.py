"""One tree of errors. Each carries its data and knows the exit code that a command ends with."""

from __future__ import annotations

from typing import Any


class A465Error(Exception):
    """Base of every error of this project.

    The message is one line for a person; `data` holds the same facts for a program.

    Args:
        message: what happened, with name, value, rule and what would help.
        **data: the facts of the message under their own names (SI units, JSON types).
    """

    exit_code = 1
    word = "refused"  # which a command's message begins with

    def __init__(self, message: str, **data: Any) -> None:
        super().__init__(message)
        self.data = data


class InputError(A465Error):
    """Something that a person gave is wrong: a file, a key, a value, a flag, a port."""

    exit_code = 2
    word = "wrong input"


class FileInputError(InputError):
    """A value in a file breaks a rule; the message names file, key, value and rule."""

    def __init__(self, file: object, key: str, value: object, rule: str, help: str = "") -> None:
        where = f"{file}: {key}" if key else f"{file}"
        shown = "" if value is None else f" = {value!r}"
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
