"""What the sampling peers share: the chain of transits and lines of a query, and which grips are tried next."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from arm.controller.unit import Limits
from arm.se3 import Array, frozen, inverse
from plan.scene import Station
from planning_bench.choices import pairs
from planning_bench.grips import GripLine
from planning_bench.query import Answer, PlannerFailed, Query, Stretch, Timed


class Kit(Protocol):
    """A peer's own parts. `q` are (6,) rad; None is no motion."""

    def load(self, query: Query) -> None:
        """Build the worlds of a query."""

    def hold(self, cube: str, T_tool_cube: Array, touches: frozenset[str]) -> None:
        """Put a cube into the hand of the holding world; it may touch `touches` on lines."""

    def set_down(self, cube: str, T_base_cube: Array) -> None:
        """Put the cube down in both worlds."""

    def transit(self, q_from: Array, q_to: Array, holding: bool, seed: int) -> Timed | None: ...

    def line(self, grip: GripLine, station: Station) -> Timed | None:
        """From the offset point to the station."""

    def line_free(self, line: Timed, holding: bool) -> bool:
        """Whether the line keeps out of everything, by the peer's own test at its own step."""


def backwards(motion: Timed) -> Timed:
    """The same motion from its end to its start."""
    return Timed(motion.times[-1] - motion.times[::-1], motion.q[::-1], -motion.qd[::-1])


def plan_chain(kit: Kit, query: Query) -> Answer:
    """All transfers of a query.

    Raises:
        PlannerFailed: a transfer for which no pair of grips came out.
    """
    kit.load(query)
    q = query.q_start
    open_parts: list[Timed] = []
    stretches: list[Stretch] = []
    for index, transfer in enumerate(query.transfers):
        last = index + 1 == len(query.transfers)
        found = _transfer(kit, query, index, q, last)
        if found is None:
            raise PlannerFailed(f"{transfer.cube}: no pair of grips came out")
        out, down, across, lower, back = found
        stretches.append(Stretch((*open_parts, *([out] if out else []), down)))
        stretches.append(Stretch((backwards(down), across, lower)))
        open_parts = [backwards(lower), *([back] if back else [])]
        q = lower.q[0]
    stretches.append(Stretch(tuple(open_parts)))
    parts = [p for s in stretches for p in s.parts]
    shares = [peaks(p, query.limits) for p in parts if isinstance(p, Timed)]
    return Answer(tuple(stretches), peaks=(max(v for v, _ in shares), max(a for _, a in shares)))


def peaks(motion: Timed, limits: Limits) -> tuple[float, float]:
    """At a peer's own samples: its velocities, and their mean change from one sample to the next."""
    gaps = np.diff(motion.times)
    whole = gaps > 0.5 * np.median(gaps)  # the last sample stands anywhere after the one before
    push = (np.diff(motion.qd, axis=0) / gaps[:, None])[whole]
    return float((np.abs(motion.qd) / limits.velocity).max()), float(
        (np.abs(push) / limits.acceleration).max()
    )


def _transfer(
    kit: Kit, query: Query, index: int, q: Array, last: bool
) -> tuple[Timed | None, Timed, Timed, Timed, Timed | None] | None:
    transfer, scene = query.transfers[index], query.scene
    cube = scene.cube(transfer.cube)
    in_tool = [frozen(inverse(T) @ cube.T_base_body) for T in transfer.pick.T_base_tool]
    touches = transfer.pick.touches | transfer.place.touches
    lines: dict[tuple[str, bytes], Timed | None] = {}
    outs: dict[bytes, Timed | None] = {}
    backs: dict[bytes, Timed | None] = {}

    def line(grip: GripLine, station: Station) -> Timed | None:
        """Checked open on the side where the jaws are open, and holding; each world as it is then."""
        key = (station.name, grip.q.tobytes())
        if key not in lines:
            made = kit.line(grip, station)
            lines[key] = made if made is not None and kit.line_free(made, holding=True) else None
        return lines[key]

    for pick, place in pairs(query, index, q):
        kit.hold(cube.name, in_tool[pick.yaw], touches)
        down = line(pick, transfer.pick)
        lower = line(place, transfer.place)
        if down is None or lower is None or not kit.line_free(down, holding=False):
            continue
        key = pick.q_offset.tobytes()
        if key not in outs:
            outs[key] = kit.transit(q, down.q[0], False, query.seed)
        if outs[key] is None:
            continue
        across = kit.transit(down.q[0], lower.q[0], True, query.seed)
        if across is None:
            continue
        kit.set_down(cube.name, frozen(transfer.place.T_base_tool[place.yaw] @ in_tool[pick.yaw]))
        back: Timed | None = None
        free = kit.line_free(lower, holding=False)
        if free and last:
            key = place.q_offset.tobytes()
            if key not in backs:
                backs[key] = kit.transit(lower.q[0], query.q_start, False, query.seed)
            back = backs[key]
        if not free or (last and back is None):
            kit.set_down(cube.name, cube.T_base_body)
            continue
        return outs[pick.q_offset.tobytes()], down, across, lower, back
    return None


def nowhere(q_from: Array, q_to: Array) -> bool:
    """Whether there is no way to go."""
    return bool(np.abs(q_from - q_to).max() < 1e-6)
