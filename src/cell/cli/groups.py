"""The list of commands in ``a465 --help``, by what a person wants to do."""

from __future__ import annotations

from typing import Any

from typer.core import TyperGroup

GROUPS = {
    "Set up": ("new-cell", "doctor", "record", "calibrate"),
    "See": ("look", "snap", "status", "view", "compare"),
    "Plan": ("reach", "plan", "check", "preview", "certify", "teach"),
    "Move": ("run", "execute", "home", "park", "move", "jog", "gripper", "release", "stop"),
    "Tools": ("emulate", "render", "report", "runs", "export"),
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
