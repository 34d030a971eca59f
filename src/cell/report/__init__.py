"""Reports of runs and calibrations: tables, HTML pages and JSON."""

from arm.former import former_names

former_names(__name__, "cell.report.cubes", "CubeRow", "print_rows", "judge_release")
