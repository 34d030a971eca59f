"""The page of a refusal, written by the commands and opened in a real browser."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm.plan_file import read_plan
from pages.browsers import keep_screenshot, picture_of
from pages.preview import opened
from pages.refused import (
    Refusal,
    arm_in_a_post,
    arm_out_of_reach,
    program_beside_a_post,
    program_out_of_reach,
)
from plans.other_arms import scara_files
from typed.command_line import a465, ended, replace_in

SLAB = """
[[walls]]
name = "slab"
centre_mm = [520, -60, 230]
size_mm = [60, 60, 20]
"""
MOST_BYTES = 1_500_000
SIZES = ((1280, 800), (390, 844))
RED = "new THREE.Color(styleColour('warn')).getHexString()"
COLOURS = "[...a465.cell.named].map(([name, part]) => [name, part.material?.color.getHexString()])"
LABELS = "[...document.querySelectorAll('#marks text')].map((text) => text.textContent)"
BOXES = """[...document.querySelectorAll('#marks rect, #marks circle')].map((part) => {
    const [box, all] = [part.getBoundingClientRect(), document.getElementById('canvas').getBoundingClientRect()];
    const across = box.left >= all.left - 1 && box.right <= all.right + 1;
    return across && box.top >= all.top - 1 && box.bottom <= all.bottom + 1;
})"""


def refusal_of(folder: Path, *words: object) -> str:
    """What a refused command says after its first words."""
    code, told = ended(*words, cwd=folder)
    assert code == 3, told
    last = told.splitlines()[-1]
    assert last.startswith("a465: refused: ")
    return last.removeprefix("a465: refused: ")


def content_of(page: Path) -> dict[str, Any]:
    text = page.read_text().partition('<script id="content" type="application/json">')[2]
    found: dict[str, Any] = json.loads(text.partition("</script>")[0])
    return found


CASES = [arm_in_a_post, arm_out_of_reach, program_beside_a_post, program_out_of_reach]


@pytest.mark.slow
@pytest.mark.parametrize("make", CASES)
def test_a_refusal_is_shown_with_what_it_names(
    browser: Any, make: Callable[[Path], Refusal], tmp_path: Path
) -> None:
    asked, page = make(tmp_path), tmp_path / "refusal.html"
    sentence = refusal_of(tmp_path, *asked.words, "--page", page).removesuffix(f"; {page} shows it")
    assert page.stat().st_size <= MOST_BYTES
    for width, height in SIZES:
        with opened(browser, page, width, height) as shown:
            # what is printed may leave out its middle, because it also has the page's path
            head, _, tail = re.sub(r" +\.\. \d+ characters left out \.\. +", "\0", sentence).partition("\0")
            told = shown.locator("#refused").inner_text()
            assert told.startswith(f"refused {head}")
            assert told.endswith(tail)
            assert tail or told == f"refused {sentence}"
            assert shown.evaluate("document.documentElement.scrollWidth") <= width
            assert {*asked.pair, *filter(None, [asked.place])} <= set(shown.evaluate(LABELS))
            assert all(shown.evaluate(BOXES))
            red = shown.evaluate(RED)
            assert {name for name, colour in shown.evaluate(COLOURS) if colour == red} == set(asked.pair)
            assert shown.locator("#code").is_hidden()
            assert shown.locator("#close").is_visible()
            assert picture_of(shown).std() > 5
            keep_screenshot(shown, tmp_path, f"refusal-{make.__name__}-{width}")


@pytest.mark.slow
def test_the_misses_of_a_task_are_shown_one_by_one(
    browser: Any, planned_scenes: Path, tmp_path: Path
) -> None:
    """With a slab above a hole: each row bends the arm, names its bodies and brings the cube into the jaws or not."""
    scenes, page = Path(shutil.copytree(planned_scenes, tmp_path / "scenes")), tmp_path / "page.html"
    (scenes / "cell.toml").write_text((scenes / "cell.toml").read_text() + SLAB)
    words = (
        "plan",
        scenes / "task2.toml",
        "--look",
        scenes / "look.json",
        "--no-advice",
        "-o",
        tmp_path / "p.json",
    )
    refusal_of(tmp_path, *words, "--page", page)
    content = content_of(page)
    with opened(browser, page) as shown:
        rows = shown.locator("#list button")
        assert rows.count() == len(content["misses"]) > 3
        for number in (2, 0):
            rows.nth(number).click()
            miss, step = content["misses"][number], content["steps"][number]
            assert shown.evaluate("a465.marks.miss.way") == miss["way"]
            bent = shown.evaluate("a465.motion.q(a465.state.time)")
            at = content["joints"]
            q = (np.array(step["counts"]) - at["counts_at_zero"]) / at["counts_per_rad"]
            assert bent == pytest.approx(q.tolist(), abs=1e-9)
            assert shown.locator("#now b").inner_text() == f"{miss['where']}, {miss['way']}"
            red = shown.evaluate(RED)
            assert {name for name, colour in shown.evaluate(COLOURS) if colour == red} == set(miss["pair"])


@pytest.mark.slow
def test_a_place_is_marked_and_a_board_that_is_missing_is_looked_for(
    browser: Any, planned_scenes: Path, tmp_path: Path
) -> None:
    scenes, page = Path(shutil.copytree(planned_scenes, tmp_path / "scenes")), tmp_path / "page.html"
    words = ("plan", scenes / "task2.toml", "--no-advice", "-o", tmp_path / "p.json", "--page", page)
    seen = json.loads((scenes / "look.json").read_text())
    seen["scenes"][0]["boards"].pop()
    seen["scenes"][0]["missing"] = {"03-04": "only 1 of its markers is in the image"}
    (tmp_path / "half.json").write_text(json.dumps(seen))
    assert "was not found" in refusal_of(tmp_path, *words, "--look", tmp_path / "half.json")
    with opened(browser, page) as shown:
        assert "what the camera sees" in shown.evaluate(LABELS)
        assert shown.locator("#close").is_hidden()
    replace_in(scenes / "cell.toml", "top_z_mm = 0", "top_z_mm = 60")
    assert "holes were seen below" in refusal_of(tmp_path, *words, "--look", scenes / "look.json")
    with opened(browser, page) as shown:
        assert {f"01-02/{n}" for n in range(1, 5)} <= set(shown.evaluate(LABELS))


def test_what_is_planned_is_shown_too(tmp_path: Path) -> None:
    """So that no page of an earlier refusal is left."""
    arm, page = scara_files(tmp_path), tmp_path / "page.html"
    a465("plan", arm, tmp_path / "poses.json", "-o", tmp_path / "plan.json", "--page", page)
    content = content_of(page)
    assert "misses" not in content
    assert content["sha256"] == read_plan(tmp_path / "plan.json").sha256


def test_a_page_that_cannot_be_written_does_not_hide_the_refusal(tmp_path: Path) -> None:
    asked, page = arm_out_of_reach(tmp_path), tmp_path / "poses.json" / "page.html"
    told = refusal_of(tmp_path, *asked.words, "--page", page)
    assert "is out of reach" in told
    assert "it is not shown: " in told
    code, told = ended(*asked.words, "--page", asked.file, cwd=tmp_path)
    assert code == 2
    assert str(asked.file) in told
