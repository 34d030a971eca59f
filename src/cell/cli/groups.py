"""How commands are made: their list in ``a465 --help`` by what a person wants to do, and options given once."""

from __future__ import annotations

import os
from copy import copy
from functools import cache
from itertools import pairwise
from typing import Any

from typer import Typer
from typer.core import TyperCommand, TyperGroup

from arm.errors import InputError

COMPLETING = "_A465_COMPLETE"  # set by a shell that asks for completions
GROUPS = {
    "Set up": ("new-cell", "doctor", "record", "calibrate"),
    "See": ("look", "snap", "status", "view", "compare"),
    "Plan": ("reach", "plan", "check", "preview", "certify", "teach"),
    "Move": ("run", "execute", "home", "park", "move", "jog", "gripper", "release", "stop"),
    "Tools": ("emulate", "render", "report", "runs", "export", "study"),
}


class GroupedCommands(TyperGroup):
    """A group whose help lists its commands under the headings of `GROUPS`."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write a section for each heading; a command of none is under the last."""
        known = [name for names in GROUPS.values() for name in names]
        left = [name for name in self.list_commands(ctx) if name not in known]
        width = max(map(len, self.commands), default=0)
        for heading, names in GROUPS.items():
            names = (*names, *left) if heading == list(GROUPS)[-1] else names
            rows = [(name.ljust(width), self.commands[name].get_short_help_str(200)) for name in names]
            with formatter.section(heading):
                formatter.write_dl(rows)


class OnceEach(TyperCommand):
    """A command that refuses an option whose value is given twice: of two values one would be passed over unseen; and
    one whose value is another option, as where a variable of the shell is not set.

    Options that collect their values, and flags, may be repeated. Help is printed all the same.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the command line.

        Raises:
            InputError: an option that has one value is given twice, or has another option as its value.
        """
        typed = list(args)
        _require_values(self.params, typed)
        rest = super().parse_args(ctx, args)
        if ctx.resilient_parsing:
            return rest
        order: list[Any] = [*self.make_parser(ctx).parse_args(args=typed)[2]]
        given: set[str] = set()
        for one in order:
            if one.param_type_name != "option" or one.multiple or one.is_flag or one.count:
                continue
            if one.opts[-1] in given:
                raise InputError(f"{one.opts[-1]}: is given twice", option=one.opts[-1])
            given.add(one.opts[-1])
        return rest


def _require_values(params: list[Any], typed: list[str]) -> None:
    options = [one for one in params if one.param_type_name == "option"]
    every = {name for one in options for name in one.opts}
    with_value = {name for one in options if not (one.is_flag or one.count) for name in one.opts}
    for option, word in pairwise(typed):
        if option in with_value and word.partition("=")[0] in every:
            why = f"{option} has no value: {word} after it is an option; is a variable of the shell not set?"
            raise InputError(why, option=option)


def built_for(app: Typer, arguments: list[str]) -> Typer:
    """The same commands, those that `arguments` do not name without their parameters, the named one as `OnceEach`.

    Typer makes the parameters of all commands before it looks for the one that is asked: half of the time until the
    help appears. Names and what the list of commands says of each stay. A shell that completes words asks about others
    than `arguments`, so all stay then.
    """
    if COMPLETING in os.environ:
        return app
    return _only(app, next((argument for argument in arguments if not argument.startswith("-")), None))


@cache
def _only(app: Typer, verb: str | None) -> Typer:
    light = copy(app)
    light.registered_commands = [_without_parameters(info, verb) for info in app.registered_commands]
    light.registered_groups = [_without_parameters(info, verb) for info in app.registered_groups]
    return light


def _without_parameters(info: Any, verb: str | None) -> Any:
    app = getattr(info, "typer_instance", None)
    name = app.info.name if app else info.name or info.callback.__name__
    light = copy(info)
    if name == verb:
        return _once_each(light)
    light.name = name
    if app:
        light.typer_instance = copy(app)
        light.typer_instance.registered_commands = []
    else:
        light.callback = _nothing
    return light


def _once_each(info: Any) -> Any:
    """The same command, or group of commands, whose options are given once."""
    app = getattr(info, "typer_instance", None)
    if app:
        info.typer_instance = copy(app)
        info.typer_instance.registered_commands = [_once_each(copy(one)) for one in app.registered_commands]
    else:
        info.cls = OnceEach
    return info


def _nothing() -> None:
    pass
