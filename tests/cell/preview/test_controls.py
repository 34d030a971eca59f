"""The preview's controls in a real browser: playing, seeking, views, and screens of other sizes."""

from __future__ import annotations

import numpy as np
import pytest

from pages.browsers import picture_of, until
from pages.preview import opened, time_of


@pytest.mark.slow
def test_play_pause_and_keys(browser, page_file) -> None:
    with opened(browser, page_file) as page:
        page.select_option("#rate", "5")
        page.click("#play")
        until(page, "a465.state.time > 2")
        page.keyboard.press("Escape")
        page.locator("#canvas").focus()
        page.keyboard.press(" ")
        assert page.evaluate("a465.state.playing") is False
        stopped = time_of(page)
        page.wait_for_timeout(200)
        assert time_of(page) == stopped
        page.evaluate("a465.seek(30)")
        page.keyboard.press("ArrowRight")
        assert time_of(page) == pytest.approx(31.0)
        page.keyboard.press("Shift+ArrowLeft")
        assert time_of(page) == pytest.approx(30.9)
        step = page.evaluate("a465.state.step")
        page.keyboard.press("ArrowDown")
        assert page.evaluate("a465.state.step") == step + 1
        page.keyboard.press("ArrowUp")
        assert page.evaluate("a465.state.step") == step
        page.keyboard.press("End")
        assert time_of(page) == pytest.approx(page.evaluate("a465.motion.duration"))
        page.keyboard.press(" ")  # from the end it starts anew
        until(page, "a465.state.time > 0 && a465.state.time < 20")


@pytest.mark.slow
def test_playing_ends_by_itself(browser, page_file) -> None:
    with opened(browser, page_file) as page:
        page.evaluate("a465.seek(a465.motion.duration - 0.5)")
        page.click("#play")
        until(page, "!a465.state.playing")
        assert time_of(page) == pytest.approx(page.evaluate("a465.motion.duration"))


@pytest.mark.slow
def test_seek_by_slider_plot_and_step(browser, page_file) -> None:
    with opened(browser, page_file) as page:
        duration = page.evaluate("a465.motion.duration")
        page.fill("#slider", str(round(duration / 2, 2)))
        assert time_of(page) == pytest.approx(duration / 2, abs=0.02)
        cursors = page.locator(".chart .cursor").all()
        assert [c.get_attribute("d").split(" ")[0] for c in cursors] == ["M500.0", "M500.0"]
        for chart in ("#joint-chart", "#clearance-chart"):
            box = page.locator(chart).bounding_box()
            page.mouse.click(box["x"] + box["width"] * 0.25, box["y"] + box["height"] / 2)
            assert time_of(page) == pytest.approx(duration / 4, rel=0.01)
            page.evaluate("a465.seek(0)")
        page.click("#list button:has-text('approach') >> nth=0")
        step = page.evaluate("a465.motion.steps[a465.state.step]")
        assert step["role"] == "approach"
        assert time_of(page) == pytest.approx(step["start"])
        assert page.locator("#list button[aria-current]").count() == 1
        assert "approach" in page.locator("#now").inner_text()


@pytest.mark.slow
def test_tabs_views_and_theme(browser, page_file) -> None:
    with opened(browser, page_file, scheme="dark") as page:
        background = page.evaluate("getComputedStyle(document.body).backgroundColor")
        page.click("#theme")
        assert page.evaluate("getComputedStyle(document.body).backgroundColor") != background
        for name, unit in (("velocity", "°/s"), ("acceleration", "°/s²"), ("position", "°")):
            page.click(f"#tabs button:has-text('{name}')")
            assert page.locator("#readout th").nth(1).inner_text() == unit
            assert page.locator("#joint-chart .curve").count() == 6
        before = picture_of(page).astype(int)
        page.click("#views button:has-text('top')")
        assert (np.abs(picture_of(page).astype(int) - before).max(axis=2) > 24).mean() > 0.1


@pytest.mark.slow
def test_readable_on_a_phone(browser, page_file) -> None:
    with opened(browser, page_file, 390, 844) as page:
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        for part in ("#stage", "#play", "#slider", "#joint-chart", "#list", "#code"):
            box = page.locator(part).bounding_box()
            assert box["x"] >= 0
            assert box["x"] + box["width"] <= 390
        assert page.locator("#stage").bounding_box()["height"] >= 300


@pytest.mark.slow
@pytest.mark.parametrize("width", [1900, 1280, 400])
def test_the_steps_label_covers_nothing_of_the_picture(browser, page_file, width: int) -> None:
    with opened(browser, page_file, width=width) as page:
        for time in (0.0, 12.0):
            page.evaluate(f"a465.seek({time})")
            picture, label = (page.locator(part).bounding_box() for part in ("#canvas", "#now"))
            assert label["y"] + label["height"] <= picture["y"]
            assert picture["height"] > 200
