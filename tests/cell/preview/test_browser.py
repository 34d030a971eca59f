"""The page in a real browser, from disk, with every request refused: it draws, plays, seeks, jumps, and says no error.

Needs Debian's chromium and playwright; skipped without, unless A465_REQUIRE_BROWSER is set (as in .ci/run).
Screenshots are kept in the tests' own folders, or in the one that A465_SCREENSHOTS names.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm.controller.segments import CountPath
from arm.plan_file import Move
from arm.robot.shapes import Torus, body_from_json
from cell.console import Console
from cell.export.timeline import cube_tracks, timed_steps
from cell.preview.clearance import sample_clearance
from cell.preview.of_log import preview_log
from cell.preview.overlays import ExecutedMove, Refused, shape_numbers
from cell.preview.page import write_preview
from pages.browsers import keep_screenshot, picture_of
from pages.preview import opened, write_case
from plans.other_arms import scara
from wire.logged_session import logged_run


@pytest.mark.slow
def test_the_kinematics_of_the_page_are_the_robots(browser, page_file, preview_case) -> None:
    case = preview_case
    rng = np.random.default_rng(3)
    steps = timed_steps(case.plan)
    with opened(browser, page_file) as page:
        for t in rng.uniform(0.0, steps[-1].end_s, 40):
            timed = next(s for s in steps if s.start_s <= t < s.end_s)
            if not isinstance(timed.step, Move):
                continue
            counts = timed.step.path.at([t - timed.start_s])[0]
            shown = page.evaluate("(t) => a465.motion.toolPose(a465.motion.q(t)).elements", t)
            expected = case.robot_open.T_base_tool(case.unit.positions(counts))
            assert np.abs(np.reshape(shown, (4, 4)).T - expected).max() < 2e-6


@pytest.mark.slow
def test_a_torus_is_drawn_as_a_tube_around_its_circle(browser, page_file) -> None:
    """And as the checked body with its padding."""
    shape = shape_numbers(Torus(0.0324, 0.0048))
    with opened(browser, page_file) as page:
        for drawn, tube in (("bodyGeometry(s, 0.01)", 0.0048), ("checkedGeometry(s, 0.002)", 0.0068)):
            corners = page.evaluate(f"(s) => [...{drawn}.attributes.position.array]", shape)
            x, y, z = np.reshape(corners, (-1, 3)).T
            assert np.hypot(np.hypot(x, y) - 0.0324, z) == pytest.approx(tube, abs=1e-7)
            assert np.ptp(x) == pytest.approx(2.0 * (0.0324 + tube), rel=1e-6)


@pytest.mark.slow
def test_velocities_of_the_page_are_the_segments(browser, page_file, preview_case) -> None:
    case = preview_case
    with opened(browser, page_file) as page:
        start = 0.0
        for timed in timed_steps(case.plan):
            if isinstance(timed.step, Move):
                start = timed.start_s
                segment = timed.step.path.segments[7]
                for order in (1, 2):
                    shown = page.evaluate("([t, order]) => a465.motion.q(t, order)", [start + 0.73, order])
                    expected = segment.derivative(0.3, order) / case.unit.counts_per_rad
                    assert shown == pytest.approx(expected, rel=1e-6, abs=1e-9)


@pytest.mark.slow
def test_moves_that_meet_at_speed_are_shown_without_a_break(browser, preview_case, tmp_path: Path) -> None:
    """One move in two halves: velocities go on over the meeting, each segment shows its own bound."""
    steps = preview_case.plan.steps
    index = next(i for i, s in enumerate(steps) if isinstance(s, Move) and s.role == "transit")
    move = steps[index]
    at = len(move.path.segments) // 2
    middle = tuple(int(c) for c in move.path.knots()[at])
    bounds = tuple(move.clearance + 1e-3 * k for k in range(at))
    halves = (
        replace(move, path=CountPath(move.path.start, move.path.segments[:at]), clearances=bounds),
        replace(move, path=CountPath(middle, move.path.segments[at:])),
    )
    plan = replace(preview_case.plan, steps=(*steps[:index], *halves, *steps[index + 1 :]))
    write_case(replace(preview_case, plan=plan), tmp_path / "plan.html", clearance_every_s=0.0)
    meeting = timed_steps(plan)[index].end_s
    with opened(browser, tmp_path / "plan.html") as page:
        before, after = (
            np.array(page.evaluate("(t) => a465.motion.q(t, 1)", t)) for t in (meeting - 1e-5, meeting + 1e-5)
        )
        assert np.abs(before).max() > 0.05
        assert before == pytest.approx(after, abs=2e-3)
        for k in (0, at - 1):
            shown = page.evaluate(
                "(t) => a465.motion.proved(t)", timed_steps(plan)[index].start_s + 0.1 * k + 0.05
            )
            assert shown == pytest.approx(bounds[k], abs=2e-6)
        assert page.locator("#list button.joined").count() >= 1
        assert page.locator("#clearance-chart .proved").count() == 1


@pytest.mark.slow
def test_cubes_are_drawn_where_the_plan_brings_them(browser, page_file, preview_case) -> None:
    case = preview_case
    cubes = [body_from_json(c) for c in case.plan.scene["cubes"]]
    tracks = cube_tracks(timed_steps(case.plan), cubes, case.robot_open, case.unit)
    with opened(browser, page_file) as page:
        page.evaluate("a465.seek(a465.motion.duration)")
        for i, track in enumerate(tracks.values()):
            shown = page.evaluate("(i) => a465.cell.cubes[i].mesh.matrix.elements", i)
            assert np.abs(np.reshape(shown, (4, 4)).T - track[-1].T).max() < 1e-6
        moves = [s for s in timed_steps(case.plan) if isinstance(s.step, Move)]
        times = [move.end_s - 0.2 for move in moves]
        # all in one call, so that the page draws once and not once a move
        shown = page.evaluate(
            """(times) => times.map((t) => {
                a465.seek(t);
                return a465.cell.cubes.map((cube) => [...cube.mesh.matrix.elements]);
            })""",
            times,
        )
    for timed, t, matrices in zip(moves, times, shown, strict=True):
        T = case.robot_open.T_base_tool(case.unit.positions(timed.step.path.at([t - timed.start_s])[0]))
        for track, elements in zip(tracks.values(), matrices, strict=True):
            now = [pose for pose in track if pose.start_s <= t][-1]
            expected = T @ now.T if now.held else now.T
            assert np.abs(np.reshape(elements, (4, 4)).T - expected).max() < 2e-6


@pytest.mark.slow
def test_the_picture_is_not_empty_and_moves(browser, page_file) -> None:
    with opened(browser, page_file) as page:
        first = picture_of(page).astype(int)
        assert first.std(axis=(0, 1)).max() > 20
        page.evaluate("a465.seek(40)")
        second = picture_of(page).astype(int)
        changed = (np.abs(second - first).max(axis=2) > 24).mean()
        assert 0.01 < changed < 0.6


@pytest.mark.slow
def test_all_of_the_cell_is_in_the_picture(browser, page_file) -> None:
    """What is taken out is missed: the arm, the boards, the cubes, table and walls, and the camera's view."""
    parts = {
        "[a465.cell.frames[0]]": 0.02,
        "a465.cell.boards": 0.005,
        "a465.cell.cubes.map((cube) => cube.mesh)": 0.001,
        "a465.cell.bodies": 0.1,
        "a465.cell.view.children": 0.001,
    }
    with opened(browser, page_file, 500, 500) as page:
        page.click("#views button:has-text('camera')")
        page.evaluate(
            "a465.seen.frame.hidden = true; a465.seek(0)"
        )  # what the camera sees is over the picture
        page.mouse.move(0, 0)
        whole = picture_of(page).astype(int)

        def changed() -> float:
            return float((np.abs(picture_of(page).astype(int) - whole).max(axis=2) > 16).mean())

        show = "for (const part of {}) part.visible = {}; a465.stage.moved()"
        for part, least in parts.items():
            page.evaluate(show.format(part, "false"))
            assert changed() > least, part
            page.evaluate(show.format(part, "true"))


