"""Draws preview.png, the page of a plan of scenes/task2.toml, arm-bodies.png, what of it is checked for contact, and
hoop.png, the hoop of scenes/hoop/c.toml on its wire.

All are made here, in Debian's chromium.

python docs/pictures/preview.py
"""

from __future__ import annotations

import io
import shutil
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image
from playwright.sync_api import Page, sync_playwright

from arm.io.storage import data_file
from cell.commands.plan_poses import plan_program_step
from cell.commands.preview import preview_file
from cell.commands.steps import look_step, plan_step
from cell.console import Console

HERE = Path(__file__).resolve().parent
SIZE = {"width": 1280, "height": 760}
SHOWN_S = 18.2  # of the plan
CHECKED_S = 6.2  # where the arm is stretched out
HOOP_S = 7.4  # where the ring is at the wire's upper corner
STEP = 6  # of a colour's 256: what the eye does not miss, and a picture of half the bytes
FLAGS = ["--no-sandbox", "--disable-gpu"]


def main() -> None:
    """Look, plan, preview, and a photograph of the page."""
    task, console = data_file("scenes/task2.toml"), Console()
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        look, plan, page_file = (Path(folder) / name for name in ("look.json", "plan.json", "plan.html"))
        look_step(task, None, None, look, None, console)
        plan_step(task, look, plan, None, console)
        preview_file(plan, task, page_file, console)
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        page = browser.new_page(viewport=SIZE)
        page.goto(page_file.as_uri())
        page.wait_for_timeout(3000)
        _show(page, SHOWN_S)
        _save(page.screenshot(), HERE / "preview.png")
        page.get_by_role("button", name="checked", exact=True).click()
        page.get_by_role("button", name="trace").click()
        page.get_by_role("button", name="side").click()
        _show(page, CHECKED_S)
        _save(page.locator("#stage").screenshot(), HERE / "arm-bodies.png")
        program = data_file("scenes/hoop/c.toml")
        plan_program_step(program, None, plan, None, console)
        preview_file(plan, program, page_file, console)
        page = browser.new_page(viewport=SIZE)
        page.goto(page_file.as_uri())
        page.wait_for_timeout(3000)
        _show(page, HOOP_S)
        _save(page.locator("#stage").screenshot(), HERE / "hoop.png")
        browser.close()


def _show(page: Page, seconds: float) -> None:
    """The page at a time of the plan."""
    page.wait_for_timeout(1000)
    page.evaluate(
        "s => { const slider = document.getElementById('slider'); slider.value = s;"
        " slider.dispatchEvent(new Event('input')) }",
        seconds,
    )
    page.wait_for_timeout(2000)


def _save(photograph: bytes, file: Path) -> None:
    colours = np.asarray(Image.open(io.BytesIO(photograph)).convert("RGB"), dtype=int)
    fewer = np.minimum((colours + STEP // 2) // STEP * STEP, 255).astype(np.uint8)
    Image.fromarray(fewer).save(file, optimize=True)


if __name__ == "__main__":
    main()
