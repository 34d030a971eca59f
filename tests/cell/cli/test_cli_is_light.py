"""Help answers at once because nothing heavy is imported for it; checked by what is imported, not by the clock."""

import json
import re
import subprocess
import sys

import pytest

from typed.command_line import a465

HEAVY = {
    "numpy",
    "scipy",
    "cv2",
    "pinocchio",
    "coal",
    "toppra",
    "qpsolvers",
    "daqp",
    "osqp",
    "piqp",
    "ruckig",
    "serial",
    "pypylon",
    "rich",
    "jinja2",
    "matplotlib",
    "pydantic",
}
VERBS = (
    "run",
    "look",
    "reach",
    "plan",
    "check",
    "preview",
    "execute",
    "status",
    "stop",
    "home",
    "park",
    "move",
    "gripper",
    "release",
    "teach",
    "snap",
    "emulate",
    "render",
    "export",
    "new-cell",
    "doctor",
    "calibrate camera",
    "calibrate hand-eye",
    "calibrate kinematic",
)


ALL_HELP = """
import json, sys
import cell.cli.main
for asked in json.loads(sys.argv[1]):
    sys.argv = ["a465", *asked, "--help"]
    try:
        cell.cli.main.main()
    except SystemExit as ended:
        assert not ended.code, asked
    print("|", *asked, "|", *sys.modules, "|")
"""


def test_help_imports_nothing_heavy() -> None:
    """One process gives all the help: what it imported for one verb is told with that verb, and with later ones."""
    asked = [[], *(verb.split() for verb in VERBS)]
    ran = subprocess.run(
        [sys.executable, "-c", ALL_HELP, json.dumps(asked)], capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stderr
    told = re.findall(r"^\|(.*?)\|(.*?)\|$", ran.stdout, flags=re.MULTILINE)
    assert [verb.split() for verb, _ in told] == asked
    for verb, modules in told:
        assert not {name.split(".")[0] for name in modules.split()} & HEAVY, verb


def test_the_rooms_import_nothing_heavy() -> None:
    code = "import sys, arm, plan, vision, driver, calib, cell; print(*sys.modules)"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not set(ran.stdout.split()) & HEAVY


def test_every_verb_has_an_example() -> None:
    for verb in VERBS:
        said, _ = a465(*verb.split(), "--help")
        usage, told = said.split("\n\n", 1)
        assert f"a465 {verb}" in usage
        assert f"a465 {verb}" in told
        assert max(map(len, said.splitlines())) <= 80


@pytest.mark.parametrize("of", [(), ("calibrate",)])
def test_the_list_of_verbs_is_told_whole_in_80_columns(of: tuple[str, ...]) -> None:
    code = f"import sys; sys.argv = ['a465', *{of!r}, '--help']\nfrom cell.cli.main import main\nmain()"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    listed = [line for line in said.partition("Options:")[2].splitlines() if re.match(r"  [a-z]", line)]
    assert len(listed) > 5
    assert all(re.match(r"  [a-z-]+ +[A-Z].*\.$", line) for line in listed), listed
    assert not any(line.endswith("...") for line in listed)
    assert max(map(len, said.splitlines())) <= 80