@pytest.mark.slow
def test_the_camera_is_shown_when_asked_for(browser, page_file) -> None:
    with opened(browser, page_file, 500, 500) as page:
        for shown in (False, True, False):
            assert page.evaluate("a465.cell.view.visible") is shown
            page.click("#views button:has-text('camera')")


@pytest.mark.slow
def test_the_closest_pair_at_the_cursor(browser, page_file, preview_case) -> None:
    """Named with its clearance, and joined by a line as long as that; none while the arm stands."""
    case = preview_case
    steps = timed_steps(case.plan)
    samples = sample_clearance(case.plan, case.robot_open, case.robot_holding, case.unit)
    rng = np.random.default_rng(5)
    indices = rng.choice(list(samples), 12, replace=False)
    chosen = [(i, samples[i][rng.integers(1, len(samples[i]) - 1)]) for i in indices]
    still = next(i for i, timed in enumerate(steps) if not isinstance(timed.step, Move))
    times = [steps[i].start_s + sample.time_s + 1e-3 for i, sample in chosen] + [steps[still].start_s + 0.1]
    with opened(browser, page_file, 500, 500) as page:
        # all in one call, so that the page draws once
        *shown, at_rest = page.evaluate(
            """(times) => times.map((t) => {
                a465.seek(t);
                const { visible, geometry } = a465.trace.closest;
                const [told, card] = ["closest", "now"].map((id) => document.getElementById(id).innerText);
                return { told, card, visible, line: [...geometry.attributes.instanceStart.array.slice(0, 6)] };
            })""",
            times,
        )
    for (_, sample), now in zip(chosen, shown, strict=True):
        mm, pair = now["told"].split(" mm · ")
        assert pair == " \N{EN DASH} ".join(sample.pair)
        assert float(mm) == pytest.approx(1e3 * sample.distance, abs=0.51)
        assert f"{mm} mm {pair}" in now["card"]
        assert now["visible"]
        assert np.reshape(now["line"], (2, 3)) == pytest.approx(np.array(sample.points), abs=1e-4)
    assert len({sample.pair for _, sample in chosen}) > 2
    assert at_rest["told"] == "at rest"
    assert not at_rest["visible"]


