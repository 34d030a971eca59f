"""What a list of poses asks for: where the tool goes, what is free there, how it comes and leaves, what happens."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from arm.arguments import pairs as checked_pairs
from arm.errors import A465Error, InputError
from arm.former import renamed_arguments
from arm.se3 import Array, orthonormalised
from plan.kinematics.numeric_ik import FREE

WAYS = ("transit", "line")
ATTACH_WITHIN = 0.010  # m


@renamed_arguments(within="blend_radius", touching="allowed_collisions")
@dataclass(frozen=True, eq=False)
class Target:
    """One pose of a list.

    Attributes:
        name: for people and messages; unique in its list.
        T_base_tool: (4, 4), m; corrected to the nearest rotation, by at most 1e-6.
        free: what of the pose may be anything: names out of `plan.kinematics.numeric_ik.FREE`, in the pose's
            own axes; several in one text are parted by spaces or commas.
        by: how it is reached from the one before: ``transit``, any way that keeps the clearance, or ``line``, the tool
            straight. On a line the tool keeps what is free of its end as it is, a single free rotation turns as little
            as it can.
        approach, retract: lengths of straight lines along the tool's own z axis, into the pose and out of it, m.
        speed: cap on the tool's speed on the lines that lead to the target and out of it, m/s (rad/s for a turn on
            the spot); default: the options' `approach_speed` times `speed`.
        blend_radius: the tool may cut the corner at this target: it passes the pose at this distance at most, m. With
            0 it goes through the pose, and stops there unless the path goes on without a corner.
        dwell_s: time at rest there, s.
        attach: name of a body that moves with the tool from here on.
        attach_within: that body may be so far at most from the hand (all that moves with the last joint) or from the
            tool frame's origin, m.
        detach: whether the body that moves with the tool stays here.
        allowed_collisions: pairs of names that may touch on the lines that lead to the target and out of it.
    """

    name: str
    T_base_tool: Array
    free: str | Sequence[str] = ()
    by: str = "transit"
    approach: float = 0.0
    retract: float = 0.0
    speed: float | None = None
    blend_radius: float = 0.0
    dwell_s: float = 0.0
    attach: str | None = None
    attach_within: float = ATTACH_WITHIN
    detach: bool = False
    allowed_collisions: Iterable[Iterable[str]] = field(default_factory=frozenset)

    def __post_init__(self) -> None:
        names = tuple(self.free.replace(",", " ").split()) if isinstance(self.free, str) else tuple(self.free)
        wrong = [name for name in names if name not in FREE]
        if wrong:
            raise self.error("free", wrong[0], f"must be one of {', '.join(FREE)}")
        if self.by not in WAYS:
            raise self.error("by", self.by, f"must be one of {', '.join(WAYS)}")
        for key in ("approach", "retract", "blend_radius", "dwell_s", "attach_within"):
            if not 0.0 <= getattr(self, key) < 100.0:
                raise self.error(key, getattr(self, key), "must not be negative, and below 100")
        if self.speed is not None and not 0.0 < self.speed < 100.0:
            raise self.error("speed", self.speed, "must be above 0 and below 100 m/s")
        if self.attach is not None and self.detach:
            raise self.error("attach", self.attach, "a target attaches or detaches, not both")
        try:
            T = orthonormalised(self.T_base_tool, tolerance=1e-6)
        except (A465Error, ValueError) as error:
            raise self.error("T_base_tool", np.shape(self.T_base_tool), str(error)) from error
        pairs = checked_pairs(f"target {self.name!r}: allowed_collisions", self.allowed_collisions)
        for key, value in (
            ("free", tuple(n for n in FREE if n in names)),
            ("T_base_tool", T),
            ("allowed_collisions", pairs),
        ):
            object.__setattr__(self, key, value)

    @property
    def pairs(self) -> frozenset[frozenset[str]]:
        """`allowed_collisions`, as a set of sets."""
        return frozenset(frozenset(pair) for pair in self.allowed_collisions)

    @property
    def stops(self) -> bool:
        """Whether the tool has to be at rest there."""
        return self.dwell_s > 0.0 or self.attach is not None or self.detach

    def error(self, key: str, value: object, rule: str) -> InputError:
        """That a value of this target breaks a rule."""
        return InputError(f"target {self.name!r}: {key} = {value!r}: {rule}", target=self.name, key=key)
