"""Every numbered example runs, in a folder of its own, and says what it should."""

import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
SAYS = {
    "01_load_the_arm.py": "J2:   -88.7 to   89.0 deg,    7.2 deg/s",
    "02_all_branches.py": "beyond its limit",
    "03_a_certified_move.py": "nowhere nearer than 1",
    "04_the_controller_alone.py": "planner loaded: False",
    "05_from_image_to_plan.py": "28 moves",
    "06_any_arm.py": "through these solutions nothing is faster than",
    "07_a_list_of_poses.py": "approach rim 0 .. retract from rim 9",
    "08_scene_check.py": "10 mm are kept",
    "09_hand_eye.py": "0.197 -0.305  0.102 -0.2    0.   ] deg\naccepted",
    "10_pose_pairs.py": "not used: pairs 7",
    "11_another_controller.py": "2 steps done in",
    "12_follow_joint_trajectory.py": "times feedback, then {'status': 6, 'result': {'error_code': -1",
}


def test_every_example_is_listed() -> None:
    assert sorted(p.name for p in EXAMPLES.glob("[0-9]*.py")) == sorted(SAYS)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(SAYS))
def test_example(name: str, tmp_path: Path) -> None:
    ran = subprocess.run(
        [sys.executable, str(EXAMPLES / name)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=600,
    )
    assert ran.returncode == 0, ran.stderr
    assert SAYS[name] in ran.stdout
