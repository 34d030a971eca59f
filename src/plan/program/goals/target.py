"""A goal of a program: where the tool goes, what is free there, how it comes and leaves, what happens there."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from numbers import Integral, Real
from types import NoneType
from typing import Any

import numpy as np

from arm.arguments import numbers, shown
from arm.arguments import pairs as checked_pairs
from arm.errors import A465Error, InputError
from arm.former import renamed_arguments
from arm.se3 import Array, frozen, orthonormalised
from plan.kinematics.numeric_ik import FREE
from plan.options import PlanOptions
from plan.program.goals.freedom import Freedom

WAYS = ("transit", "line")
ATTACH_WITHIN = 0.010  # m
ROLES = ("transit", "home")
_KINDS: tuple[tuple[str, Any, str], ...] = (
    ("name", str, "must be a name"),
    ("free", (str, Sequence), f"must be names out of {', '.join(FREE)}"),
    ("ranges", Mapping, 'must be like {"rz": (-0.5, 1.0)}'),
    ("attach", (str, NoneType), "must be the name of a body, or None"),
    ("detach", bool, "must be True or False"),
    ("look", bool, "must be True or False"),
    ("cube", (Integral, NoneType), "must be a whole number, or None"),
    ("subject", str, "must be a name"),
)
_LENGTHS = ("approach", "retract", "blend_radius", "dwell_s", "attach_within", "settle_s")
_NUMBERS = (
    *((key, 0.0, 100.0, "must not be negative, and at most 100") for key in _LENGTHS),
    ("speed", 1e-6, 100.0, "must be above 0, and at most 100 m/s"),
    ("jaws", 0.0, 1.0, "must be from 0 (open) to 1 (shut)"),
    ("tilt", 0.0, np.pi / 2.0, "must be from 0 to pi / 2 rad"),
    ("line_clearance", 0.0, 0.1, "must be from 0 to 0.1 m"),
)
_OPTIONAL = ("speed", "jaws", "line_clearance")


@renamed_arguments(within="blend_radius", touching="allowed_collisions")
@dataclass(frozen=True, eq=False)
class Target:
    """One goal of a program: a pose, one of several poses, or a configuration.

    What happens there happens at rest, in this order: jaws, attach or detach, dwell, look.

    Attributes:
        name: for people and messages; unique in its program.
        T_base_tool: pose (4, 4), or poses (k, 4, 4) of which any will do, m; corrected to the nearest rotation, by at
            most 1e-6. None for a configuration.
        free: what of the pose may be anything: names out of `plan.kinematics.numeric_ik.FREE`, in the pose's
            own axes; several in one text are parted by spaces or commas. Beside a tilt or ranges of turns only rz, and
            x, y and z together; on a line any of x, y and z.
        ranges: what of the pose is free within limits: name out of `FREE` to lowest and highest value, m or rad, in the
            pose's own axes (`plan.program.goals.freedom`).
        tilt: largest angle between the tool's z axis and the pose's, rad; instead of ranges of rx and ry.
        by: how it is reached from the one before: ``transit``, any path that keeps the clearance, or ``line``, the tool
            straight. On a line the tool keeps what is free of its end as it is; a single free rotation turns as little
            as it can. Where something is near on the line, what is free turns as far as it has to.
        approach, retract: lengths of straight lines along the tool's own z axis, into the pose and out of it, m. Where
            something is near on them and `rz` is free, the tool turns about that axis, unless something may touch.
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
        line_clearance: clearance on these lines, m; default: that of the options.
        q: configuration (n,) rad (m for sliding joints), instead of a pose.
        jaws: closed fraction of the jaws' stroke from here on, 0 open to 1 shut; None: unchanged.
        settle_s: shortest wait after the jaws have moved, s.
        look: whether the arm looks from here.
        role: role of the transit to it in the plan: ``transit`` or ``home``.
        cube, subject: index and name of the cube that it serves; None and "" if it serves none.
    """

    name: str
    T_base_tool: Array | None = None
    free: str | Sequence[str] = ()
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    tilt: float = 0.0
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
    line_clearance: float | None = None
    q: Array | None = None
    jaws: float | None = None
    settle_s: float = 0.0
    look: bool = False
    role: str = "transit"
    cube: int | None = None
    subject: str = ""

    def __post_init__(self) -> None:
        self._require_types()
        names = tuple(self.free.replace(",", " ").split()) if isinstance(self.free, str) else tuple(self.free)
        wrong = [name for name in names if name not in FREE]
        if wrong:
            raise self.error("free", wrong[0], f"must be one of {', '.join(FREE)}")
        self._require_freedom(names)
        if self.by not in WAYS:
            raise self.error("by", self.by, f"must be one of {', '.join(WAYS)}")
        if self.attach is not None and self.detach:
            raise self.error("attach", self.attach, "a target attaches or detaches, not both")
        if (self.T_base_tool is None) == (self.q is None):
            raise self.error(
                "T_base_tool", "both" if self.q is not None else None, "give a pose, or q instead"
            )
        if self.q is not None and (names or self.freedom or self.by == "line"):
            raise self.error("q", "a configuration", "goes with by='transit', and nothing of it is free")
        pairs = checked_pairs(f"target {self.name!r}: allowed_collisions", self.allowed_collisions)
        for key, value in (
            ("free", tuple(n for n in FREE if n in names)),
            ("T_base_tool", self._poses()),
            ("allowed_collisions", pairs),
            ("q", self._configuration()),
        ):
            object.__setattr__(self, key, value)

    def _require_types(self) -> None:
        for key, kinds, rule in _KINDS:
            value = getattr(self, key)
            if not isinstance(value, kinds) or (key == "name" and not value):
                raise self.error(key, value, rule)
        for key, low, high, rule in _NUMBERS:
            value = getattr(self, key)
            real = isinstance(value, Real) and not isinstance(value, bool)
            if not (value is None and key in _OPTIONAL) and not (real and low <= value <= high):
                raise self.error(key, value, rule)
        if self.role not in ROLES:
            raise self.error("role", self.role, f"must be one of {', '.join(ROLES)}")

    def _require_freedom(self, free: tuple[str, ...]) -> None:
        for name, limits in self.ranges.items():
            if name not in FREE or name in free:
                rule = f"must be one of {', '.join(FREE)}, and not free as well"
                raise self.error("ranges", name, rule)
            pair = numbers(limits)
            most = 100.0 if name in FREE[:3] else np.pi
            if pair is None or pair.shape != (2,) or not -most <= pair[0] <= pair[1] <= most:
                rule = f"must be a lowest and a highest value from {-most:.5g} to {most:.5g} m or rad"
                raise self.error(f"ranges[{name!r}]", limits, rule)
        if self.tilt > 0.0 and {"rx", "ry"} & {*free, *self.ranges}:
            raise self.error("tilt", self.tilt, "cannot be combined with rx or ry")
        # what turns within limits would turn the axes of what is free along with it
        turns = self.tilt > 0.0 or bool({"rx", "ry", "rz"} & set(self.ranges))
        every = {"x", "y", "z"}.issubset(free)
        turned = [name for name in free if name in ("rx", "ry") or (name in FREE[:3] and not every)]
        if turns and turned and not (self.by == "line" and {*turned} <= {"x", "y", "z"}):
            rule = "cannot be free beside a tilt or ranges of turns; give it a range instead"
            raise self.error("free", turned[0], rule)

    @property
    def freedom(self) -> Freedom:
        """What of the pose is free within limits."""
        return Freedom(self.ranges, self.tilt)

    def _poses(self) -> Array | None:
        """Return the pose or poses, corrected to the nearest rotations."""
        if self.T_base_tool is None:
            return None
        given = numbers(self.T_base_tool)
        if given is None or given.shape[-2:] != (4, 4) or given.ndim > 3:
            shape_of = self.T_base_tool if given is None else given
            raise self.error("T_base_tool", shape_of, "must be a pose (4, 4), or poses (k, 4, 4)")
        shape, several = given.shape, given.ndim == 3
        if several and (self.by == "line" or not shape[0]):
            rule = "must be one pose, since a line leads to it" if shape[0] else "must be at least one pose"
            raise self.error("T_base_tool", shape, rule)
        try:
            poses = [orthonormalised(T, tolerance=1e-6) for T in given.reshape(-1, 4, 4)]
        except (A465Error, ValueError) as error:
            raise self.error("T_base_tool", shape, str(error)) from error
        return frozen(np.stack(poses)) if several else poses[0]

    def _configuration(self) -> Array | None:
        q = None if self.q is None else numbers(self.q)
        if self.q is not None and (q is None or q.ndim != 1 or not np.isfinite(q).all()):
            raise self.error("q", self.q, "must be one finite number per joint, rad")
        return None if q is None else frozen(q)

    @property
    def poses(self) -> Array:
        """Its poses (k, 4, 4), of which any will do; none for a configuration."""
        if self.T_base_tool is None:
            return np.zeros((0, 4, 4))
        return self.T_base_tool.reshape(-1, 4, 4)

    @property
    def pairs(self) -> frozenset[frozenset[str]]:
        """`allowed_collisions`, as a set of sets."""
        return frozenset(frozenset(pair) for pair in self.allowed_collisions)

    @property
    def stops(self) -> bool:
        """Whether the tool has to be at rest there."""
        acts = self.jaws is not None or self.attach is not None or self.detach
        return acts or self.dwell_s > 0.0 or self.look

    def clearance_on_lines(self, options: PlanOptions) -> float:
        """Clearance required on the lines that lead to the target and out of it, m."""
        return options.line_clearance if self.line_clearance is None else self.line_clearance

    @property
    def prefix(self) -> str:
        """What the names of its steps begin with."""
        return f"{self.subject}: " if self.subject else ""

    def error(self, key: str, value: object, rule: str) -> InputError:
        """That a value of this target breaks a rule."""
        return InputError(f"target {self.name!r}: {key} = {shown(value)}: {rule}", target=self.name, key=key)
