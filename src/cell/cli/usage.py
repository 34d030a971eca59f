"""What would help somebody who typed a command line that no command takes: where the words belong that were typed."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from arm.io.kind import kind_of_file

MOST_OWNERS = 3  # commands that are named because they have an option; one of more says nothing
# Options of other commands or programs, and what a command has instead.
ALIKE = {
    "--images": ("--camera",),
    "--camera": ("--images",),
    "--port": ("--link",),
    "--cell": ("--task",),
    "--speed": ("--time-scale",),
    "--force": ("--unseen", "--supported", "--free"),
    "--yes": ("--unseen", "--supported", "--free"),
    "--unseen": ("--supported", "--free"),
    "--free": ("--supported",),
    **dict.fromkeys(("--device", "--serial", "--tty"), ("--port",)),
}
SIMULATED = ("--dry-run", "--simulate", "--simulated", "--sim")
# Options of files, by `arm.io.kind.KINDS`.
KINDS = {"cell": "--cell", "task": "--task", "look": "--look", "world": "--world", "list": "--list"}
IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
WRITTEN = (".html", ".json", ".csv", ".mcap")
# What other programs call what a command of ours does.
ALSO = {
    **{
        "resume": "execute PLAN --resume",
        "simulate": "run TASK",
        "goto": "move CELL",
        "verify": "check PLAN TASK",
    },
    **dict.fromkeys(("abort", "halt", "estop"), "stop"),
    **dict.fromkeys(("open", "close", "grip", "grasp"), "gripper open|close|WIDTH CELL"),
    **dict.fromkeys(("init", "new", "create"), "new-cell FOLDER"),
    **dict.fromkeys(("show", "visualize", "visualise", "plot"), "preview PLAN TASK"),
    **dict.fromkeys(("plan-poses", "plan-list"), "plan CELL LIST"),
    **dict.fromkeys(("capture", "photo", "photograph"), "snap CELL"),
    **dict.fromkeys(("lens", "intrinsics", "intrinsic"), "calibrate camera IMAGES"),
    **dict.fromkeys(
        ("extrinsics", "extrinsic", "arm", "robot", "handeye", "hand_eye"), "calibrate hand-eye DATA"
    ),
    "nao": "calibrate kinematic DATA",
    **dict.fromkeys(("print", "charuco", "chessboard", "checkerboard"), "calibrate target"),
}
# What takes a file, by `arm.io.kind.KINDS`, that stands where the name of a calibration belongs.
CALIBRATIONS = {
    "recording": "hand-eye",
    "nao recording": "kinematic",
    "target": "target",
    "task": "background",
}
# Options that a command does not need, or has in another one.
ITSELF = {
    ("run", "--look"): "run looks itself; a look that is there is planned by a465 plan TASK --look FILE",
    ("plan", "--world"): "a look is made in a world: a465 look TASK --world FILE -o LOOK, then --look LOOK",
    ("reach", "--world"): "a look is made in a world: a465 look TASK --world FILE -o LOOK, then --look LOOK",
}
# Names that options of files have in other programs.
FILES = (
    "task",
    "cell",
    "plan",
    "program",
    "file",
    "input",
    "list",
    "poses",
    "log",
    "arm",
    "scene",
    "trajectory",
)
ROBOT = ("--urdf", "--srdf", "--robot-description")  # of an arm, which a file of ours names
FORMATS = ("csv", "trajectory", "mcap", "urdf")  # of an export
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)")


def usage_help(words: str, typed: Sequence[str], verbs: Sequence[str], commands: Mapping[str, Any]) -> str:
    """Return what would help, as a sentence part; "" if nothing is known.

    Args:
        words: of the parser, such as ``No such option: --port``.
        typed: the command line after the program's name.
        verbs: the command, (), or two words for one of a group.
        commands: all commands by their words, as click has them.
    """
    command = commands.get(" ".join(verbs))
    if (found := re.search(r"No such command '(.+?)'", words)) and found[1].lower() in ALSO:
        return f"it is a465 {ALSO[found[1].lower()]}"
    if found and (named := found[1].lower()) in {one.split()[0] for one in commands} - {found[1]}:
        return f"it is {named}, in small letters"
    if found and list(typed[:1]) == ["calibrate"] and (path := Path(found[1])).exists():
        takes = "camera" if path.is_dir() else CALIBRATIONS.get(kind_of_file(path), "")
        return f"what is calibrated comes first: a465 calibrate {takes or 'camera, hand-eye, ..'} {found[1]}"
    if found and found[1] == "help":
        return f"help is an option: a465 {' '.join(typed[1:2])} --help".replace("  ", " ")
    if found := re.search(r"No such option: (-\S+)", words):
        return _of_option(found[1].rstrip("."), typed, verbs, commands, command)
    if found := re.search(r"unexpected extra arguments?(?:\(s\))? \((.*)\)", words):
        return _of_extra(found[1].split(), typed, command)
    if found := re.search(r"'([-+]?\d+),(\d+)' is not a valid float", words):
        return f"the decimal sign is a point: {found[1]}.{found[2]}"
    if found := re.search(rf"'({_NUMBER.pattern})\s*[a-zA-Z°%]+' is not a valid (?:float|int)", words):
        return f"give the number alone, such as {found[1]}; the help states its unit"
    return ""


def _of_option(
    option: str, typed: Sequence[str], verbs: Sequence[str], commands: Mapping[str, Any], command: Any
) -> str:
    if re.match(r"-[\d.]", option):
        at = next((k for k, word in enumerate(typed) if word.startswith(option)), 0)
        if command and not any(word.startswith("--") for word in typed[:at]):
            return f"a word that begins with - is taken for an option; {' '.join(verbs)} takes no negative number there"
        return "the values of a list are joined by commas: --q=0,10,-80,0,-60,0"
    if option in ("-h", "-help", "-?"):
        return f"it is {' '.join(('a465', *verbs))} --help"
    if (known := (" ".join(verbs), option)) in ITSELF:
        return ITSELF[known]
    for word in typed:  # of a word with one dash the parser names a letter
        if re.match(r"-[a-zA-Z]", word) and (long := f"-{word.partition('=')[0]}") in _options(command):
            return f"it is {long}"
    if not verbs:
        named = next((word for word in typed if word in commands), "")
        if named and option in _options(commands[named]):
            return f"{option} stands after the command: a465 {named} ... {option}"
        return ""
    if option in ROBOT:
        return "an arm file names URDF and SRDF, as arm.urdf and arm.srdf; give that file"
    name = option.lstrip("-").replace("-", "_")
    if name in FORMATS and "--format" in _options(command):
        return f"it is --format {name}"
    arguments = [one for one in (command.params if command else ()) if one.param_type_name == "argument"]
    metavars = [one.make_metavar(None) for one in arguments]
    usage = " ".join(["a465", *verbs, *(one.upper() if one.islower() else one for one in metavars)])
    if any(name in _names(one) for one in arguments) or (
        name in FILES and re.search("FILE|TASK|CELL|PLAN", usage)
    ):
        return f"{name} is an argument and has no option: {usage}"
    if other := next((one for one in ALIKE.get(option, ()) if one in _options(command)), ""):
        return f"it is {other} here"
    if option in SIMULATED and "--port" in _options(command):
        return "without --port the simulated cell is used"
    owners = [name for name, one in commands.items() if option in _options(one)]
    return f"{option} belongs to {', '.join(owners)}" if 0 < len(owners) <= MOST_OWNERS else ""


def _of_extra(extra: Sequence[str], typed: Sequence[str], command: Any) -> str:
    before = typed[: max((k for k, word in enumerate(typed) if word == extra[0]), default=0)]
    option, _, first = "=".join(before[-1:] if "=" in "".join(before[-1:]) else before[-2:]).partition("=")
    if option.startswith("--") and all(_NUMBER.fullmatch(word) for word in (first, *extra)):
        return f"the values of a list are joined by commas: {option}={','.join((first, *extra))}"
    if len(extra) > 1 and all(Path(word).is_file() for word in extra):
        return "one file belongs here: did the shell replace a * by several?"
    options = _options(command)
    if "--images" in options and (folder := next((word for word in typed[1:] if Path(word).is_dir()), "")):
        return f"a folder of images is given by --images {folder}"
    for word in extra:
        kind = kind_of_file(Path(word)) if Path(word).is_file() else ""
        if (option := KINDS.get(kind, "")) in options:
            return f"a {kind} is given by {option} {word}"
        if word.lower() in FORMATS and "--format" in options:
            return f"it is --format {word.lower()}"
        if kind == "plan" and "PLAN" not in _metavars(command):
            return f"a plan is executed by a465 execute {word} TASK"
        if "--images" in options and Path(word).suffix.lower() in IMAGES:
            return f"--images takes the folder of the images: --images {Path(word).parent}"
        if "--output" in options and Path(word).suffix.lower() in WRITTEN and kind in ("", "samples"):
            return f"what is written is given by -o {word}"
        if "--unit" in options and re.fullmatch(r"crs\d+", word.lower()):
            return f"a unit is given by --unit {word}"
    ports = [word for word in typed if word.startswith("socket:") or Path(word).is_char_device()]
    if ports and "--port" in options and "--port" not in typed:
        return f"the port is given by --port {ports[0]}"
    takes = command and any("PORT" in one for one in _metavars(command))
    return f"{typed[0]} opens no port" if ports and not takes and "--port" not in options else ""


def _names(argument: Any) -> set[str]:
    """What a person may call an argument: its parameter, or a word of the help."""
    return {argument.name, *re.findall(r"\w+", str(argument.metavar).lower())} - {"open", "close"}


def _metavars(command: Any) -> set[str]:
    return {str(one.metavar) for one in (command.params if command else ())}


def _options(command: Any) -> set[str]:
    return {option for one in (command.params if command else ()) for option in one.opts}
