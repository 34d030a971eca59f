"""Former places of public modules, for one version: what pages and examples named before rooms had rooms of their own.

An import of a former name gives the module that stands elsewhere now, with a DeprecationWarning that says where.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

PLACES = {
    "arm.angles": "arm.numerics.angles",
    "arm.bodies": "arm.robot.shapes",
    "arm.files": "arm.io.storage",
    "arm.motion": "arm.controller.segments",
    "arm.planfile": "arm.plan_file",
    "arm.products": "arm.numerics.products",
    "arm.unit": "arm.controller.unit",
    "calib.pose_pairs": "calib.robot_world.solve",
    "calib.robot_world_start": "calib.robot_world.initial_guess",
    "calib.urdf_chain": "calib.model.from_urdf",
    "cell.cellfile": "cell.config.cell",
    "cell.lookfile": "cell.files.observation",
    "cell.planning": "cell.task.planning",
    "cell.run": "cell.commands.run",
    "cell.scenery": "cell.scene.build",
    "cell.steps": "cell.commands.steps",
    "cell.taskfile": "cell.files.task",
    "cell.watcher": "cell.session.observer",
    "driver.control": "driver.execution.control",
    "driver.echo": "driver.line.echo",
    "driver.execute": "driver.execution.execute",
    "driver.logfile": "driver.log.read",
    "driver.lookahead": "driver.mars.lookahead",
    "driver.pathwatch": "driver.execution.path_watch",
    "driver.startup": "driver.mars.startup",
    "driver.stepped": "driver.line.stepped_clock",
    "driver.stream": "driver.execution.stream",
    "plan.check": "plan.collision.certificate",
    "plan.curve": "plan.collision.bezier",
    "plan.ik": "plan.kinematics.ik",
    "plan.ik_numeric": "plan.kinematics.numeric_ik",
    "plan.legs": "plan.pick_place.leg_times",
    "plan.order": "plan.pick_place.sequencing",
    "plan.paths": "plan.trajectory.joint_path",
    "plan.pieces": "plan.collision.subdivision",
    "plan.proofs": "plan.pick_place.edge_checks",
    "plan.reach": "plan.cartesian.reachability",
    "plan.rounding": "plan.trajectory.rounding",
    "plan.rrt": "plan.transit.rrt_connect",
    "plan.segments": "plan.trajectory.integer_segments",
    "plan.sequence": "plan.pick_place.search",
    "plan.shorten": "plan.transit.optimise",
    "plan.task": "plan.pick_place.planner",
    "plan.topp": "plan.trajectory.topp_ra",
    "plan.volumes": "plan.collision.bounds",
    "plan.way": "plan.pick_place.go_to",
    "plan.world": "plan.collision.world",
    "vision.basler": "vision.camera.basler",
    "vision.border_shift": "vision.markers.border_shift",
    "vision.cube_side": "vision.occupancy.cube_side",
    "vision.cube_top": "vision.occupancy.cube_top",
    "vision.frames": "vision.camera.frame_source",
    "vision.hole_borders": "vision.occupancy.expected_edges",
    "vision.seated": "vision.occupancy.seated",
    "vision.shared_errors": "vision.boards.shared_errors",
}


class _Former(MetaPathFinder, Loader):
    """Finds modules by their former names, after all other finders have not."""

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        return ModuleSpec(name, self) if name in PLACES else None

    def exec_module(self, module: ModuleType) -> None:
        """Give the module that was asked for every name of the one that stands elsewhere now."""
        place = PLACES[module.__name__]
        warnings.warn(f"{module.__name__} is {place} now", DeprecationWarning, stacklevel=2)
        now = import_module(place)
        module.__dict__.update({k: v for k, v in vars(now).items() if not k.startswith("__")})


if not any(isinstance(finder, _Former) for finder in sys.meta_path):
    sys.meta_path.append(_Former())
