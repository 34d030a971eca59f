"""Debian's chromium, driven by playwright."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest

from vision.camera.model import Image

if TYPE_CHECKING:  # tests run without playwright too
    from playwright.sync_api import Browser, Page

FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-background-networking", "--no-first-run"]
DEADLINE_MS = 60_000  # long, for machines that draw in software and do other things beside


def _missing() -> str:
    if shutil.which("chromium") is None:
        return "no chromium: apt-get install chromium"
    try:
        import playwright.sync_api  # noqa: F401
    except ImportError:
        return "no playwright: pip install 'a465[test]'"
    return ""


@contextmanager
def chromium() -> Iterator[Browser]:
    """A browser; skips the test without one, unless A465_REQUIRE_BROWSER is set (as in .ci/run)."""
    missing = _missing()
    if missing and os.environ.get("A465_REQUIRE_BROWSER"):
        pytest.fail(missing)
    if missing:
        pytest.skip(missing)
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        yield started
        started.close()


def complaints_of(page: Page) -> list[str]:
    """A list that gets every error of a page and whatever it says on its console."""
    complaints: list[str] = []
    page.on("pageerror", lambda error: complaints.append(str(error)))
    # Software drawing warns about its own speed when a screenshot is taken; errors are never excused.
    page.on(
        "console",
        lambda m: complaints.append(m.text) if m.type == "error" or "GPU stall" not in m.text else None,
    )
    return complaints


def require_fit(html: str, folder: Path, name: str) -> None:
    """Require that a page without programs fits into windows of 1280 and of 390 px, and complains of nothing."""
    file = folder / f"{name}.html"
    file.write_text(html)
    with chromium() as browser:
        for width in (1280, 390):
            page = browser.new_page(viewport={"width": width, "height": 844})
            complaints = complaints_of(page)
            page.goto(file.as_uri())
            assert page.evaluate("document.documentElement.scrollWidth") <= width
            assert complaints == []
            keep_screenshot(page, folder, f"{name}-{width}")


def until(page: Page, condition: str) -> None:
    """Ask until it is true. Playwright's own waiting evaluates text inside the page, which the page forbids."""
    deadline = time.monotonic() + DEADLINE_MS / 1e3
    while not _holds(page, condition):
        assert time.monotonic() < deadline, f"not within {DEADLINE_MS / 1e3:g} s: {condition}"
        page.wait_for_timeout(30)


def _holds(page: Page, condition: str) -> bool:
    from playwright.sync_api import Error

    try:
        return bool(page.evaluate(condition))
    except Error as error:
        if "context was destroyed" not in str(error):  # the page is being loaded anew
            raise
        return False


def picture_of(page: Page) -> Image:
    """What the canvas shows, with what stands over it, BGR."""
    page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    picture = page.locator("#stage").screenshot()
    return np.asarray(cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR), dtype=np.uint8)


def keep_screenshot(page: Page, folder: Path, name: str) -> None:
    """What the window shows, as ``name``.png in the folder that A465_SCREENSHOTS names, or else in `folder`."""
    kept = Path(os.environ.get("A465_SCREENSHOTS") or folder)
    kept.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=kept / f"{name}.png")
