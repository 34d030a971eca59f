"""Mutants written by hand: those that the project was once shown to survive, and their like at the safety rules.

Most were green on 3fe7dd4 in a trial from outside. When code is rewritten, `bench/mutants.py --check` says which of
them no longer stand where they stood; they are moved by hand to the line that now decides the same thing.
"""

from __future__ import annotations

from mutants_bench.by_hand_driver import ROWS as DRIVER
from mutants_bench.by_hand_measuring import ROWS as MEASURING
from mutants_bench.by_hand_plan import ROWS as PLAN
from mutants_bench.mutant import Mutant

_C = "cell/task/plan_matches.py"
_CHECKING = (
    "cell/task/test_plan_matches.py",
    "cell/scene/test_build.py",
)

_ROWS: tuple[tuple[str, str, str, str, str, tuple[str, ...]], ...] = (
    # name, file, old, new, what, tests
    (
        "checking-moved",
        _C,
        "        if shift.beyond(cell):\n",
        "        if False:\n",
        "a saved plan whose board has moved or turned is executed",
        _CHECKING,
    ),
    (
        "checking-not-seen",
        _C,
        '    faults += [f"{name} of the plan was not seen" for name in bodies if name.startswith(plate_name(""))]\n',
        "",
        "a board of the plan that is not seen is no matter",
        _CHECKING,
    ),
    (
        "checking-occupancy",
        _C,
        '            if now.state not in (planned_state, "unsure"):\n',
        "            if False:\n",
        "a hole that holds another thing than planned is no matter",
        _CHECKING,
    ),
    (
        "checking-start",
        _C,
        "    if max(map(abs, off)) > unit.rest_tolerance:\n",
        "    if False:\n",
        "a plan may start anywhere",
        _CHECKING + ("cell/runs/test_refused_plans.py",),
    ),
    (
        "pose-pairs-consensus",
        "calib/robot_world/solve.py",
        "    if agree < max(FEWEST, CONSENSUS * len(A)):\n",
        "    if agree < FEWEST:\n",
        "few pairs that agree are enough",
        (
            "calib/robot_world/test_solve.py",
            "calib/robot_world/test_noise_model.py",
            "calib/robot_world/test_observability.py",
            "calib/robot_world/test_reml.py",
        ),
    ),
    (
        "pose-pairs-parallel",
        "calib/robot_world/solve.py",
        "    axes = refuse_parallel_axes(A[start.inliers, :3, :3])\n",
        "    axes = refuse_parallel_axes(A[:, :3, :3])\n",
        "axes of wrong pairs make up for parallel ones",
        (
            "calib/robot_world/test_solve.py",
            "calib/robot_world/test_noise_model.py",
            "calib/robot_world/test_observability.py",
            "calib/robot_world/test_reml.py",
        ),
    ),
    (
        "chain-verdict-change",
        "calib/chain/verdict.py",
        "    if c.change is not None:\n",
        "    if False:\n",
        "a sudden change is not told",
        (
            "calib/chain/test_verdict.py",
            "calib/chain/test_score_tests.py",
            "calib/recordings/test_points.py",
        ),
    ),
    (
        "occupancy-cut-hole",
        "vision/occupancy/classify.py",
        "    if not all(np.isfinite(found.shows[found.border.clear]).all() for found in empty):\n",
        "    if False:\n",
        "a hole that the image's edge cuts is judged",
        ("vision/occupancy/test_classify.py",),
    ),
    (
        "occupancy-turn",
        "vision/occupancy/classify.py",
        "    J = np.concatenate([np.eye(3), -skew(point)], axis=1)\n",
        "    J = np.concatenate([np.eye(3), 0.0 * skew(point)], axis=1)\n",
        "the turn's part of a pose's error is left out",
        ("vision/occupancy/test_classify.py",),
    ),
    (
        "look-clutter",
        "vision/observe.py",
        "    strange = sorted(i for i, n in count.items() if 2 * n > len(frames))\n",
        "    strange = sorted(i for i, n in count.items() if n)\n",
        "a pattern of the clutter in one of five photographs ends the look",
        ("vision/test_observe.py",),
    ),
    (
        "look-twice",
        "vision/observe.py",
        "        if twice:\n",
        "        if False:\n",
        "a marker may be in view twice",
        ("vision/test_observe.py",),
    ),
    (
        "unit-register-cap",
        "arm/controller/unit.py",
        "                if not 1 <= value <= cap:\n",
        "                if not 1 <= value:\n",
        "registers may be above their cap",
        ("arm/controller/test_unit.py",),
    ),
    (
        "files-regular",
        "arm/io/storage.py",
        "        if not stat.S_ISREG(found.st_mode):\n",
        "        if False:\n",
        "pipes and devices are read",
        ("arm/io/test_storage.py",),
    ),
    (
        "runfolder-exclusive",
        "cell/report/run_folder.py",
        "            (folder / LOG).touch(exist_ok=False)\n",
        "            (folder / LOG).touch()\n",
        "runs that begin together share a folder",
        ("cell/report/test_run_folder.py",),
    ),
    (
        "grip-narrow",
        "cell/session/grasp_monitor.py",
        "    if abs(width - cube) <= tolerance:\n",
        "    if width - cube <= tolerance:\n",
        "jaws that close on nothing hold a cube",
        ("cell/session/test_grasp_monitor.py",),
    ),
    (
        "homed-cube-in-jaws",
        "cell/session/homed.py",
        "    if jaws_too and not grip_fault(cell, width):\n",
        "    if False:\n",
        "an arm that is kept homed lets go of what it holds",
        (
            "cell/session/test_homed.py",
            "cell/task/test_free_cell.py",
        ),
    ),
    (
        "confirming-board-moved",
        "cell/cubes/confirm_placed.py",
        "        if shift.beyond(task.cell):\n",
        "        if False:\n",
        "a cube counts as placed on a board that was pushed",
        ("cell/task/test_confirm_placed.py",),
    ),
    (
        "confirming-seated",
        "cell/cubes/confirm_placed.py",
        '    if seat.state != "seated":\n',
        "    if False:\n",
        "a cube that does not sit counts as placed",
        ("cell/task/test_confirm_placed.py",),
    ),
)

BY_HAND = tuple(
    Mutant(name, file, old, new, what, tests)
    for name, file, old, new, what, tests in (*_ROWS, *DRIVER, *PLAN, *MEASURING)
)
