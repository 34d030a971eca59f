"""Reports of runs and calibrations: tables, HTML pages and JSON."""

from typing import TYPE_CHECKING

from arm.former import FormerNames

if not TYPE_CHECKING:
    __getattr__ = FormerNames(__name__, "cell.report.cubes", "CubeRow", "print_rows", "judge_release")
