"""A chunk is written once, by whoever has it, and only by the program that asks."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from arm.errors import InputError
from cell.files.study import read_study
from cell.study.question.scratch import bundle_of
from cell.study.work.chunks import Store, chunks_of
from cell.study.work.worker import BUSY, compute
from studies.written import write_study


def test_a_chunk_is_written_or_sent_back(scenes: Path, tmp_path: Path) -> None:
    study = read_study(write_study(scenes, points=4))
    bundle = bundle_of(study)
    chunk, store = chunks_of(study, bundle)[0], Store(tmp_path)
    sent = compute(bundle, chunk, None)
    assert len(sent.splitlines()) == 4
    with store.claimed(chunk):
        assert compute(bundle, chunk, tmp_path) == BUSY
    assert compute(bundle, chunk, tmp_path) == ""
    assert store.read(chunk) == sent
    store.write(chunk, "as it was\n")
    assert compute(bundle, chunk, tmp_path) == ""
    assert store.read(chunk) == "as it was\n"


def test_another_version_of_the_program_computes_nothing(scenes: Path) -> None:
    study = read_study(write_study(scenes, points=4))
    bundle = replace(bundle_of(study), code="another")
    with pytest.raises(InputError, match="install the same versions"):
        compute(bundle, chunks_of(study, bundle)[0], None)


def test_a_study_with_the_same_name_and_files_is_another(scenes: Path) -> None:
    tables = []
    for seed in (1, 2):
        study = read_study(write_study(scenes, points=4, seed=seed))
        bundle = bundle_of(study)
        tables.append(compute(bundle, chunks_of(study, bundle)[0], None))
    assert tables[0] != tables[1]


def test_a_process_leaves_signals_to_its_program() -> None:
    """A run inside it hears none: its chunk is finished first."""
    code = """
import os, signal
from cell.study.work.worker import begin
from driver.line.signals import interruptible
begin(os.getppid())
with interruptible(ends=True):
    os.kill(os.getpid(), signal.SIGINT)
print("went on", end="")
"""
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, timeout=300)
    assert ran.stdout == b"went on"


@pytest.mark.slow
def test_a_process_ends_with_the_program_even_if_that_ended_before_it_began() -> None:
    code = (
        "import sys, time; from cell.study.work.worker import begin; begin(int(sys.argv[1])); time.sleep(3)"
    )
    for parent, ends in ((os.getpid(), b"slept"), (2**22, b"")):
        command = [sys.executable, "-c", f"{code}; print('slept', end='')", str(parent)]
        ran = subprocess.run(command, capture_output=True, check=True, timeout=300)
        assert ran.stdout == ends