@pytest.mark.slow
def test_the_trace_has_its_colour_from_the_clearance(browser, page_file) -> None:
    """Redder where it is nearer, until the roles are asked for; the legend says which."""
    colours = "[...a465.trace.ahead.geometry.attributes.instanceColorStart.data.array]"
    with opened(browser, page_file, 500, 500) as page:
        assert "mm clearance" in page.locator("#legend").inner_text()
        rgb = np.reshape(page.evaluate(colours), (-1, 6))[:, :3]
        mm = np.array(
            page.evaluate("a465.trace.times.map((t) => (a465.trace.clearance(t) || { mm: NaN }).mm)"), float
        )[: len(rgb)]
        greener = (rgb[:, 1] / rgb[:, 0])[np.argsort(mm)]
        means = [part.mean() for part in np.array_split(greener, 5)]
        assert means[0] < 1 < means[-1]
        assert np.all(np.diff(means) > 0)
        page.click("#views button:has-text('clearance')")
        assert "approach" in page.locator("#legend").inner_text()
        assert not np.allclose(np.reshape(page.evaluate(colours), (-1, 6))[:, :3], rgb)


@pytest.mark.slow
def test_peaks_stay_under_the_limits_that_were_planned(browser, page_file, preview_case) -> None:
    with opened(browser, page_file) as page:
        limits = preview_case.unit.limits().scaled(preview_case.plan.speed)
        for order, limit in ((1, limits.velocity), (2, limits.acceleration)):
            peaks = np.array(page.evaluate("(order) => a465.motion.peaks(order)", order))
            assert np.all(peaks > 0)
            assert np.all(peaks <= limit * 1.001)


@pytest.mark.slow
@pytest.mark.parametrize("cubes", [1, 2, 3, 4])
def test_plans_of_other_lengths(browser, make_preview_case: Callable, tmp_path: Path, cubes: int) -> None:
    case = make_preview_case(cubes)
    write_case(case, tmp_path / "plan.html")
    with opened(browser, tmp_path / "plan.html", at="#step=3") as page:
        assert page.locator("#list button").count() == len(case.plan.steps)
        assert page.evaluate("a465.state.step") == 3
        assert page.locator("#cubes span").count() == cubes
        assert f"code {case.plan.code}" in page.locator("#code").inner_text()
        assert page.title().endswith(case.plan.sha256[:8])
        page.click("#provenance summary")
        told = page.locator("#provenance dl").inner_text()
        assert case.plan.sha256 in told
        assert all(key in told for key in case.plan.provenance)
        page.click("#provenance summary")
        page.evaluate("a465.seek(0.4 * a465.motion.duration)")
        keep_screenshot(page, tmp_path, f"preview-{cubes}-laptop-light")
        page.emulate_media(color_scheme="dark")
        page.set_viewport_size({"width": 390, "height": 844})
        keep_screenshot(page, tmp_path, f"preview-{cubes}-phone-dark")


