"""Commands beside an arm, for a reader who has an emulated one and whom nobody can ask."""

from __future__ import annotations

ASKED = {  # commands that take the port as an argument, and the option that answers in advance
    **{"status": "", "stop": "", "teach": "", "home": "--free", "park": "--unseen", "gripper": "--unseen"},
    **{"release": "--supported", "move": "--unseen", "jog": "", "record": ""},
}
NEEDS_HOMED = ("park", "gripper", "teach", "move")


def answered(words: list[str]) -> list[str]:
    """The option that answers a command's question in advance, unless it is given."""
    option = ASKED[words[0]]
    return [option] if option and option not in words else []


def homing(words: list[str], port: str, speed: float) -> list[str]:
    """What homes the arm of a command that needs a homed one; empty if it needs none."""
    cell = next((word for word in words if word.endswith(".toml")), "")
    return ["home", cell, port, "--speed", f"{speed:g}"] if words[0] in NEEDS_HOMED else []
