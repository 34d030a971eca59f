"""Every module of src has its test at its place, or decides nothing and stands in a list with what it is."""

from __future__ import annotations

import ast
import re
from pathlib import Path

TESTS = Path(__file__).parent
SRC = TESTS.parent / "src"
MOST_LINES, MOST_FILES, MOST_WITHOUT = 400, 12, 60

DECIDES_NOTHING = {
    "arm/controller/unit_keys.py": "declares keys of a unit's file; arm.io.keys checks them",
    "arm/robot/dh.py": "numbers of the A465 from its data sheet; test_link_errors compares them with the URDF",
    "calib/camera/result.py": "plain data of a calibration and its limits; calibrate and verdict decide",
    "calib/model/verdict.py": "plain data: reasons and remarks; camera, chain and NAO judge",
    "cell/accuracy/budget_report.py": "text and JSON of error budgets; test_plan_budgets reads them",
    "cell/cli/calibrate.py": "declares commands and their options; the steps behind them are tested",
    "cell/cli/main.py": "declares commands and their options; the steps behind them are tested",
    "cell/cli/manual.py": "declares commands and their options; the steps behind them are tested",
    "cell/cli/tools.py": "declares commands and their options; the steps behind them are tested",
    "cell/commands/calibration/options.py": "declares options that the calibrations share",
    "cell/commands/check.py": "hands a file to check_scene or to plan.verify",
    "cell/commands/preview.py": "hands a file to of_plan or to of_log",
    "cell/commands/render.py": "calls the renderer and writes images",
    "cell/commands/steps.py": "reads, calls observe, reach and plan, writes and prints",
    "cell/commands/report.py": "reads, prints and writes; test_runs runs the command",
    "cell/config/cell_values.py": "declares keys of a cell file; arm.io.keys checks them",
    "cell/files/world_errors.py": "declares keys of a world file; arm.io.keys checks them",
    "cell/report/verdict_text.py": "words of a report",
    "cell/scene/bodies.py": "boxes of plates, stands and cubes from their drawings",
    "cell/scene/options.py": "copies values of cell and task into options; test_cell_file and test_task read them",
    "cell/session/observer.py": "an observer that does nothing; others override it",
    "cell/sim/release_faults.py": "a table of poses of cubes that were released badly",
    "cell/scene/fingerprint.py": "copies hashes and values of task and cell; test_plan_matches compares them",
    "cell/study/work/outcome.py": "plain data: a row of a study's table",
    "cell/texts/key_texts.py": "words for keys; test_docs_formats and test_new_cell compare what they make",
    "driver/emulator/options.py": "plain data: what is not known of the real unit",
    "driver/emulator/unit/plant.py": "a protocol without code",
    "driver/execution/controller.py": "a protocol without code",
    "driver/execution/progress.py": "plain data: options, progress and result of a stream",
    "plan/program/goals/linear_move.py": "plain data: a line or path of a chain, with its role and target",
}


def _modules() -> list[str]:
    found = (path.relative_to(SRC) for path in SRC.rglob("*.py"))
    return sorted(path.as_posix() for path in found if not path.name.startswith("__"))


def _test_of(module: str) -> Path:
    path = TESTS / module
    return path.with_name(f"test_{path.name}")


def test_a_module_has_its_test_or_decides_nothing() -> None:
    tested = {module for module in _modules() if _test_of(module).exists()}
    assert sorted(set(_modules()) - tested - set(DECIDES_NOTHING)) == []
    assert sorted(tested & set(DECIDES_NOTHING)) == []


def test_the_list_is_short_and_of_modules_that_there_are() -> None:
    assert len(DECIDES_NOTHING) <= MOST_WITHOUT
    assert set(DECIDES_NOTHING) <= set(_modules())
    assert all(DECIDES_NOTHING.values())


def test_files_and_folders_of_tests_are_as_small_as_those_of_src() -> None:
    files = [path for path in TESTS.rglob("*.py") if path.name not in ("__init__.py", "conftest.py")]
    lines = {path: len(path.read_text().splitlines()) for path in files}
    assert [str(path.relative_to(TESTS)) for path, n in lines.items() if n > MOST_LINES] == []
    counts = {path.parent: 0 for path in files}
    for path in files:
        counts[path.parent] += 1
    assert {str(folder.relative_to(TESTS)): n for folder, n in counts.items() if n > MOST_FILES} == {}


def test_the_planner_names_no_maker_of_controllers() -> None:
    found = [
        path for path in (SRC / "plan").rglob("*.py") if re.search("mars|crs|pikron", path.read_text(), re.I)
    ]
    assert found == []


def test_no_docstring_has_a_word_that_the_pages_take_for_a_link() -> None:
    """A word that ends with an underscore is a reference in reStructuredText; `make docs` fails for it."""
    for file in sorted(SRC.rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)):
                text = re.sub(r"``.*?``|`.*?`", "", ast.get_docstring(node) or "", flags=re.DOTALL)
                assert not re.findall(r"\b\w+_(?![\w{])", text), f"{file.relative_to(SRC)}: {text}"
