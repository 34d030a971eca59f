"""The page of a preview: the same bytes, nothing leads out, names stay names."""

import json
import re
from dataclasses import replace
from pathlib import Path

from arm.robot.tool import padded
from cell.preview.content import page_content
from cell.preview.page import page, write_preview


def _write(case, path: Path, **options) -> str:
    boards = [place.board for place in case.boards]
    write_preview(
        case.plan, case.robot_open, case.robot_holding, case.unit, path, **{"boards": boards} | options
    )
    return path.read_text()


def test_same_plan_same_bytes_and_under_the_size(preview_case, tmp_path: Path) -> None:
    text = _write(preview_case, tmp_path / "a.html")
    assert text == _write(preview_case, tmp_path / "b.html")
    assert len(text.encode()) <= 1_500_000
    assert preview_case.plan.sha256 in text
    assert "Permission is hereby granted, free of charge" in text  # three's licence goes with its code


def test_nothing_in_the_page_leads_out(preview_case, tmp_path: Path) -> None:
    text = _write(preview_case, tmp_path / "a.html")
    assert set(re.findall(r"https?://[\w./-]+", text)) <= {
        "http://www.w3.org/1999/xhtml",
        "http://www.w3.org/2000/svg",
    }  # names of XML vocabularies, not addresses
    assert not re.search(r"\b(?:src|href)\s*=\s*[\"'][^#\"']", text)
    assert "default-src 'none'" in text


def test_a_name_cannot_break_out_of_its_script(preview_case) -> None:
    evil = "</script><script>document.title='broken'</script><!--scripts-->"
    plan = replace(preview_case.plan, task={"name": evil})
    content = page_content(plan, preview_case.robot_open, preview_case.robot_holding, preview_case.unit)
    text = page(content)
    assert evil not in text
    embedded = re.search(r'<script id="content" type="application/json">(.*?)</script>', text, re.S)
    assert embedded is not None
    assert json.loads(embedded[1])["task"]["name"] == evil


def test_the_page_knows_what_is_checked(preview_case) -> None:
    """Paddings of links, of bodies and of cubes, so that it can draw every body as it is checked."""
    case = preview_case
    scene = {
        **case.plan.scene,
        "bodies": [{**b, "padding": 0.0015} for b in case.plan.scene["bodies"]],
        "cubes": [{**c, "padding": 0.002} for c in case.plan.scene["cubes"]],
    }
    arms = [padded(robot, 0.01, but=("palm",)) for robot in (case.robot_open, case.robot_holding)]
    content = page_content(replace(case.plan, scene=scene), *arms, case.unit)
    assert {b["padding"] for b in content["bodies"]} == {0.0015}
    assert {c["padding"] for c in content["cubes"]} == {0.002}
    links = {b["name"]: b["padding"] for b in content["arm"]["bodies"]}
    assert links.pop("palm") == 0.0
    assert set(links.values()) == {0.01}
