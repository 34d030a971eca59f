"""``a465`` and ``python -m a465``: the command line, after a check that Python finds the right packages."""

from __future__ import annotations

import json
import sys

from a465.shadowing import require_own_rooms

BAD_INPUT = 2


def main() -> None:
    """Run the command line."""
    try:
        require_own_rooms()
    except ImportError as error:
        if "--json" in sys.argv:
            report = {"kind": "ImportError", "message": str(error), "exit_code": BAD_INPUT}
            print(json.dumps({"error": report}, indent=2))
        print(f"a465: wrong input: {ascii(str(error))[1:-1]}", file=sys.stderr)
        sys.exit(BAD_INPUT)
    from cell.cli.start import main as run

    run()


if __name__ == "__main__":
    main()
