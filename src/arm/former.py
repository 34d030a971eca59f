"""Former names of public modules, classes and functions, kept for one version.

The import of a former module name returns the renamed module, with a DeprecationWarning that states the new name. If a
module became a package of the same name, or a public name changed, `former_names` provides the former names.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Sequence
from functools import wraps
from importlib import import_module
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from importlib.abc import Loader
else:
    Loader = object  # importlib.abc takes 5 ms, and a finder needs its methods only

T = TypeVar("T")

PLACES = {
    "arm.angles": "arm.numerics.angles",
    "arm.bodies": "arm.robot.shapes",
    "arm.files": "arm.io.storage",
    "arm.motion": "arm.controller.segments",
    "arm.planfile": "arm.plan_file",
    "arm.products": "arm.numerics.products",
    "arm.unit": "arm.controller.unit",
    "calib.hand_eye.optimal_design": "calib.model.optimal_design",
    "calib.model.projection": "vision.camera.projection",
    "calib.pose_pairs": "calib.robot_world.solve",
    "calib.robot_world_start": "calib.robot_world.initial_guess",
    "calib.urdf_chain": "calib.model.from_urdf",
    "cell.cellfile": "cell.config.cell",
    "cell.lookfile": "cell.files.observation",
    "cell.planning": "cell.task.planning",
    "cell.run": "cell.commands.run",
    "cell.scenery": "cell.scene.build",
    "cell.steps": "cell.commands.steps",
    "cell.task.confirm_placed": "cell.cubes.confirm_placed",
    "cell.taskfile": "cell.files.task",
    "cell.watcher": "cell.session.observer",
    "driver.control": "driver.execution.control",
    "driver.echo": "driver.line.echo",
    "driver.execute": "driver.execution.execute",
    "driver.logfile": "driver.log.read",
    "driver.execution.jog": "driver.mars.streaming.jog",
    "driver.execution.stream": "driver.mars.streaming.stream",
    "driver.lookahead": "driver.mars.lookahead",
    "driver.pathwatch": "driver.mars.streaming.path_watch",
    "driver.startup": "driver.mars.start.startup",
    "driver.stepped": "driver.line.stepped_clock",
    "driver.stream": "driver.mars.streaming.stream",
    "plan.check": "plan.collision.certificate",
    "plan.ik": "plan.kinematics.ik",
    "plan.ik_numeric": "plan.kinematics.numeric_ik",
    "plan.legs": "plan.program.goals.leg_times",
    "plan.order": "plan.program.assignment.sequencing",
    "plan.paths": "plan.trajectory.joint_path",
    "plan.pick_place.cause": "plan.program.assignment.cause",
    "plan.pick_place.edge_checks": "plan.program.assignment.edge_checks",
    "plan.pick_place.go_to": "plan.program.go_to",
    "plan.pick_place.grammar": "plan.program.grammar",
    "plan.pick_place.leg_costs": "plan.program.assignment.leg_costs",
    "plan.pick_place.leg_times": "plan.program.goals.leg_times",
    "plan.pick_place.motions": "plan.program.writer",
    "plan.pick_place.planner": "plan.program.tasks",
    "plan.pick_place.recovery": "plan.program.recovery",
    "plan.pick_place.search": "plan.program.assignment.search",
    "plan.pick_place.sequencing": "plan.program.assignment.sequencing",
    "plan.pick_place.worlds": "plan.program.assignment.worlds",
    "plan.pieces": "plan.collision.subdivision",
    "plan.proofs": "plan.program.assignment.edge_checks",
    "plan.reach": "plan.cartesian.reachability",
    "plan.rounding": "plan.trajectory.rounding",
    "plan.rrt": "plan.transit.rrt_connect",
    "plan.segments": "plan.trajectory.integer_segments",
    "plan.sequence": "plan.program.assignment.search",
    "plan.shorten": "plan.transit.optimise",
    "plan.task": "plan.program.tasks",
    "plan.topp": "plan.trajectory.topp_ra",
    "plan.volumes": "plan.collision.bounds",
    "plan.way": "plan.program.go_to",
    "plan.waypoints.attachments": "plan.program.goals.attachments",
    "plan.waypoints.blending": "plan.program.goals.blending",
    "plan.waypoints.candidates": "plan.program.sequence.candidates",
    "plan.waypoints.line_chains": "plan.program.goals.line_chains",
    "plan.waypoints.motion_builder": "plan.motion.builder",
    "plan.waypoints.motions": "plan.program.writer",
    "plan.waypoints.plan": "plan.program.planned",
    "plan.waypoints.planner": "plan.program.pose_lists",
    "plan.waypoints.rejections": "plan.program.sequence.refusals",
    "plan.waypoints.search": "plan.program.sequence.search",
    "plan.waypoints.target": "plan.program.goals.target",
    "plan.waypoints.times": "plan.program.sequence.times",
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


class FormerNames:
    """A module's `__getattr__` (PEP 562) for former names.

    Args:
        module: name of the module.
        place: module that now has the names.
        names: names that are unchanged there.
        renamed: former name -> present name.
    """

    def __init__(self, module: str, place: str, *names: str, **renamed: str) -> None:
        self.module = module
        self.place = place
        self.names = {name: name for name in names} | renamed

    def __call__(self, name: str) -> object:
        if name not in self.names:
            raise AttributeError(f"module {self.module!r} has no attribute {name!r}")
        now = self.names[name]
        warnings.warn(f"{self.module}.{name} is {self.place}.{now} now", DeprecationWarning, stacklevel=2)
        return getattr(import_module(self.place), now)


def former_names(module: str, place: str, *names: str, **renamed: str) -> None:
    """Let a module provide former names; see `FormerNames`. Type checkers do not see these names."""
    vars(sys.modules[module])["__getattr__"] = FormerNames(module, place, *names, **renamed)


def renamed_arguments(**renamed: str) -> Callable[[type[T]], type[T]]:
    """Keep former names of a class's arguments and attributes working, with a DeprecationWarning.

    Args:
        renamed: former name -> present name.
    """

    def renaming(cls: type[T]) -> type[T]:
        make = cls.__init__

        @wraps(make)
        def init(self: T, *args: Any, **kwargs: Any) -> None:
            for name in sorted(renamed.keys() & kwargs.keys()):
                _warn_renamed(cls, name, renamed[name])
                kwargs[renamed[name]] = kwargs.pop(name)
            make(self, *args, **kwargs)

        def former(name: str) -> property:
            def get(self: T) -> object:
                _warn_renamed(cls, name, renamed[name])
                return getattr(self, renamed[name])

            return property(get)

        setattr(cls, "__init__", init)  # noqa: B010  (mypy allows no other way)
        for name in renamed:
            setattr(cls, name, former(name))
        return cls

    return renaming


def _warn_renamed(cls: type, name: str, now: str) -> None:
    warnings.warn(f"{cls.__name__}: {name} is {now} now", DeprecationWarning, stacklevel=3)


class _Former(Loader):
    """Finds modules by their former names, after all other finders failed."""

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if name in PLACES:
            return ModuleSpec(name, self)
        # a former package of which all modules have moved
        moved = name.count(".") == 1 and any(other.startswith(f"{name}.") for other in PLACES)
        return ModuleSpec(name, self, is_package=True) if moved else None

    def create_module(self, spec: ModuleSpec) -> None:
        """The usual module."""

    def exec_module(self, module: ModuleType) -> None:
        """Copy every name of the renamed module; a former package is empty."""
        if module.__name__ not in PLACES:
            return
        place = PLACES[module.__name__]
        warnings.warn(f"{module.__name__} is {place} now", DeprecationWarning, stacklevel=2)
        now = import_module(place)
        module.__dict__.update({k: v for k, v in vars(now).items() if not k.startswith("__")})
        if isinstance(vars(now).get("__getattr__"), FormerNames):  # its own renamed names
            module.__dict__["__getattr__"] = vars(now)["__getattr__"]


if not any(isinstance(finder, _Former) for finder in sys.meta_path):
    sys.meta_path.append(_Former())
