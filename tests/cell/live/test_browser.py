"""The live view in a real browser: it follows the arm, lets go and comes back, and keeps the end.

Needs Debian's chromium and playwright; skipped without, unless A465_REQUIRE_BROWSER is set (as in .ci/run).
Screenshots are kept in the tests' own folders, or in the one that A465_SCREENSHOTS names.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from arm.io.storage import data_file
from arm.plan_file import GripperStep, Move
from cell.export.timeline import timed_steps
from cell.live.server import LiveServer
from cell.live.view import Live
from cell.preview.of_place import place_shown, resting
from cell.preview.page import preview_page
from driver.execution.control import Control
from pages.browsers import DEADLINE_MS, complaints_of, keep_screenshot, picture_of, until
from tasks.small import small_scenes
from typed.command_line import replace_in
from wire.looks_at_motion import looks

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("live_browser")]


@contextmanager
def opened(browser, url: str, width: int = 1280, height: int = 800, scheme: str = "light"):
    """The page of a server; on leaving, it may have asked nobody else and complained of nothing."""
    context = browser.new_context(viewport={"width": width, "height": height}, color_scheme=scheme)
    page = context.new_page()
    page.set_default_timeout(DEADLINE_MS)
    asked, complaints = [], complaints_of(page)
    page.on("request", lambda request: asked.append(request.url))
    page.goto(url)
    until(page, "window.a465 !== undefined")
    try:
        yield page
    finally:
        context.close()
    assert [u for u in asked if not u.startswith((url, "data:", "blob:"))] == []
    assert complaints == []


@dataclass
class Run:
    """A run without an arm: the test says what happens.

    Attributes:
        url: of its live view.
    """

    case: object
    server: LiveServer
    control: Control
    number: int = 0

    @property
    def url(self) -> str:
        return self.server.url

    @property
    def live(self) -> Live:
        return Live(self.server)

    def plan(self) -> None:
        case = self.case
        self.number += 1
        mark = f"run-{self.number}"
        text = preview_page(
            case.plan, case.robot_open, case.robot_holding, case.unit, clearance_every_s=0.0, live=mark
        )
        self.server.put(lambda state: state.follow(mark, "plan", case.plan, case.unit, text.encode()))

    def move(self, until_step: int, off: int = 0, part: float = 1.0) -> tuple[float, np.ndarray]:
        """Steps up to one, and of that a part; where the arm is then on the plan's clock, and its counts."""
        timed, last = timed_steps(self.case.plan), (0.0, np.zeros(6))
        for index, step in enumerate(self.case.plan.steps[: until_step + 1]):
            self.live.step(step)
            if not isinstance(step, Move):
                continue
            for t, progress in looks(step, off=off):
                if index == until_step and t > part * step.path.duration_s:
                    break
                self.live.progress(progress)
                last = timed[index].start_s + t, np.array(progress.position.counts)
        return last


@pytest.fixture
def run(preview_case) -> Iterator[Run]:
    server, control = LiveServer(0), Control()
    server.start()
    made = Run(preview_case, server, control)
    made.live.begins(None, control)  # no task: the page is made here
    yield made
    server.end("done")


def step_named(run: Run, words: str) -> int:
    return next(i for i, s in enumerate(run.case.plan.steps) if words in s.name)


def last_frame(page, arm: str) -> np.ndarray:
    """Pose of the last joint's frame as it is drawn, of the arm (frames) or its ghost; 4x4."""
    page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    return np.reshape(page.evaluate(f"a465.cell.{arm}.slice(-1)[0].matrixWorld.elements"), (4, 4)).T


def arm_at(run: Run, counts: np.ndarray) -> np.ndarray:
    """The same of the robot at encoder counts."""
    return run.case.robot_open.joint_poses(run.case.unit.positions(counts))[-1]


