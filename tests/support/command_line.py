"""The command line as a user has it: its exit code, what it says, and files that the user changed."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path


def replace_in(path: Path, old: str, new: str) -> None:
    """Replaces the first `old` in a file, which has to be there."""
    text = path.read_text()
    assert old in text, old
    path.write_text(text.replace(old, new, 1))


def a465(
    *arguments: object, optimised: bool = False, code: int = 0, cwd: Path | None = None
) -> tuple[str, str]:
    """What a command says on its standard output and error; it has to end with `code` and without a traceback."""
    flags = ["-O"] if optimised else []
    command = [sys.executable, *flags, "-c", "import cell.cli; cell.cli.main()", *map(str, arguments)]
    ran = subprocess.run(command, capture_output=True, text=True, check=False, cwd=cwd, timeout=120)
    assert ran.returncode == code, f"exit {ran.returncode}: {ran.stdout[-2000:]}{ran.stderr[-4000:]}"
    assert "Traceback" not in ran.stderr
    return ran.stdout, ran.stderr


def refused(*arguments: object, code: int, cwd: Path) -> str:
    """The one line of a refusal, which optimised Python tells as well."""
    for optimised in (False, True):
        _, told = a465(*arguments, code=code, cwd=cwd, optimised=optimised)
    lines = [line for line in told.splitlines() if line.startswith("a465:")]
    assert len(lines) == 1, told
    return lines[0]
