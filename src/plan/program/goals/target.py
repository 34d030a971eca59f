"""A goal of a program: a pose or configuration, its free directions, approach and retract, and the actions there."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from numbers import Integral, Real
from types import NoneType
from typing import Any

import numpy as np

from arm.arguments import numbers, shown
from arm.arguments import pairs as checked_pairs
from arm.errors import A465Error, InputError
from arm.former import renamed_arguments
from arm.se3 import Array, frozen, orthonormalised
from plan.curve.tool_curve import ToolCurve
from plan.kinematics.freedom import Freedom
from plan.kinematics.numeric_ik import FREE
from plan.options import PlanOptions

WAYS = ("transit", "line", "path")
ATTACH_WITHIN = 0.010  # m
ROLES = ("transit", "home")
_KINDS: tuple[tuple[str, Any, str], ...] = (
    ("name", str, "must be a name"),
    ("free", (str, Sequence), f"must be names out of {', '.join(FREE)}"),
    ("ranges", Mapping, 'must be like {"rz": (-0.5, 1.0)}'),
    ("attach", (str, NoneType), "must be the name of a body, or None"),
    ("detach", bool, "must be True or False"),
    ("back", bool, "must be True or False"),
    ("look", bool, "must be True or False"),
    ("cube", (Integral, NoneType), "must be a whole number, or None"),
    ("subject", str, "must be a name"),
    ("threaded", (str, NoneType), "must be the name of a thread, or None"),
)
_LENGTHS = ("approach", "retract", "blend_radius", "dwell_s", "attach_within", "settle_s", "look_before")
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

    The arm acts there at rest, in this order: jaws, attach or detach, dwell, look.

    Attributes:
        name: unique in its program; messages and steps contain it.
        T_base_tool: pose (4, 4), or alternative poses (k, 4, 4), m; with ``path`` the poses along it. Each rotation is
            replaced by the nearest proper one, which must differ by at most 1e-6. None for a configuration.
        free: unconstrained directions: names of `plan.kinematics.numeric_ik.FREE`, in the pose's own axes; a string
            separates them by spaces or commas. With a tilt or ranges of rotations only rz may be free, and x, y and z
            together; on a line any of x, y and z.
        ranges: directions that are free within limits: name to lowest and highest value, m or rad, in the pose's own
            axes (`plan.kinematics.freedom`).
        tilt: largest angle between the tool's z axis and the pose's, rad; instead of ranges of rx and ry.
        by: motion from the previous target: ``transit``, any path that keeps the clearance, or ``line``, straight for
            the tool. Along a line free directions keep their values; a single free rotation changes as little as
            possible. Near obstacles free rotations may change more (`plan.cartesian.clear_line`). Or ``path``: a
            transit to the first of the poses, then through all of them without a stop (`plan.curve`); what is free
            changes along the path as it is fastest.
        back: whether the tool returns along a path to its first pose, after the actions at its last one.
        approach, retract: lengths of the straight lines along the tool's own z axis, to the pose and from it, m. If
            `rz` is free, the tool may rotate about that axis near obstacles, unless collisions are allowed there.
        clearance_of: names of the bodies whose clearance is maximised along a path, if that is the aim; default: all.
        threaded: name of a thread of the scene that the arm's ring stays on along a path and back.
        speed: largest speed of the tool on the lines to and from the target, m/s (rad/s for a pure rotation); default:
            `approach_speed` times `speed` of the options, on a path as the joints allow.
        blend_radius: largest distance at which the tool may pass the pose, cutting its corner, m. With 0 the tool goes
            through the pose, and stops there if the path has a corner.
        dwell_s: time at rest, s.
        attach: name of the body to attach to the tool.
        attach_within: largest distance of that body from the hand (all bodies on the last joint) or from the origin of
            the tool frame, m.
        detach: whether to release the attached body.
        allowed_collisions: pairs of names that may touch on the lines to and from the target.
        line_clearance: clearance on these lines, m; default: that of the options.
        q: configuration (n,) rad (m for prismatic joints), instead of a pose.
        jaws: fraction by which the jaws close, 0 open to 1 shut; None: unchanged.
        settle_s: minimum wait after the jaws have moved, s.
        look: whether images are taken.
        look_before: the arm rests this far before the pose, on the approach, and images are taken there, m; less than
            `approach`. 0: it does not.
        role: role in the plan of the transit to the target: ``transit`` or ``home``.
        cube, subject: index and name of the cube that is moved; None and "" for none.
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
    look_before: float = 0.0
    role: str = "transit"
    cube: int | None = None
    subject: str = ""
    back: bool = False
    clearance_of: Collection[str] = frozenset()
    threaded: str | None = None

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
            raise self.error("attach", self.attach, "must not be combined with detach")
        if (self.T_base_tool is None) == (self.q is None):
            given = "both" if self.q is not None else None
            raise self.error("T_base_tool", given, "must be a pose, or give q instead")
        if self.q is not None and (names or self.freedom or self.by != "transit"):
            raise self.error("q", "a configuration", "needs by='transit' and must not have free directions")
        if self.back and self.by != "path":
            raise self.error("back", True, "needs by='path'")
        if self.threaded is not None and self.by != "path":
            raise self.error("threaded", self.threaded, "needs by='path'")
        if self.by == "path" and (self.approach > 0.0 or self.retract > 0.0):
            key = "approach" if self.approach > 0.0 else "retract"
            raise self.error(key, getattr(self, key), "must be 0 if by='path'; begin the path further out")
        if self.look_before > 0.0 and self.look_before >= self.approach:
            rule = f"must be less than approach, {shown(self.approach)} m, on which the arm rests to look"
            raise self.error("look_before", self.look_before, rule)
        pairs = checked_pairs(f"target {self.name!r}: allowed_collisions", self.allowed_collisions)
        for key, value in (
            ("free", tuple(n for n in FREE if n in names)),
            ("T_base_tool", self._poses()),
            ("allowed_collisions", pairs),
            ("q", self._configuration()),
            ("clearance_of", frozenset(self.clearance_of)),
        ):
            object.__setattr__(self, key, value)
        if self.by == "path":
            _ = self.curve

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
        names = self.clearance_of
        several = isinstance(names, Collection) and not isinstance(names, str)
        if not several or not all(isinstance(name, str) for name in names):
            raise self.error("clearance_of", names, 'must be names of bodies, such as ["post"]')
        if self.role not in ROLES:
            raise self.error("role", self.role, f"must be one of {', '.join(ROLES)}")

    def _require_freedom(self, free: tuple[str, ...]) -> None:
        for name, limits in self.ranges.items():
            if name not in FREE or name in free:
                rule = f"must be one of {', '.join(FREE)}, and must not be in `free` too"
                raise self.error("ranges", name, rule)
            pair = numbers(limits)
            most = 100.0 if name in FREE[:3] else np.pi
            if pair is None or pair.shape != (2,) or not -most <= pair[0] <= pair[1] <= most:
                rule = f"must be a lowest and a highest value from {-most:.5g} to {most:.5g} m or rad"
                raise self.error(f"ranges[{name!r}]", limits, rule)
        if self.tilt > 0.0 and {"rx", "ry"} & {*free, *self.ranges}:
            in_deg = f"{np.degrees(self.tilt):g} deg"
            raise self.error(
                "tilt", self.tilt, f"cannot be combined with rx or ry; tilt, {in_deg}, frees both"
            )
        # a rotation that is free within limits would rotate the axes of the other free directions
        turns = self.tilt > 0.0 or bool({"rx", "ry", "rz"} & set(self.ranges))
        every = {"x", "y", "z"}.issubset(free)
        turned = [name for name in free if name in ("rx", "ry") or (name in FREE[:3] and not every)]
        if turns and turned and not (self.by == "line" and {*turned} <= {"x", "y", "z"}):
            rule = "must not be free with a tilt or ranges of rotations; give it a range instead"
            raise self.error("free", turned[0], rule)

    @property
    def freedom(self) -> Freedom:
        """Its directions that are free within limits."""
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
        if self.by != "transit" and several != (self.by == "path"):
            rule = "must be one pose if by='line'" if several else "must be poses (k, 4, 4) if by='path'"
            raise self.error("T_base_tool", shape, rule)
        if several and not shape[0]:
            raise self.error("T_base_tool", shape, "must be at least one pose")
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

    @cached_property
    def curve(self) -> ToolCurve:
        """The path of ``by='path'``.

        Raises:
            InputError: all its poses are the same, or a direction is free that may not be on a path.
        """
        poses = np.zeros((0, 4, 4)) if self.T_base_tool is None else self.T_base_tool
        try:
            return ToolCurve(poses, self.freedom, tuple(self.free))
        except InputError as error:
            key = "free" if "free" in error.data else "T_base_tool"
            raise InputError(f"target {self.name!r}: {error}", target=self.name, key=key) from error

    @property
    def poses(self) -> Array:
        """Its alternative poses (k, 4, 4), of a path the last one; none for a configuration."""
        if self.T_base_tool is None:
            return np.zeros((0, 4, 4))
        if self.by == "path":
            return self.T_base_tool[-1:]
        return self.T_base_tool.reshape(-1, 4, 4)

    @property
    def pairs(self) -> frozenset[frozenset[str]]:
        """`allowed_collisions`, as a set of sets."""
        return frozenset(frozenset(pair) for pair in self.allowed_collisions)

    @property
    def stops(self) -> bool:
        """Whether the tool has to stop there."""
        acts = self.jaws is not None or self.attach is not None or self.detach
        return acts or self.dwell_s > 0.0 or self.look

    def clearance_on_lines(self, options: PlanOptions) -> float:
        """Return the clearance required on the lines to and from the target, m."""
        return options.line_clearance if self.line_clearance is None else self.line_clearance

    @property
    def prefix(self) -> str:
        """Prefix of the names of its steps."""
        return f"{self.subject}: " if self.subject else ""

    def error(self, key: str, value: object, rule: str) -> InputError:
        """Return the error for a value of this target that breaks a rule."""
        return InputError(f"target {self.name!r}: {key} = {shown(value)}: {rule}", target=self.name, key=key)