def test_it_waits_then_follows_and_keeps_the_end(browser, run: Run, tmp_path: Path) -> None:
    with opened(browser, run.url) as page:
        run.live.line("[  0.0 s] homing")
        until(page, "document.getElementById('told').innerText.includes('homing')")
        assert "waiting" in page.locator("#live").inner_text()
        run.plan()
        until(page, "window.a465?.content?.live === 'run-1' && a465.live.run.plan !== null")
        assert page.locator("#told li").all_inner_texts() == ["[ 0.0 s] homing"]
        before = picture_of(page).astype(int)
        index = step_named(run, "cube 1: approach")
        t, counts = run.move(index, part=0.6)
        until(page, f"a465.live.sample !== null && a465.state.time > {t} - 0.02")
        until(page, "a465.live.frame === 0")
        assert 0.01 < (np.abs(picture_of(page).astype(int) - before).max(axis=2) > 24).mean() < 0.6
        assert page.evaluate("a465.state.time") == pytest.approx(t, abs=0.02)
        assert float(page.locator("#slider").input_value()) == pytest.approx(t, abs=0.02)
        assert page.evaluate("a465.live.run.state") == "runs"
        assert page.evaluate("a465.state.step") == index
        assert page.locator("#list button[aria-current]").inner_text().startswith("approach")
        assert page.locator("#difference-chart").is_visible()
        assert last_frame(page, "frames") == pytest.approx(arm_at(run, counts), abs=1e-6)
        assert page.locator("#code").is_hidden()
        keep_screenshot(page, tmp_path, "live-laptop-light")
        run.server.end("stopped: step 3: the reason")
        until(page, "a465.live.run.state === 'ended'")
        assert "ended: stopped: step 3: the reason" in page.locator("#live").inner_text()
        page.wait_for_timeout(1500)  # the server is gone: nobody asks it again, or there is a complaint
        assert "ended" in page.locator("#live").inner_text()
        assert page.evaluate("a465.state.time") == pytest.approx(t, abs=0.02)
        keep_screenshot(page, tmp_path, "live-ended-laptop-light")


def test_a_lost_connection_is_told_and_nothing_is_missed(browser, run: Run) -> None:
    run.plan()
    with opened(browser, run.url, 500, 500) as page:
        index = step_named(run, "cube 1: approach")
        before, _ = run.move(index, part=0.3)
        until(page, f"a465.state.time > {before} - 0.02")
        shown = "a465.motion.executed.flatMap((motion) => motion.times).length"
        count = page.evaluate(shown)
        page.route("**/state?*", lambda route: route.fulfill(body="torn"))
        until(page, "document.getElementById('live').innerText.includes('connection lost')")
        assert page.evaluate("a465.state.time") == pytest.approx(before, abs=0.02)
        late = list(looks(run.case.plan.steps[index]))[-8:]
        for _, progress in late:  # nobody listens
            run.live.progress(progress)
        page.unroute("**/state?*")
        until(page, f"a465.live.run.state === 'runs' && {shown} === {count + len(late)}")
        assert "connection lost" not in page.locator("#live").inner_text()


def test_the_difference_to_the_plan_is_shown(browser, run: Run) -> None:
    run.plan()
    with opened(browser, run.url) as page:
        index = step_named(run, "cube 1: transit")
        _, counts = run.move(index, off=40, part=0.5)
        until(
            page,
            "a465.live.sample !== null && document.querySelectorAll('#difference-chart .off').length >= 6",
        )
        until(page, "a465.live.frame === 0")
        worst, joint = re.search(
            r"([\d.]+)° off the plan \((J\d)\)", page.locator("#live").inner_text()
        ).groups()
        assert 0.02 < float(worst) < 0.1  # 40 counts of each joint, less what is along the path
        farthest = page.evaluate("a465.motion.farthest")
        assert farthest["degrees"] >= float(worst) - 5e-4
        assert page.locator("#off").inner_text().startswith(joint)
        assert page.locator("#joint-chart .executed").count() == 6
        assert last_frame(page, "frames") == pytest.approx(
            arm_at(run, counts), abs=1e-6
        )  # not where it should be


