"""Chunks have names by what they depend on; one at a time is at each."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from cell.files.study import read_study
from cell.study.question.points import points_of
from cell.study.question.scratch import bundle_of
from cell.study.work.chunks import Store, chunks_of
from studies.written import YAW, X, write_study


def test_chunks_cover_all_points_once(scenes: Path) -> None:
    study = read_study(write_study(scenes, points=23, chunk=5))
    chunks = chunks_of(study, bundle_of(study))
    assert [n for c in chunks for n in range(c.first, c.first + c.count)] == list(range(23))
    assert len({c.name for c in chunks}) == len(chunks) == 5


def test_a_study_that_grows_keeps_what_it_has_unless_a_grid_varies(scenes: Path) -> None:
    """With a grid, the points have other numbers, and so other values."""
    noise = {"key": "noise_grey", "values": [1.0, 2.0]}
    for vary, kept in (([X, YAW], 4), ([X, noise], 0)):
        small, large = (read_study(write_study(scenes, vary, points=points, chunk=5)) for points in (23, 64))
        names = [{chunk.name for chunk in chunks_of(study, bundle_of(study))} for study in (small, large)]
        assert len(names[0] & names[1]) == kept
        if kept:
            assert points_of(large, 0, 20) == points_of(small, 0, 20)


def test_names_change_with_what_is_asked_with_files_and_with_the_program(scenes: Path) -> None:
    study = read_study(write_study(scenes, points=5, chunk=5))
    bundle = bundle_of(study)
    files = {**bundle.files, bundle.cell: b"other"}
    made = [
        chunks_of(one, of)[0].name
        for one, of in [
            (study, bundle),
            (replace(study, seed=9), bundle),
            (replace(study, stages=("look",)), bundle),
            (study, replace(bundle, code="other")),
            (study, replace(bundle, files=files)),
        ]
    ]
    assert len(set(made)) == len(made)
    assert chunks_of(study, bundle_of(study))[0].name == made[0]


def test_a_lock_of_one_that_was_killed_when_it_had_finished_is_removed(scenes: Path, tmp_path: Path) -> None:
    study = read_study(write_study(scenes, points=4, chunk=2))
    chunk, other = chunks_of(study, bundle_of(study))
    store = Store(tmp_path)
    store.write(chunk, "x\n")
    for one in (chunk, other):
        (store.folder / f"{one.name}.lock").touch()
    Store(tmp_path, tidy=False)
    assert len(list(store.folder.iterdir())) == 3
    Store(tmp_path)
    assert sorted(path.name for path in store.folder.iterdir()) == sorted([chunk.name, f"{other.name}.lock"])


def test_a_chunk_is_claimed_by_one_and_left_to_others_afterwards(scenes: Path, tmp_path: Path) -> None:
    study = read_study(write_study(scenes, points=5))
    chunk, store = chunks_of(study, bundle_of(study))[0], Store(tmp_path)
    with store.claimed(chunk) as mine, Store(tmp_path).claimed(chunk) as other:
        assert (mine, other) == (True, False)
        for _ in range(2):
            with Store(tmp_path).claimed(chunk) as another:
                assert not another
        store.write(chunk, "1,2\n")
    with store.claimed(chunk) as mine:
        assert mine
    assert store.has(chunk)
    assert store.read(chunk) == "1,2\n"
    assert [path.name for path in (tmp_path / "chunks").iterdir()] == [chunk.name]