@pytest.mark.slow
def test_executed_is_drawn_over_planned(browser, preview_case, tmp_path: Path) -> None:
    moves = [(i, s) for i, s in enumerate(preview_case.plan.steps) if isinstance(s, Move)][:3]
    executed = []
    for index, move in moves:
        times = np.arange(0.0, move.path.duration_s, 0.05)
        executed.append(ExecutedMove(index, times, move.path.at(times) + 40.0))
    write_case(preview_case, tmp_path / "log.html", executed=executed, clearance_every_s=0.0)
    with opened(browser, tmp_path / "log.html") as page:
        assert page.locator("#joint-chart .executed").count() == 18
        assert "executed" in page.locator("#legend").inner_text()
        assert page.locator("#difference-chart .off").count() == 18
        farthest = page.evaluate("a465.motion.farthest")  # 40 counts at the joint with fewest to a degree
        assert farthest["degrees"] == pytest.approx(40.0 / 555.556, rel=0.02)
        assert farthest["joint"] == 4
        page.evaluate("(t) => a465.seek(t)", timed_steps(preview_case.plan)[moves[0][0]].start_s + 0.5)
        assert page.locator("#off").inner_text().startswith("J5 ")


@pytest.mark.slow
def test_without_a_log_there_is_no_difference(browser, page_file) -> None:
    with opened(browser, page_file) as page:
        assert not page.locator("#difference").is_visible()


@pytest.mark.slow
def test_a_log_alone_is_shown_without_clearance(browser, tmp_path: Path) -> None:
    run = logged_run(tmp_path / "wire.jsonl")
    told = preview_log(run.log, None, tmp_path / "log.html", Console(as_json=True))
    assert told["plan"] is None
    with opened(browser, tmp_path / "log.html", at="#t=3") as page:
        page.get_by_role("button", name="clearance").click()
        assert page.locator("#closest").inner_text() == "not known"
        assert "clearance" not in page.locator("#summary").inner_text()
        assert page.evaluate("a465.motion.farthest.degrees") == pytest.approx(told["farthest_deg"], abs=2e-4)
        assert picture_of(page).std() > 5


@pytest.mark.slow
def test_a_scene_without_boards_or_cubes_is_shown(browser, preview_case, tmp_path: Path) -> None:
    plan = replace(
        preview_case.plan,
        steps=tuple(s for s in preview_case.plan.steps if not getattr(s, "held", None))[:2],
        scene={},
        task={},
    )
    case = replace(preview_case, plan=plan)
    write_case(case, tmp_path / "bare.html")
    with opened(browser, tmp_path / "bare.html") as page:
        assert page.locator("#title").inner_text() == "plan"
        assert picture_of(page).std() > 5


@pytest.mark.slow
def test_an_arm_with_a_sliding_joint_moves_and_is_shown_in_mm(browser, tmp_path: Path) -> None:
    planned = scara(tmp_path)
    robots = planned.robot, planned.robot
    write_preview(planned.plan(), *robots, planned.unit, tmp_path / "page.html")
    with opened(browser, tmp_path / "page.html") as page:
        for t in np.random.default_rng(4).uniform(0.0, planned.duration_s, 20):
            shown = page.evaluate("(t) => a465.motion.toolPose(a465.motion.q(t)).elements", t)
            expected = planned.robot.T_base_tool(planned.at([t])[0])
            assert np.abs(np.reshape(shown, (4, 4)).T - expected).max() < 2e-6
        assert page.inner_text("#readout th:nth-child(2)") == "°, mm"
        ranges = page.evaluate(
            "[...document.querySelectorAll('#readout tbody tr')].map((row) => row.cells[3].textContent)"
        )
        assert [text.replace("\u2212", "-") for text in ranges[1:3]] == ["-143 … 143", "-100 … 120"]
        assert page.inner_text("#summary").startswith("4 joints, no unit · ")
        assert page.is_hidden("#code")


@pytest.mark.slow
def test_a_refused_motion_opens_where_it_is_refused_with_both_bodies_in_red(
    browser, preview_case, tmp_path: Path
) -> None:
    refused = Refused("gripper comes within 1 mm of table", 3.25, ("gripper", "table"))
    write_case(preview_case, tmp_path / "plan.html", refused=refused)
    with opened(browser, tmp_path / "plan.html") as page:
        assert page.locator("#refused").inner_text() == f"refused {refused.what} show"
        assert page.evaluate("a465.state.time") == refused.time_s
        colours = "[...a465.cell.named].map(([name, part]) => [name, part.material?.color.getHexString()])"
        red = page.evaluate("new THREE.Color(styleColour('warn')).getHexString()")
        assert {name for name, colour in page.evaluate(colours) if colour == red} == set(refused.pair)
        page.evaluate("a465.seek(0)")
        page.locator("#refused button").click()
        assert page.evaluate("a465.state.time") == refused.time_s