def test_the_step_that_runs_is_shown_though_the_arm_lags(browser, run: Run) -> None:
    run.plan()
    with opened(browser, run.url) as page:
        index = step_named(run, "cube 1: approach")
        t, _ = run.move(index - 1)
        run.live.step(run.case.plan.steps[index])
        late = replace(list(looks(run.case.plan.steps[index - 1]))[-3][1], done=0)
        run.live.progress(late)
        # before it came, the cursor stood at the end of the move before
        until(page, f"a465.state.step === {index} && a465.live.frame === 0 && a465.state.time < {t} - 0.002")
        assert page.evaluate("a465.state.time") > t - 0.3


def test_the_user_goes_elsewhere_and_comes_back(browser, run: Run) -> None:
    run.plan()
    with opened(browser, run.url) as page:
        index = step_named(run, "cube 1: approach")
        t, counts = run.move(index, part=0.3)
        until(page, f"a465.state.time > {t} - 0.02")
        assert page.locator("#follow").get_attribute("aria-pressed") == "true"
        page.fill("#slider", "40")
        assert page.locator("#follow").get_attribute("aria-pressed") == "false"
        until(page, "a465.cell.ghosts.executed?.[0].visible === true")
        now, counts = run.move(index, part=0.8)
        until(page, f"a465.live.place > {now} - 0.02 && a465.live.frame === 0")
        assert page.evaluate("a465.state.time") == pytest.approx(40.0)
        assert page.evaluate("a465.state.step") == page.evaluate("a465.motion.stepAt(40)")
        assert last_frame(page, "ghosts.executed") == pytest.approx(arm_at(run, counts), abs=1e-6)
        page.click("#follow")
        until(page, f"a465.state.time > {now} - 0.02 && a465.state.time < {now} + 0.02")
        assert page.evaluate("a465.cell.ghosts.executed[0].visible") is False
        assert page.evaluate("a465.state.step") == index
        page.click("#play")  # plays the plan, as in the preview
        until(page, "a465.state.playing && !a465.live.following")
        page.click("#follow")
        until(page, f"Math.abs(a465.state.time - {now}) < 0.02")
        assert page.evaluate("[a465.state.playing, a465.live.following]") == [False, True]


def test_pauses_gripper_steps_and_another_plan(browser, run: Run) -> None:
    run.plan()
    with opened(browser, run.url, scheme="dark") as page:
        close = next(i for i, s in enumerate(run.case.plan.steps) if isinstance(s, GripperStep) and i)
        run.move(close)
        until(page, f"a465.state.step === {close}")
        start = timed_steps(run.case.plan)[close].start_s
        until(page, "a465.live.frame === 0")
        assert page.evaluate("a465.state.time") == pytest.approx(start, abs=1e-3)
        run.control.paused = True
        until(page, "a465.live.run.state === 'pauses'")
        run.control.standing = True
        until(page, "document.getElementById('live').innerText.startsWith('paused, the arm has stopped')")
        run.control.paused = run.control.standing = False
        until(page, "a465.live.run.state === 'runs'")
        page.click("#theme")
        page.evaluate("a465.stage.view('top')")
        run.plan()
        until(page, "window.a465?.content?.live === 'run-2' && a465.live.run.plan !== null")
        assert page.evaluate("a465.state.time") == 0
        assert page.evaluate("document.documentElement.dataset.theme") == "light"
        assert page.evaluate("a465.stage.camera.position.z") > 1.3  # still from above
        assert page.evaluate("a465.live.run.state") == "waits"


def test_on_a_phone(browser, run: Run, tmp_path: Path) -> None:
    run.plan()
    with opened(browser, run.url, 390, 844, scheme="dark") as page:
        run.move(step_named(run, "cube 1: transit"), part=0.2)
        until(page, "a465.live.sample !== null")
        for following in (True, False):
            assert page.evaluate("a465.live.following") is following
            assert page.evaluate("document.documentElement.scrollWidth") <= 390
            boxes = [
                page.locator(part).bounding_box() for part in ("#play", "#next", "#follow", "#clock", ".rate")
            ]
            shown = [box for box in boxes if box is not None]
            assert all(a["x"] + a["width"] <= b["x"] + 0.5 for a, b in pairwise(shown))
            assert shown[-1]["x"] + shown[-1]["width"] <= 390
            keep_screenshot(page, tmp_path, f"live-phone-dark-{'followed' if following else 'left'}")
            page.evaluate("a465.seek(20)")


