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
        "driver/mars/test_session.py",
        "driver/mars/test_gripper.py",
        "driver/mars/streaming/test_stream.py",
        "driver/mars/streaming/test_stream_run.py",
    ),
    "driver/line/link.py": (
        "driver/mars/test_session.py",
        "driver/mars/test_gripper.py",
        "driver/test_bad_line.py",
    ),
    "driver/mars/streaming/stream.py": (
        "driver/execution/test_control.py",
        "driver/execution/test_pause.py",
        "driver/execution/test_speed_override.py",
        "driver/execution/test_execute.py",
        "driver/execution/test_execute_control.py",
        "driver/test_bad_line.py",
    ),
    "driver/mars/streaming/stream_run.py": (
        "driver/mars/streaming/test_stream.py",
        "driver/mars/streaming/test_stream_run.py",
        "driver/execution/test_control.py",
        "driver/execution/test_pause.py",
        "driver/execution/test_speed_override.py",
        "driver/execution/test_execute.py",
        "driver/execution/test_execute_control.py",
        "driver/test_bad_line.py",
    ),
    "driver/mars/session.py": (
        "driver/mars/test_identity.py",
        "driver/mars/start/test_startup.py",
        "driver/mars/test_stopping.py",
        "driver/test_session.py",
    ),
    "driver/execution/pause.py": (
        "driver/execution/test_control.py",
        "driver/execution/test_pause.py",
        "driver/execution/test_speed_override.py",
        "driver/execution/test_execute_control.py",
    ),
    "driver/mars/start/homing.py": (
        "driver/mars/test_identity.py",
        "driver/mars/start/test_startup.py",
        "driver/mars/test_session.py",
        "driver/mars/test_gripper.py",
        "driver/test_session.py",
    ),
    "driver/mars/gripper.py": (
        "driver/mars/test_session.py",
        "driver/mars/test_gripper.py",
        "driver/execution/test_execute.py",
        "driver/test_session.py",
    ),
    "driver/mars/start/startup.py": (
        "driver/mars/test_identity.py",
        "driver/mars/start/test_startup.py",
        "driver/mars/test_session.py",
        "driver/mars/test_gripper.py",
    ),
    "driver/mars/refusals.py": (
        "driver/mars/test_session.py",
        "driver/mars/test_gripper.py",
        "driver/mars/streaming/test_stream.py",
        "driver/mars/streaming/test_stream_run.py",
        "driver/execution/test_execute.py",
    ),
    "driver/mars/ready.py": (
        "driver/mars/test_session.py",
        "driver/mars/test_gripper.py",
        "driver/mars/test_stopping.py",
        "driver/mars/test_identity.py",
        "driver/mars/start/test_startup.py",
    ),
    "driver/line/transport.py": (
        "driver/line/test_link.py",
        "driver/line/test_port.py",
        "driver/line/test_transport.py",
        "driver/mars/test_session.py",
        "driver/mars/test_gripper.py",
        "driver/test_bad_line.py",
    ),
    "driver/line/echo.py": (
        "driver/mars/test_identity.py",
        "driver/mars/start/test_startup.py",
        "driver/mars/streaming/test_stream.py",
        "driver/mars/streaming/test_stream_run.py",
    ),
    "driver/mars/streaming/feed.py": (
        "driver/mars/test_lookahead.py",
        "driver/mars/streaming/test_stream.py",
        "driver/mars/streaming/test_stream_run.py",
    ),
    "driver/mars/lookahead.py": (
        "driver/mars/streaming/test_stream.py",
        "driver/mars/streaming/test_stream_run.py",
    ),
    "driver/mars/streaming/path_watch.py": (
        "driver/mars/streaming/test_stream.py",
        "driver/mars/streaming/test_stream_run.py",
        "driver/test_bad_line.py",
    ),
    "driver/line/manners.py": (
        "driver/test_bad_line.py",
        "driver/mars/test_identity.py",
        "driver/mars/start/test_startup.py",
    ),
    "driver/line/unit_time.py": ("driver/mars/test_stopping.py", "driver/test_bad_line.py"),
    "driver/mars/identity.py": (
        "driver/mars/test_identity.py",
        "driver/mars/start/test_startup.py",
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
    "plan/transit/planner.py": (
        "plan/transit/test_near_ends.py",
        "plan/transit/test_few_parts.py",
        "plan/test_api.py",
    ),
    "plan/transit/near_ends.py": ("plan/program/sequence/test_planner.py",),
    "plan/transit/straight.py": (
        "plan/program/test_go_to.py",
        "plan/program/assignment/test_edge_checks.py",
        "plan/program/sequence/test_search.py",
    ),
    "plan/transit/proofs.py": ("plan/transit/test_planner.py",),
    "plan/transit/rrt_connect.py": ("plan/transit/test_planner.py",),
    "plan/transit/shortcuts.py": ("plan/transit/test_planner.py",),
    "plan/transit/optimise.py": ("plan/transit/test_planner.py", "plan/transit/test_few_parts.py"),
    "plan/collision/separation.py": (
        "plan/collision/test_bounds.py",
        "plan/collision/test_world.py",
        "plan/collision/test_certificate.py",
    ),
    "plan/collision/covers.py": ("plan/collision/test_bounds.py", "plan/collision/test_separation.py"),
    "plan/collision/pair_geometry.py": (
        "plan/collision/test_separation.py",
        "plan/collision/test_world.py",
    ),
    "plan/motion/builder.py": (
        "plan/motion/test_phase.py",
        "plan/program/test_planned.py",
        "plan/program/test_pose_lists.py",
        "plan/program/goals/test_blending.py",
        "plan/program/test_program.py",
    ),
    "plan/program/writer.py": (
        "plan/program/test_program.py",
        "plan/program/test_recovery.py",
        "plan/program/sequence/test_planner.py",
        "plan/program/assignment/test_planner.py",
    ),
    "plan/program/planned.py": (
        "plan/program/test_stated_arm.py",
        "plan/program/test_program.py",
        "plan/program/test_pose_lists.py",
        "plan/program/sequence/test_planner.py",
    ),
    "plan/program/recovery.py": ("cell/task/test_resume.py",),
    "plan/program/setting.py": ("plan/program/test_pose_lists.py",),
    "plan/program/go_to.py": ("plan/test_given.py",),
    "plan/program/goals/attachments.py": (
        "plan/program/test_program.py",
        "plan/test_pose_list_arms.py",
    ),
    "plan/program/goals/target.py": (
        "plan/program/test_program.py",
        "plan/program/goals/test_freedom.py",
        "plan/program/goals/test_attachments.py",
        "plan/program/sequence/test_planner.py",
    ),
    "plan/program/goals/leg_times.py": ("plan/program/sequence/test_times.py",),
    "plan/program/goals/blending.py": (
        "plan/program/test_pose_lists.py",
        "plan/program/sequence/test_times.py",
    ),
    "plan/program/goals/line_chains.py": (
        "plan/program/test_pose_lists.py",
        "plan/program/test_program.py",
        "plan/cartesian/test_clear_line.py",
    ),
    "plan/program/sequence/planner.py": (
        "plan/program/test_recovery.py",
        "plan/program/test_program.py",
        "plan/program/test_writer.py",
        "plan/test_pose_list_ends.py",
        "plan/program/goals/test_line_chains.py",
    ),
    "plan/program/sequence/search.py": (
        "plan/program/sequence/test_planner.py",
        "plan/program/goals/test_attachments.py",
        "plan/program/test_program.py",
        "plan/test_budget.py",
    ),
    "plan/program/sequence/candidates.py": (
        "plan/program/sequence/test_planner.py",
        "plan/test_pose_list_arms.py",
    ),
    "plan/program/sequence/times.py": ("plan/program/sequence/test_layers.py",),
    "plan/program/sequence/refusals.py": (
        "plan/program/sequence/test_refusals.py",
        "plan/program/sequence/test_planner.py",
        "plan/program/goals/test_attachments.py",
    ),
    "plan/program/sequence/layers.py": ("plan/program/sequence/test_times.py",),
    "plan/program/assignment/search.py": (
        "plan/program/assignment/test_planner.py",
        "plan/program/assignment/test_cause.py",
        "plan/program/assignment/test_edge_checks.py",
    ),
    "plan/program/assignment/legs.py": (
        "plan/program/assignment/test_edge_checks.py",
        "plan/program/assignment/test_search.py",
    ),
    "plan/program/assignment/edge_checks.py": ("plan/program/assignment/test_search.py",),
    "plan/program/assignment/found.py": ("plan/program/assignment/test_search.py",),
    "plan/program/assignment/worlds.py": (
        "plan/program/assignment/test_search.py",
        "plan/program/assignment/test_edge_checks.py",
    ),
    "plan/program/assignment/leg_costs.py": ("plan/program/assignment/test_search.py",),
    "plan/program/assignment/planner.py": ("plan/program/test_program.py",),
    "cell/config/arm_file.py": ("cell/commands/test_plans_of_other_arms.py",),
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
        "driver/mars/test_session.py",
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
