"""A study changes copies of its files; a point's files are ones that every command reads."""

from __future__ import annotations

import re
import shutil
import tomllib
from pathlib import Path
from typing import Any

import pytest

from arm.errors import InputError
from cell.files.study import read_study
from cell.files.task import read_task
from cell.files.world import read_world
from cell.scene.fingerprint import plan_fingerprint
from cell.study.question.points import points_of
from cell.study.question.scratch import LIBRARIES, Scratch, bundle_of, code_digest, code_files, write_point
from studies.written import YAW, X, write_study
from typed.command_line import replace_in


def contents(folder: Path) -> dict[str, bytes]:
    """All files below a folder."""
    return {str(path): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


TOOL = {"file": "cell", "key": "tool.length_mm", "name": "tool", "values": [134.112, 140.0]}
SEED = {"file": "task", "key": "seed", "values": [0, 1]}


@pytest.mark.parametrize("absolute", [False, True])
def test_values_are_set_in_copies(scenes: Path, tmp_path: Path, absolute: bool) -> None:
    file = write_study(scenes, [TOOL, SEED, X, YAW], points=2)
    if absolute:
        replace_in(file, '"task2.toml"', f'"{scenes / "task2.toml"}"')
    study = read_study(file)
    before = contents(scenes)
    (tmp_path / "copy").mkdir()
    scratch = Scratch(bundle_of(study), tmp_path / "copy")
    values = points_of(study, 5, 1)[0]
    scratch.set(values)
    assert scratch.task.cell.gripper.length == pytest.approx(1e-3 * values[0])
    assert scratch.task.seed == values[1]
    stated = read_world(scratch.study.world, 0.036)
    assert (stated.boards[1].T_base_board == scratch.world.boards[1].T_base_board).all()
    assert contents(scenes) == before


def test_the_files_of_a_point_are_those_of_the_study(scenes: Path, tmp_path: Path) -> None:
    study = read_study(write_study(scenes, [TOOL, X], points=4))
    bundle = bundle_of(study)
    task_file = write_point(study, bundle, 6, tmp_path / "there")
    scratch_folder = tmp_path / "scratch"
    scratch_folder.mkdir()
    scratch = Scratch(bundle, scratch_folder)
    scratch.set(points_of(study, 6, 1)[0])
    assert not (tmp_path / "there" / bundle.study).exists()
    assert plan_fingerprint(read_task(task_file)) == plan_fingerprint(scratch.task)
    with pytest.raises(InputError, match="is there already"):
        write_point(study, bundle, 6, tmp_path / "there")
    for number in (-1, 8):
        with pytest.raises(InputError, match="must be 0 to 7"):
            write_point(study, bundle, number, tmp_path / "more")
    assert not (tmp_path / "more").exists()
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []


def test_what_the_results_depend_on_changes_the_digest(scenes: Path) -> None:
    study = read_study(write_study(scenes, points=2))
    before = bundle_of(study)
    replace_in(scenes / "cell.toml", "speed = 0.5", "speed = 0.4")
    after = bundle_of(study)
    assert before.digest != after.digest
    replace_in(scenes / "study.toml", "points", "# a remark\npoints")
    assert bundle_of(study).digest == after.digest


HEIGHT = {"file": "camera", "key": "pose.T_base_camera[2][3]", "from": 1.1, "to": 1.3}


def test_the_camera_of_the_cell_varies_too(scenes: Path, tmp_path: Path) -> None:
    study = read_study(write_study(scenes, [HEIGHT], points=4))
    before = contents(scenes)
    scratch = Scratch(bundle_of(study), tmp_path)
    for number in range(4):
        (height,) = points_of(study, number, 1)[0]
        scratch.set((height,))
        camera = scratch.task.cell.camera
        assert camera.T_base_camera[2, 3] == pytest.approx(height, abs=1e-9)
    assert contents(scenes) == before


def test_a_camera_that_is_not_looked_through_cannot_vary(scenes: Path) -> None:
    height = write_study(scenes / "realistic", [HEIGHT], points=4)
    with pytest.raises(InputError, match=r"cell\.toml: calibration must be left out: it replaces"):
        bundle_of(read_study(height))
    world = (scenes / "task2.world.toml").read_text()
    (scenes / "task2.world.toml").write_text(f'camera = "cameras/lab.toml"\n{world}')
    with pytest.raises(InputError, match=r"task2\.world\.toml: camera must be left out"):
        bundle_of(read_study(write_study(scenes, [HEIGHT], points=4)))


def test_files_that_values_name_go_along(scenes: Path, tmp_path: Path) -> None:
    """Of every value, not only that which the cell file has; and a change of any is another study."""
    text = (scenes / "cameras/lab.toml").read_text()
    (scenes / "cameras/other.toml").write_text(text.replace("1.19294", "1.29294"))
    vary = {"file": "cell", "key": "camera", "values": ["cameras/lab.toml", "cameras/other.toml"]}
    study = read_study(write_study(scenes, [vary]))
    bundle = bundle_of(study)
    assert "cameras/other.toml" in bundle.files
    scratch = Scratch(bundle, tmp_path)
    scratch.set(("cameras/other.toml",))
    assert scratch.task.cell.camera.T_base_camera[2, 3] == pytest.approx(1.29294, abs=1e-4)
    (scenes / "cameras/other.toml").write_text(text.replace("1.19294", "1.39294"))
    assert bundle_of(study).digest != bundle.digest


def test_a_value_that_names_no_file_is_told_at_once(scenes: Path) -> None:
    cameras = {"file": "cell", "key": "camera", "values": ["cameras/lab.toml", "cameras/lap.toml"]}
    with pytest.raises(InputError, match=r"camera .*names a file that does not exist: .*lap\.toml"):
        bundle_of(read_study(write_study(scenes, [cameras])))
    vary = {"file": "cell", "key": "background", "values": ["calibration.background.npz", "none.npz"]}
    with pytest.raises(InputError, match=r"none\.npz: cannot be read: No such file"):
        bundle_of(read_study(write_study(scenes / "realistic", [vary], stages=["look"])))


def test_the_background_of_the_camera_goes_along_with_a_look(scenes: Path) -> None:
    seed = {"file": "task", "key": "seed", "values": [0, 1]}
    for stages, there in ((["look"], True), (["run"], True), (["reach"], False)):
        study = read_study(write_study(scenes / "realistic", [seed], stages=stages))
        assert any(name.endswith("background.npz") for name in bundle_of(study).files) == there


@pytest.mark.parametrize("named", ["cameras/lab.toml", "boards/positions_plate_01-02.csv"])
def test_a_file_that_is_named_by_an_absolute_path_is_refused(scenes: Path, named: str) -> None:
    """A study would read it as it is then, and another machine its own."""
    replace_in(scenes / "cell.toml", f'"{named}"', f'"{scenes / named}"')
    with pytest.raises(InputError, match=rf"{named}: a study reads copies .* name it by a relative path"):
        bundle_of(read_study(write_study(scenes, [X], points=4)))


def test_a_file_that_a_value_names_by_an_absolute_path_is_no_value(scenes: Path, tmp_path: Path) -> None:
    vary = {"file": "cell", "key": "camera", "values": ["cameras/lab.toml", str(scenes / "cameras/lab.toml")]}
    (tmp_path / "copy").mkdir()
    scratch = Scratch(bundle_of(read_study(write_study(scenes, [vary]))), tmp_path / "copy")
    scratch.set(["cameras/lab.toml"])
    with pytest.raises(InputError, match="name it by a relative path"):
        scratch.set([str(scenes / "cameras/lab.toml")])


@pytest.mark.parametrize(
    ("names", "inside"),
    [
        ({"file": "task", "key": "cell", "values": ["cell.toml", "other.toml"]}, "cell"),
        ({"file": "cell", "key": "camera", "values": ["cameras/lab.toml", "cameras/other.toml"]}, "camera"),
    ],
)
def test_which_file_is_used_and_a_key_of_it_do_not_vary_together(
    scenes: Path, names: dict[str, Any], inside: str
) -> None:
    """Only the file that the task names has the values of a point: with another the table would say what was not so."""
    shutil.copy(scenes / "cell.toml", scenes / "other.toml")
    shutil.copy(scenes / "cameras/lab.toml", scenes / "cameras/other.toml")
    key = {
        "cell": TOOL,
        "camera": {k: v for k, v in HEIGHT.items() if k not in ("from", "to")} | {"values": [1.1, 1.3]},
    }
    with pytest.raises(InputError, match=f"says which {inside} file is used"):
        bundle_of(read_study(write_study(scenes, [names, key[inside]])))


def test_a_value_that_no_file_may_have_is_told_by_the_point(scenes: Path, tmp_path: Path) -> None:
    study = read_study(write_study(scenes, [{**X, "from": 400.0, "to": 2400.0}], points=8))
    scratch = Scratch(bundle_of(study), tmp_path)
    with pytest.raises(InputError, match="centre_mm"):
        scratch.set((9000.0,))


@pytest.mark.parametrize("values", [[-1.0, 140.0], [140.0, 4000.0]])
def test_a_study_is_asked_if_one_of_its_ends_can_be_read(scenes: Path, values: list[float]) -> None:
    vary = {"file": "cell", "key": "tool.length_mm", "values": values}
    bundle_of(read_study(write_study(scenes, [vary])))


def test_a_whole_number_that_is_sampled_is_told_to_need_steps(scenes: Path) -> None:
    study = write_study(scenes, [{"key": "seed", "from": 1, "to": 4}], points=4)
    with pytest.raises(InputError, match=r"must be a whole number .* is sampled, with fractions: give steps"):
        bundle_of(read_study(study))


@pytest.mark.parametrize("key", ["tool.lenght_mm", "tool.length_mm"])
def test_a_study_of_which_no_point_can_be_read_is_refused(scenes: Path, key: str) -> None:
    vary = {"file": "cell", "key": key, "from": 4000.0, "to": 5000.0}
    with pytest.raises(InputError) as told:
        bundle_of(read_study(write_study(scenes, [vary], points=8)))
    assert str(told.value).startswith(
        "study.toml: neither the first nor the last point has values that the files may have; "
        f"the last: cell.toml: {key} = 4"
    )


@pytest.mark.parametrize(
    ("vary", "told"),
    [
        (
            {"key": "tool.length_mm", "values": [134.0, 140.0]},
            r'cell\.toml has tool\.length_mm: write file = "cell"',
        ),
        (
            {"key": "unit", "values": ["crs93", "crs97"]},
            r'cell\.toml has unit: write file = "cell" into that',
        ),
        ({"key": "order", "values": ["free", "given"]}, r'task2\.toml has order: write file = "task"'),
        (
            {"key": "pose.T_base_camera[2][3]", "values": [1.1, 1.2]},
            r'lab\.toml has pose\..*: write file = "camera"',
        ),
        (
            {"file": "cell", "key": "boards[1].yaw_deg", "values": [1, 2]},
            r'task2\.world\.toml has .* file = "world"',
        ),
        ({"key": "tools.length_mm", "values": [134.0, 140.0]}, "write the table into the file first"),
    ],
)
def test_a_key_of_another_file_is_told_with_that_file(scenes: Path, vary: dict[str, Any], told: str) -> None:
    with pytest.raises(InputError, match=told):
        bundle_of(read_study(write_study(scenes, [X, vary], points=2)))


@pytest.mark.parametrize(
    ("values", "metres"),
    [
        ({"from": 0.43, "to": 0.49}, True),
        ({"values": [-0.43, 0.49, 0.6]}, True),
        ({"from": -0.5, "to": 500.0}, False),
        ({"from": 0.01, "to": 0.02}, False),
        ({"values": [0.46, 46.0]}, False),
    ],
)
def test_values_in_metres_of_a_key_in_mm_are_refused(
    scenes: Path, values: dict[str, Any], metres: bool
) -> None:
    study = read_study(
        write_study(scenes, [{"key": X["key"], **values}], **({"points": 2} if "to" in values else {}))
    )
    if metres:
        with pytest.raises(InputError, match=r"study.toml: .*centre_mm\[0\] is in mm: are these metres\?"):
            bundle_of(study)
    else:
        bundle_of(study)


def test_the_digest_is_of_all_packages_and_of_the_units() -> None:
    source = Path(__file__).resolve().parents[4] / "src"
    modules = {p for p in source.rglob("*.py") if p.relative_to(source).parts[0] not in ("a465", "cell")}
    assert len(modules) > 100
    assert modules <= set(code_files())
    assert source / "cell" / "study" / "work" / "stages.py" in code_files()
    assert any(path.name == "crs97.toml" for path in code_files())


def test_every_library_of_the_program_computes_or_only_reads_prints_and_talks() -> None:
    project = tomllib.loads((Path(__file__).resolve().parents[4] / "pyproject.toml").read_text())["project"]
    needed = {re.split(r"[ <>=]", one)[0] for one in project["dependencies"]}
    assert needed - set(LIBRARIES) == {"jinja2", "packaging", "pyserial", "rich", "svg.path", "typer"}
    assert set(LIBRARIES) <= needed


def test_the_digest_changes_with_a_file_and_with_a_library(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = tmp_path / "module.py"
    module.write_text("a = 1")
    monkeypatch.setattr("cell.study.question.scratch.code_files", lambda: [module])
    digests = [code_digest.__wrapped__()]
    module.write_text("a = 2")
    digests.append(code_digest.__wrapped__())
    monkeypatch.setattr("cell.study.question.scratch.version", lambda name: "another")
    digests.append(code_digest.__wrapped__())
    assert len(set(digests)) == 3
