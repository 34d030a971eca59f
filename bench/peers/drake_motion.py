"""Drake 1.51: its check of edges by samples, and its proof that a polytope of configurations is free."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np
from pydrake.geometry.optimization import CspaceFreePolytope, SeparatingPlaneOrder
from pydrake.planning import RobotDiagram, RobotDiagramBuilder, SceneGraphCollisionChecker
from pydrake.solvers import ClarabelSolver

from arm.se3 import Array


def _diagram(urdf: str, base: str, allowed: Iterable[frozenset[str]]) -> tuple[RobotDiagram, list[object]]:
    builder = RobotDiagramBuilder(time_step=0.0)
    models = builder.parser().AddModelsFromString(urdf, "urdf")
    plant = builder.plant()
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(base))
    plant.Finalize()
    return builder.Build(), models


class Edges:
    """One arm among bodies, checked at samples of straight motions."""

    def __init__(
        self,
        urdf: str,
        links: Sequence[str],
        allowed: Iterable[frozenset[str]],
        clearance: float,
        step: float,
    ) -> None:
        diagram, models = _diagram(urdf, links[0], allowed)
        self._checker = SceneGraphCollisionChecker(
            model=diagram,
            robot_model_instances=models,
            edge_step_size=step,
            configuration_distance_function=lambda a, b: float(np.abs(a - b).max()),
            env_collision_padding=clearance,
            self_collision_padding=clearance,
        )
        plant = diagram.plant()
        for pair in allowed:
            a, b = (plant.GetBodyByName(name) for name in pair)
            self._checker.SetCollisionFilteredBetween(a, b, True)

    def touches(self, q: Array) -> bool:
        """Return whether a sample is nearer than the clearance along way-points (m, n), rad."""
        return not all(self._checker.CheckEdgeCollisionFree(a, b) for a, b in pairwise(q))


def proved_free(
    urdf: str, links: Sequence[str], allowed: Iterable[frozenset[str]], begin: float, end: float
) -> bool:
    """Return whether Drake proves that the only joint of a scene which is not welded is free from begin to end, rad.

    The polytope is the interval of s = tan((q - q*) / 2) with q* in its middle, so this motion is its own and no
    approximation. Solver: Clarabel.
    """
    diagram, _ = _diagram(urdf, links[0], allowed)
    plant, inspector = diagram.plant(), diagram.scene_graph().model_inspector()
    (joint,) = (
        plant.get_mutable_joint(k) for k in plant.GetJointIndices() if plant.get_joint(k).num_positions()
    )
    # Drake intersects the polytope with tan((limits - q*) / 2), and limits more than pi away would make that empty.
    joint.set_position_limits([min(begin, end)], [max(begin, end)])
    middle = np.array([0.5 * (begin + end)])
    prover = CspaceFreePolytope(
        plant=plant,
        scene_graph=diagram.scene_graph(),
        plane_order=SeparatingPlaneOrder.kAffine,
        q_star=middle,
        options=CspaceFreePolytope.Options(),
    )
    s = float(np.tan(abs(end - begin) / 4.0))
    may = {frozenset(pair) for pair in allowed}
    ignored = set()
    for a, b in prover.map_geometries_to_separating_planes():
        names = {plant.GetBodyFromFrameId(inspector.GetFrameId(g)).name() for g in (a, b)}
        if frozenset(names) in may:
            ignored.add((a, b))
    options = CspaceFreePolytope.FindSeparationCertificateGivenPolytopeOptions()
    options.solver_id = ClarabelSolver.id()
    options.terminate_at_failure = True
    proved, _ = prover.FindSeparationCertificateGivenPolytope(
        np.array([[1.0], [-1.0]]), np.array([s, s]), ignored, options
    )
    return bool(proved)
