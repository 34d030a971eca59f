"""How a task is planned: speeds, clearances, seed. Every value is checked; a plan's provenance lists them all."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from arm.arguments import integer, number, shown
from arm.errors import InputError
from plan.budget import TransitBudget

LOOKS = ("each", "never")
CHOICES = ("free", "given")
CERTIFICATES = ("tight", "decide")
LEAST_CLEARANCE = 0.005  # m, that may be asked for in transits unless `least_clearance` says less


def told_clearance(options: Mapping[str, Any]) -> str:
    """That a plan with these options (`PlanOptions.to_json`) asks for less clearance than is usual; "" if not."""
    clearance = options.get("clearance")
    if clearance is None or clearance >= LEAST_CLEARANCE:
        return ""
    return (
        f"asked for {clearance * 1e3:g} mm of clearance only, by name (least_clearance); the usual least is "
        f"{LEAST_CLEARANCE * 1e3:g} mm"
    )


_SLOWEST, _SLOWEST_AT = 0.002, 0.5  # m/s, at that speed and above


@dataclass(frozen=True)
class PlanOptions:
    """Options of `plan.pick_place.planner.plan_task`.

    Attributes:
        speed: factor on velocities (and its square on accelerations), 0 < speed <= 1.
        velocity_fraction, acceleration_fraction: of the limits at that speed that motion is planned for; the rest is
            room for rounding to counts and for what the controller adds at joins of segments.
        clearance: asked for in transits, between all bodies that the arm or the held cube could touch, m.
        least_clearance: that may be asked for in transits, m. Certificates hold for the bodies and the calibration as
            they are given, so less than the usual 5 mm is asked for by name only, and told wherever the plan is shown.
        line_clearance: asked for on approach and retract, where the jaws pass the cube and the plate, m; the
            contacts that the station needs are left out.
        offset: length of approach and retract, m.
        approach_speed: of the tool on approach and retract at speed 1, m/s.
        fraction_closed: target of the jaws when gripping, 0 open to 1 shut.
        jerk_time: s in which an acceleration builds up to its limit; 0 for none: acceleration may step. With a limit on
            jerk the arm also rests at every corner and at the offset points (`plan.trajectory.jerk_limited`).
        settle_s: least wait after the jaws moved, s.
        segment_ms: duration of a motion segment where nothing asks for less.
        look: ``each``: home and look after every cube; ``never``: from cube to cube, home at the end; or a number n:
            home and look after every n cubes, and at the end.
        order, assignment: ``free``: which cube is next, and to which of the places it goes, is chosen for time;
            ``given``: as the transfers are given.
        certificate: ``tight`` proves clearances close to the true ones, ``decide`` only that what is asked for is kept,
            which is cheaper.
        seed: of every random choice.
        transit: tries of the transit search.
    """

    speed: float = 0.5
    velocity_fraction: float = 0.9
    acceleration_fraction: float = 0.5
    clearance: float = 0.010
    least_clearance: float = LEAST_CLEARANCE
    line_clearance: float = 0.005
    offset: float = 0.1
    approach_speed: float = 0.1
    fraction_closed: float = 0.9
    jerk_time: float = 0.0
    settle_s: float = 1.0
    segment_ms: int = 100
    look: str | int = "each"
    order: str = "free"
    assignment: str = "free"
    certificate: str = "tight"
    seed: int = 0
    transit: TransitBudget = field(default_factory=TransitBudget)

    @property
    def slowest(self) -> float:
        """Tool speed at which joints must still keep up on lines, m/s (`plan.cartesian.differential_ik.LineOptions`).

        That rule finds lines too near a singular configuration. Below half of the registers' speed everything is
        slower in proportion, and so is this: else a low speed alone would be taken for such a line.
        """
        return _SLOWEST * min(self.speed / _SLOWEST_AT, 1.0)

    def __post_init__(self) -> None:
        self._within("speed", 1e-3, 1.0)
        self._within("velocity_fraction", 1e-2, 1.0)
        self._within("acceleration_fraction", 1e-2, 1.0)
        self._within("least_clearance", 0.0, LEAST_CLEARANCE, "m")
        self._within("clearance", 0.0, 1.0, "m")
        if self.least_clearance == LEAST_CLEARANCE and 0.0 <= self.clearance < LEAST_CLEARANCE:
            raise InputError(
                f"clearance = {self.clearance:g} m: must be from {LEAST_CLEARANCE:g} to 1 m; who means less says so by "
                "least_clearance",
                name="clearance",
                value=self.clearance,
            )
        self._within("clearance", self.least_clearance, 1.0, "m")
        self._within("line_clearance", 0.0, 0.1, "m")
        self._within("offset", 1e-3, 1.0, "m")
        self._within("approach_speed", 1e-3, 2.0, "m/s")
        self._within("jerk_time", 0.0, 2.0, "s")
        self._within("fraction_closed", 0.0, 1.0)
        self._within("settle_s", 0.0, 60.0, "s")
        object.__setattr__(self, "segment_ms", integer("segment_ms", self.segment_ms, 1))
        self._within("segment_ms", 40, 2000, "ms")
        object.__setattr__(self, "seed", integer("seed", self.seed, 0))
        if not isinstance(self.transit, TransitBudget):
            raise InputError(
                f"transit = {shown(self.transit)}: must be a TransitBudget, such as TransitBudget(rrt=3000)",
                name="transit",
            )
        if self.look not in LOOKS and (
            not isinstance(self.look, int) or isinstance(self.look, bool) or self.look < 1
        ):
            raise InputError(
                f"look = {self.look!r}: must be one of {', '.join(LOOKS)}, or a number of cubes from 1 on",
                value=self.look,
            )
        for name, known in (("order", CHOICES), ("assignment", CHOICES), ("certificate", CERTIFICATES)):
            if getattr(self, name) not in known:
                raise InputError(
                    f"{name} = {getattr(self, name)!r}: must be one of {', '.join(known)}",
                    name=name,
                    value=getattr(self, name),
                )

    def _within(self, name: str, low: float, high: float, unit: str = "") -> None:
        value = getattr(self, name)
        checked = number(name, value, low, high, unit)
        if not isinstance(value, int | float):  # a number of numpy's, which JSON does not know
            object.__setattr__(self, name, checked)

    def looks_after(self, cubes: int) -> bool:
        """Whether the arm goes home to look once this many cubes were moved, more being left."""
        if self.look == "never":
            return False
        return self.look == "each" or cubes % int(self.look) == 0

    def to_json(self) -> dict[str, Any]:
        """All options as JSON types."""
        return asdict(self)
