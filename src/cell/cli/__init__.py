"""The command line: each command parses its options and calls `cell.commands`."""

from arm.former import former_names

former_names(__name__, "cell.cli.main", "app")
