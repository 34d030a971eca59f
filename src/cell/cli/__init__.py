"""The command line: each command parses its options and calls `cell.commands`."""

from typing import TYPE_CHECKING

from arm.former import FormerNames

if not TYPE_CHECKING:
    __getattr__ = FormerNames(__name__, "cell.cli.main", "app")
