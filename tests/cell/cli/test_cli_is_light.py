"""Help answers at once because nothing heavy is imported for it; checked by what is imported, not by the clock."""

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
    "ruckig",
    "serial",
    "pypylon",
    "rich",
    "jinja2",
    "matplotlib",
}
VERBS = (
    "run",
    "look",
    "reach",
    "plan",
    "plan-poses",
    "check",
    "preview",
    "execute",
    "emulate",
    "render",
    "export",
    "new-cell",
    "doctor",
    "calibrate camera",
    "calibrate hand-eye",
    "calibrate kinematic",
)


def _imported_by(arguments: list[str]) -> set[str]:
    code = (
        f"import sys; sys.argv = ['a465', *{arguments!r}]\n"
        "import cell.cli.main\n"
        "try:\n    cell.cli.main.main()\n"
        "finally:\n    print('|', *sys.modules)"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    return {name.split(".")[0] for name in ran.stdout.rsplit("|", 1)[1].split()}


@pytest.mark.parametrize(
    "arguments", [["--help"], *([*verb.split(), "--help"] for verb in VERBS)], ids=lambda a: "-".join(a[:2])
)
def test_help_imports_nothing_heavy(arguments: list[str]) -> None:
    assert not _imported_by(arguments) & HEAVY


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
    listed = said.split("Commands:\n")[1].strip("\n").splitlines()
    assert all(re.match(r"  [a-z-]+ +[A-Z].*\.$", line) for line in listed), listed
    assert not any(line.endswith("...") for line in listed)
    assert max(map(len, said.splitlines())) <= 80
