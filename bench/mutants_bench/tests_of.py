"""The tests that are to see a change of a module: few files, the fastest and nearest first."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

# Beside tests/<folder>/test_<module>.py, where there is one.
_MORE: dict[str, tuple[str, ...]] = {
    "cell/task/free_cell.py": (
        "cell/session/test_homed.py",
        "cell/task/test_free_cell.py",
    ),
    "cell/scene/build.py": ("cell/task/test_planning.py", "cell/task/test_resume.py"),
    "driver/mars/stopping.py": (
        "driver/mars/test_stopping.py",
        "driver/mars/test_mars.py",
        "driver/mars/test_gripper.py",
        "driver/execution/test_stream.py",
        "driver/execution/test_stream_run.py",
    ),
    "driver/line/link.py": (
        "driver/mars/test_mars.py",
        "driver/mars/test_gripper.py",
        "driver/test_bad_line.py",
    ),
    "driver/execution/stream.py": (
        "driver/execution/test_control.py",
        "driver/execution/test_pause.py",
        "driver/execution/test_speed_override.py",
        "driver/execution/test_execute.py",
        "driver/execution/test_execute_control.py",
        "driver/test_bad_line.py",
    ),
    "driver/execution/stream_run.py": (
        "driver/execution/test_stream.py",
        "driver/execution/test_stream_run.py",
        "driver/execution/test_control.py",
        "driver/execution/test_pause.py",
        "driver/execution/test_speed_override.py",
        "driver/execution/test_execute.py",
        "driver/execution/test_execute_control.py",
        "driver/test_bad_line.py",
    ),
    "driver/mars/mars.py": (
        "driver/mars/test_identity.py",
        "driver/mars/test_startup.py",
        "driver/mars/test_stopping.py",
        "driver/test_session.py",
    ),
    "driver/execution/pause.py": (
        "driver/execution/test_control.py",
        "driver/execution/test_pause.py",
        "driver/execution/test_speed_override.py",
        "driver/execution/test_execute_control.py",
    ),
    "driver/mars/homing.py": (
        "driver/mars/test_identity.py",
        "driver/mars/test_startup.py",
        "driver/mars/test_mars.py",
        "driver/mars/test_gripper.py",
        "driver/test_session.py",
    ),
    "driver/mars/gripper.py": (
        "driver/mars/test_mars.py",
        "driver/mars/test_gripper.py",
        "driver/execution/test_execute.py",
        "driver/test_session.py",
    ),
    "driver/mars/startup.py": (
        "driver/mars/test_identity.py",
        "driver/mars/test_startup.py",
        "driver/mars/test_mars.py",
        "driver/mars/test_gripper.py",
    ),
    "driver/mars/refusals.py": (
        "driver/mars/test_mars.py",
        "driver/mars/test_gripper.py",
        "driver/execution/test_stream.py",
        "driver/execution/test_stream_run.py",
        "driver/execution/test_execute.py",
    ),
    "driver/mars/ready.py": (
        "driver/mars/test_mars.py",
        "driver/mars/test_gripper.py",
        "driver/mars/test_stopping.py",
        "driver/mars/test_identity.py",
        "driver/mars/test_startup.py",
    ),
    "driver/line/transport.py": (
        "driver/line/test_link.py",
        "driver/line/test_port.py",
        "driver/line/test_transport.py",
        "driver/mars/test_mars.py",
        "driver/mars/test_gripper.py",
        "driver/test_bad_line.py",
    ),
    "driver/line/echo.py": (
        "driver/mars/test_identity.py",
        "driver/mars/test_startup.py",
        "driver/execution/test_stream.py",
        "driver/execution/test_stream_run.py",
    ),
    "driver/execution/feed.py": (
        "driver/mars/test_lookahead.py",
        "driver/execution/test_stream.py",
        "driver/execution/test_stream_run.py",
    ),
    "driver/mars/lookahead.py": (
        "driver/execution/test_stream.py",
        "driver/execution/test_stream_run.py",
    ),
    "driver/execution/path_watch.py": (
        "driver/execution/test_stream.py",
        "driver/execution/test_stream_run.py",
        "driver/test_bad_line.py",
    ),
    "driver/line/manners.py": (
        "driver/test_bad_line.py",
        "driver/mars/test_identity.py",
        "driver/mars/test_startup.py",
    ),
    "driver/line/unit_time.py": ("driver/mars/test_stopping.py", "driver/test_bad_line.py"),
    "driver/mars/identity.py": (
        "driver/mars/test_identity.py",
        "driver/mars/test_startup.py",
        "driver/test_bad_line.py",
    ),
    "cell/session/dialogue.py": (
        "cell/task/test_approval.py",
        "cell/session/test_overview.py",
        "cell/session/test_homed.py",
        "cell/task/test_free_cell.py",
    ),
    "cell/files/board_shift.py": (
        "cell/task/test_plan_matches.py",
        "cell/scene/test_build.py",
    ),
    "plan/collision/certificate.py": (
        "plan/collision/test_bezier.py",
        "plan/collision/test_certificate_attacked.py",
        "plan/collision/test_subdivision.py",
        "plan/transit/test_few_parts.py",
    ),
    "plan/collision/subdivision.py": (
        "plan/collision/test_certificate.py",
        "plan/collision/test_bezier.py",
        "plan/collision/test_certificate_attacked.py",
    ),
    "plan/collision/bounds.py": (
        "plan/collision/test_certificate.py",
        "plan/collision/test_bezier.py",
        "plan/collision/test_world.py",
        "plan/collision/test_certificate_attacked.py",
    ),
    "plan/cartesian/collision_barrier.py": (
        "plan/cartesian/test_line.py",
        "plan/cartesian/test_differential_ik.py",
    ),
    "plan/collision/world.py": (
        "plan/collision/test_certificate.py",
        "plan/collision/test_bezier.py",
        "plan/collision/test_bounds.py",
    ),
    "plan/trajectory/integer_segments.py": ("plan/trajectory/test_jerk_limited.py",),
    "plan/transit/planner.py": ("plan/transit/test_few_parts.py",),
    "cell/task/plan_matches.py": (
        "cell/runs/test_refused_plans.py",
        "cell/config/test_bodies.py",
        "cell/config/test_cell_file.py",
        "cell/files/test_task.py",
        "cell/files/test_world.py",
    ),
    "cell/config/inputs.py": (
        "cell/task/test_plan_matches.py",
        "cell/scene/test_build.py",
        "cell/config/test_bodies.py",
        "cell/config/test_cell_file.py",
        "cell/files/test_task.py",
        "cell/files/test_world.py",
    ),
    "cell/task/approval.py": (),
    "cell/task/resume.py": (),
    "arm/controller/unit.py": (
        "driver/mars/test_mars.py",
        "driver/mars/test_gripper.py",
        "plan/trajectory/test_integer_segments.py",
        "plan/trajectory/test_extremes.py",
        "plan/trajectory/test_rounding.py",
    ),
    "arm/controller/unit_keys.py": ("arm/controller/test_unit.py",),
    "arm/plan_file.py": ("plan/test_verify.py",),
    "vision/observe.py": (
        "vision/boards/test_pose.py",
        "vision/boards/test_arrangement.py",
        "vision/boards/test_marker_size.py",
        "vision/boards/test_pose_fit.py",
    ),
    "calib/chain/verdict.py": ("calib/chain/test_result.py",),
    "calib/robot_world/solve.py": ("calib/robot_world/test_initial_guess.py",),
}


def tests_of(file: str, tests: Path) -> tuple[str, ...]:
    """Test files below `tests` for a module below ``src``."""
    folder, _, module = file.rpartition("/")
    named = f"{folder}/test_{module}"
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
