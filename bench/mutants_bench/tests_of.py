"""The tests that are to see a change of a module: few files, the fastest and nearest first."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

# Beside tests/<room>/test_<module>.py, where there is one.
_MORE: dict[str, tuple[str, ...]] = {
    "driver/rest.py": ("driver/test_mars_stopping.py", "driver/test_mars.py", "driver/test_stream.py"),
    "driver/link.py": ("driver/test_mars.py", "driver/test_bad_line.py"),
    "driver/stream.py": (
        "driver/test_stream_control.py",
        "driver/test_execute.py",
        "driver/test_execute_control.py",
        "driver/test_bad_line.py",
    ),
    "driver/mars.py": (
        "driver/test_mars_startup.py",
        "driver/test_mars_stopping.py",
        "driver/test_driver_session.py",
    ),
    "driver/hold.py": ("driver/test_stream_control.py", "driver/test_execute_control.py"),
    "driver/homing.py": (
        "driver/test_mars_startup.py",
        "driver/test_mars.py",
        "driver/test_driver_session.py",
    ),
    "driver/gripper.py": ("driver/test_mars.py", "driver/test_execute.py", "driver/test_driver_session.py"),
    "driver/startup.py": ("driver/test_mars_startup.py", "driver/test_mars.py"),
    "driver/refusals.py": ("driver/test_mars.py", "driver/test_stream.py", "driver/test_execute.py"),
    "driver/ready.py": ("driver/test_mars.py", "driver/test_mars_stopping.py", "driver/test_mars_startup.py"),
    "driver/portlink.py": ("driver/test_link.py", "driver/test_mars.py", "driver/test_bad_line.py"),
    "driver/echo.py": ("driver/test_mars_startup.py", "driver/test_stream.py"),
    "driver/feed.py": ("driver/test_lookahead.py", "driver/test_stream.py"),
    "driver/lookahead.py": ("driver/test_stream.py",),
    "driver/pathwatch.py": ("driver/test_stream.py", "driver/test_bad_line.py"),
    "driver/manners.py": ("driver/test_bad_line.py", "driver/test_mars_startup.py"),
    "driver/unittime.py": ("driver/test_mars_stopping.py", "driver/test_bad_line.py"),
    "driver/identity.py": ("driver/test_mars_startup.py", "driver/test_bad_line.py"),
    "cell/asking.py": ("cell/test_approval.py", "cell/test_homed.py"),
    "cell/boardshift.py": ("cell/test_checking.py",),
    "plan/check.py": ("plan/test_certificate.py", "plan/test_pieces.py", "plan/test_few_parts.py"),
    "plan/pieces.py": ("plan/test_check.py", "plan/test_certificate.py"),
    "plan/volumes.py": ("plan/test_check.py", "plan/test_world.py", "plan/test_certificate.py"),
    "plan/barrier.py": ("plan/test_line.py",),
    "plan/world.py": ("plan/test_check.py", "plan/test_volumes.py"),
    "plan/segments.py": ("plan/test_jerk.py",),
    "plan/transit.py": ("plan/test_few_parts.py",),
    "cell/checking.py": ("cell/test_refused_plans.py", "cell/test_cell_and_task_files.py"),
    "cell/inputs.py": ("cell/test_checking.py", "cell/test_cell_and_task_files.py"),
    "cell/approval.py": (),
    "cell/resume.py": (),
    "arm/unit.py": ("driver/test_mars.py", "plan/test_segments.py"),
    "arm/planfile.py": ("plan/test_replay.py",),
    "vision/look.py": ("vision/test_board_pose.py",),
    "calib/chain_verdict.py": ("calib/test_hold_out.py",),
    "calib/pose_pairs.py": ("calib/test_robot_world_start.py",),
}


def tests_of(file: str, tests: Path) -> tuple[str, ...]:
    """Test files below `tests` for a module below ``src``."""
    room, _, module = file.partition("/")
    named = f"{room}/test_{module}"
    return located((named, *_MORE.get(file, ())), tests)


def located(names: Iterable[str], tests: Path) -> tuple[str, ...]:
    """Those of some test files that are there; one that has moved is found by its name, if that is the only one."""
    found: dict[str, None] = {}
    for name in names:
        path = tests / name
        files = [path] if path.is_file() else sorted(tests.rglob(path.name))
        if len(files) == 1:
            found[files[0].relative_to(tests).as_posix()] = None
    return tuple(found)
