"""Writes the motions of a found sequence, leg by leg, with what is held and what may touch on each stretch."""

from __future__ import annotations

from collections.abc import Sequence

from arm.errors import ImpossibleError
from arm.plan_file import Move
from plan.options import PlanOptions
from plan.waypoints.attachments import AttachmentWorlds
from plan.waypoints.line_chains import TargetReached
from plan.waypoints.motion_builder import Join, PoseMotionBuilder, PoseMotionPhase
from plan.waypoints.plan import Pause
from plan.waypoints.search import Found, PoseSearch
from plan.waypoints.target import Target


class PoseClearanceLost(ImpossibleError):
    """A leg of a sequence does not keep its clearance once it is timed.

    Args:
        leg: its number.
        why: what was found.
    """

    def __init__(self, leg: int, why: ImpossibleError) -> None:
        super().__init__(str(why), **why.data)
        self.leg, self.why = leg, why


class PoseMotionWriter:
    """Makes sequences into motions.

    Args:
        worlds, targets, options: of the list.
        mover: times and proves.
    """

    def __init__(
        self,
        worlds: AttachmentWorlds,
        targets: Sequence[Target],
        options: PlanOptions,
        mover: PoseMotionBuilder,
    ) -> None:
        self.worlds, self.targets, self.options, self.mover = worlds, targets, options, mover

    def motions(self, search: PoseSearch, found: Found) -> tuple[list[list[Move]], list[tuple[int, Pause]]]:
        """Motions of a sequence and the pauses between them.

        Raises:
            Unproved: a piece does not keep its clearance.
        """
        motions: list[list[Move]] = []
        pauses: list[tuple[int, Pause]] = []
        stretch: list[tuple[int, PoseMotionPhase]] = []
        joins: list[Join] = []

        def write() -> None:
            if stretch:
                try:
                    motions.extend(self.mover.run([piece for _, piece in stretch], joins))
                except ImpossibleError as error:
                    name = error.data.get("piece")
                    leg = next((leg for leg, piece in stretch if piece.name == name), stretch[0][0])
                    raise PoseClearanceLost(leg, error) from error
            stretch.clear()
            joins.clear()

        at: int | None = None  # the target that the arm is at
        for number, leg in enumerate(found.legs):
            situation = leg.before
            layer = search.layers[number + 1]
            counts = self.mover.unit.counts(leg.waypoints)
            if (counts != counts[0]).any():  # else the arm stands there already
                world = self.worlds.world(situation)
                piece = PoseMotionPhase(
                    f"to {layer.name}", "transit", world, self.options.clearance, situation.held, frozenset(),
                    way=leg.waypoints,
                )  # fmt: skip
                if stretch:
                    joins.append(Join(at, False))
                stretch.append((number, piece))
                at = None
            for item in leg.chain.items:
                if isinstance(item, TargetReached):
                    at, target = item.target, self.targets[item.target]
                    if target.stops:
                        write()
                        let_go = situation.held if target.detach else None
                        pauses.append(
                            (len(motions), Pause(target.name, target.dwell_s, target.attach, let_go))
                        )
                    situation = self.worlds.after(situation, target, item.T_base_tool)
                    continue
                target = self.targets[item.target]
                world = self.worlds.world(situation, target.pairs)
                allowed_collisions = frozenset(
                    name
                    for pair in target.pairs
                    if situation.held in pair
                    for name in pair - {situation.held}
                )
                preposition = "from" if item.role == "retract" else "to"
                piece = PoseMotionPhase(
                    f"{item.role} {preposition} {target.name}", item.role, world, self.options.line_clearance,
                    situation.held, allowed_collisions, line=item,
                )  # fmt: skip
                if stretch:
                    joins.append(Join(at, False))
                stretch.append((number, piece))
                at = None
        write()
        return motions, pauses
