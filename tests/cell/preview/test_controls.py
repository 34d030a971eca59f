"""The preview's controls in a real browser: playing, seeking, views, and screens of other sizes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm.plan_file import Move
from arm.se3 import inverse
from cell.export.timeline import timed_steps
from cell.preview.page import write_preview
from pages.browsers import picture_of, until
from pages.preview import CAMERA, opened, time_of


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


@pytest.mark.slow
def test_the_body_below_the_pointer_is_named(browser, page_file, preview_case) -> None:
    with opened(browser, page_file) as page:
        box = page.locator("#canvas").bounding_box()
        found = {}
        for board in preview_case.boards:
            corner = board.T_base_board[:3, 3] + board.T_base_board[:3, :3] @ [0.0, 0.0, 0.0]
            u, v = page.evaluate(
                """(p) => { const v = new THREE.Vector3(...p).project(a465.stage.camera); return [v.x, v.y]; }""",
                corner.tolist(),
            )
            page.mouse.move(box["x"] + (u + 1) / 2 * box["width"] + 3, box["y"] + (1 - v) / 2 * box["height"])
            found[board.board.name] = page.locator("#tip").inner_text()
            assert page.locator("#tip").is_visible()
        page.mouse.move(5, 5)
        assert not page.locator("#tip").is_visible()
        page.mouse.move(box["x"] + 3, box["y"] + 3)  # nothing is there
        assert not page.locator("#tip").is_visible()
    for name, told in found.items():
        assert told.startswith(f"plate {name}"), found


@pytest.mark.slow
def test_boards_and_holes_are_labelled_where_they_are_and_not_over_the_inset(
    browser, page_file, preview_case
) -> None:
    with opened(browser, page_file) as page:
        assert page.locator("#labels text").count() == 0
        page.click("#views button:has-text('labels')")
        texts = page.locator("#labels text").all_text_contents()
        assert texts == ["01-02", "1", "2", "3", "4", "03-04", "1", "2", "3", "4"]
        for board in range(2):
            place = preview_case.boards[board]
            for hole in range(4):
                at = (place.T_base_board @ [*place.board.holes[hole][:2], 0.0, 1.0])[:3]
                u, v = page.evaluate(
                    "(p) => { const v = new THREE.Vector3(...p).project(a465.stage.camera); return [v.x, v.y]; }",
                    at.tolist(),
                )
                canvas = page.locator("#canvas").bounding_box()
                label = page.locator("#labels text").nth(5 * board + 1 + hole).bounding_box()
                assert label["x"] + label["width"] / 2 == pytest.approx(
                    canvas["x"] + (u + 1) / 2 * canvas["width"], abs=2
                )
                assert label["y"] + label["height"] / 2 == pytest.approx(
                    canvas["y"] + (1 - v) / 2 * canvas["height"], abs=5
                )
        page.click("#views button:has-text('camera')")
        page.click("#larger")  # now it is over the boards
        until(page, "document.querySelectorAll('#labels text').length < 10")


@pytest.mark.slow
def test_ghosts_stand_where_the_step_begins_and_ends(browser, page_file, preview_case) -> None:
    case = preview_case
    with opened(browser, page_file) as page:
        page.click("#views button:has-text('ghosts')")
        for timed in [s for s in timed_steps(case.plan) if isinstance(s.step, Move)][:3]:
            page.evaluate("(t) => a465.seek(t)", 0.5 * (timed.start_s + timed.end_s))
            for name, end in (("past", 0), ("future", -1)):
                q = case.unit.positions(timed.step.path.knots()[end])
                page.evaluate("a465.cell.scene.updateMatrixWorld(true)")
                drawn = page.evaluate(f"a465.cell.ghosts.{name}.slice(-1)[0].matrixWorld.elements")
                expected = case.robot_open.joint_poses(q)[-1]
                assert np.abs(np.reshape(drawn, (4, 4)).T - expected).max() < 1e-6
                assert page.evaluate(f"a465.cell.ghosts.{name}[0].visible")
        page.click("#views button:has-text('ghosts')")
        assert not page.evaluate("a465.cell.ghosts.past[0].visible || a465.cell.ghosts.future[0].visible")


@pytest.mark.slow
def test_the_photograph_lies_over_what_the_camera_sees(browser, preview_case, tmp_path: Path) -> None:
    """A point of the cell is drawn where the camera's own model puts it, and so where the photograph shows it."""
    case, page_file = preview_case, tmp_path / "plan.html"
    image = np.full((1200, 1920), 60, np.uint8)
    arms = case.plan, case.robot_open, case.robot_holding, case.unit
    boards = [place.board for place in case.boards]
    write_preview(*arms, page_file, boards=boards, camera=CAMERA, photograph=image)
    assert page_file.stat().st_size < 1.5e6
    with opened(browser, page_file) as page:
        assert not page.locator("#seen").is_visible()
        page.click("#views button:has-text('camera')")
        assert page.locator("#seen").is_visible()
        assert page.locator("#photograph").is_visible()
        box = page.locator("#seen").bounding_box()
        assert box["width"] / box["height"] == pytest.approx(1.6, rel=0.02)
        for place in case.boards:
            at = place.T_base_board[:3, 3]
            u, v = page.evaluate(
                "(p) => { const v = new THREE.Vector3(...p).project(a465.seen.camera); return [v.x, v.y]; }",
                at.tolist(),
            )
            expected = CAMERA.project((inverse(CAMERA.T_base_camera) @ [*at, 1.0])[:3])
            assert [(u + 1) / 2 * 1920, (1 - v) / 2 * 1200] == pytest.approx(expected, abs=0.05)
        dark, light = [], []
        for share, kept in (("1", dark), ("0", light)):
            page.fill("#blend input", share)
            page.wait_for_timeout(100)
            part = picture_of(page)
            whole = page.locator("#stage").bounding_box()
            x, y = round(box["x"] - whole["x"]), round(box["y"] - whole["y"])
            kept.append(part[y + 8 : y + 60, x + 8 : x + 200].mean() if part.size else 0.0)
        assert dark[0] == pytest.approx(60, abs=4)
        assert abs(light[0] - 60) > 20
        page.click("#larger")
        assert page.locator("#seen").bounding_box()["width"] > 1.5 * box["width"]


@pytest.mark.slow
def test_without_a_photograph_there_is_nothing_to_blend(browser, page_file) -> None:
    with opened(browser, page_file) as page:
        page.click("#views button:has-text('camera')")
        assert page.locator("#seen").is_visible()
        assert not page.locator("#photograph").is_visible()
        assert not page.locator("#blend").is_visible()