def test_a_run_in_the_simulated_cell_is_followed_to_its_end(browser, tmp_path: Path) -> None:
    scenes = small_scenes(tmp_path)
    replace_in(scenes / "task2.world.toml", "cubes = [1, 2, 3, 4]", "cubes = [4]")
    words = ["run", str(scenes / "task2.toml"), "-o", str(tmp_path / "run"), "--time-scale", "8", "--live"]
    code = "import cell.cli.main; cell.cli.main.main()"
    child = subprocess.Popen(
        [sys.executable, "-c", code, *words], stdout=subprocess.PIPE, text=True, env={**os.environ}
    )
    try:
        url = re.fullmatch(r"live view: (http://127\.0\.0\.1:\d+/)\n", child.stdout.readline())[1]
        with opened(browser, url) as page:
            until(page, "window.a465?.live?.run.plan?.name === 'plan' && a465.live.sample?.t > 3")
            # a busy host may be late, or miss a poll, which shows as "lost" until the next
            until(page, "['runs', 'ended'].includes(a465.live.run.state)")
            until(page, "a465.live.run.state === 'ended' && a465.live.frame === 0")
            assert "ended: done" in page.locator("#live").inner_text()
            shown = page.evaluate(
                "a465.motion.executed.flatMap((run) => run.times.map((t, i) => [t, ...run.off[i]]))"
            )
            end = page.evaluate("[a465.state.time, a465.motion.steps.findLast((s) => s.kind === 'move').end]")
            told = page.locator("#told").inner_text()
    finally:
        child.kill()
        child.communicate()
    times, off = np.array(shown)[:, 0], np.array(shown)[:, 1:]
    assert np.abs(off).max() < 0.01  # the emulated arm keeps its path
    assert len(times) > 100
    assert np.all(np.diff(times) >= 0.0)
    assert end[0] == pytest.approx(end[1], abs=0.02)
    assert "look after cube 1" in told
    noted = [json.loads(line) for line in (tmp_path / "run/wire.jsonl").read_text().splitlines()]
    assert len(times) <= sum("COORDAP=" in r.get("data", "") for r in noted if r["kind"] == "received")


@pytest.mark.slow
def test_an_arm_without_a_plan_is_shown_where_it_is_reported(browser, run: Run) -> None:
    """And nowhere while that is not known. Nothing else of the page speaks of a plan."""
    setting, drawn, q_start, _ = place_shown(data_file("scenes/cell.toml"), None)
    plan, unit = resting(setting, q_start, "where the unit reports the arm", "cell"), setting.unit
    robots = setting.scene.robot_open, setting.scene.robot_holding
    live = Live(run.server)
    live.place(plan, unit, lambda mark: preview_page(plan, *robots, unit, live=mark, **drawn))
    live.reading(None, "NOT HOMED")
    with opened(browser, run.url) as page:
        until(page, "document.getElementById('live-facts').innerText.includes('NOT HOMED')")
        assert page.evaluate("a465.cell.frames[0].visible") is False
        q = np.radians([20.0, 10.0, -70.0, 5.0, -50.0, 3.0])
        live.reading(unit.counts(q).tolist(), "closest a - b: 3.0 mm")
        until(page, "document.getElementById('live-facts').innerText.includes('3.0 mm')")
        until(page, "a465.cell.frames[0].visible")
        expected = setting.robot.joint_poses(unit.positions(unit.counts(q)))[-1]
        until(page, "!a465.live.frame")  # it has come there
        assert last_frame(page, "frames") == pytest.approx(expected, abs=1e-5)
        shown = page.locator("#readout td:nth-child(2)").all_inner_texts()
        assert [float(v.replace("\N{MINUS SIGN}", "-")) for v in shown] == pytest.approx(
            np.degrees(q), abs=0.02
        )
        for part in ("#transport", "#clearance-chart", "#joint-chart", "#legend"):
            assert not page.locator(part).is_visible()
        assert "clearance" not in page.locator("header").inner_text()
