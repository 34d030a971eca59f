"""Options of planning: speeds, clearances, seed. All values are checked, and a plan's provenance lists them."""

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
AIMS = ("time", "clearance")
SOLVERS = ("daqp", "osqp")
TIMINGS = ("own", "toppra")
LEAST_CLEARANCE = 0.005  # m, smallest `clearance` of transits unless `least_clearance` allows less


def clearance_words(options: Mapping[str, Any]) -> str:
    """Return a warning if these options (`PlanOptions.to_json`) have less clearance than the usual minimum, else ""."""
    clearance = options.get("clearance")
    if clearance is None or clearance >= LEAST_CLEARANCE:
        return ""
    return (
        f"planned with only {clearance * 1e3:g} mm of clearance, as least_clearance allows; the usual minimum is "
        f"{LEAST_CLEARANCE * 1e3:g} mm"
    )


_SLOWEST, _SLOWEST_AT = 0.002, 0.5  # m/s, and the speed factor from which it is constant


@dataclass(frozen=True)
class PlanOptions:
    """Options of `plan.program.tasks.plan_task`.

    Attributes:
        speed: factor on velocities (and its square on accelerations), 0 < speed <= 1.
        velocity_fraction, acceleration_fraction: fractions of the limits at that speed to plan with; the rest is for
            rounding to counts and for what the controller adds where segments join.
        clearance: required in transits, between all bodies that the arm or the held cube could touch, m.
        least_clearance: smallest `clearance` that is accepted, m. A certificate is only as good as the bodies and the
            calibration. So less than the usual 5 mm must be allowed here, and every display of the plan reports it.
        line_clearance: required on approach and retract, where the jaws pass the cube and the plate, m; contacts that
            the station allows are excepted.
        near_ends: whether a start or goal with less than `clearance` is accepted if no other configuration will do. One
            straight joint line to or from it is then certified with the clearance that it has, and the plan says so.
            Transfers never accept such ends.
        offset: length of approach and retract, m.
        approach_speed: tool speed on approach and retract at speed 1, m/s.
        fraction_closed: target of the jaws when gripping, 0 open to 1 shut.
        jerk_time: time in which an acceleration rises to its limit, s; 0 for no jerk limit. With a jerk limit the arm
            also stops at every corner and at the offset points (`plan.trajectory.jerk_limited`).
        settle_s: shortest wait after a motion of the jaws, s.
        segment_ms: duration of a segment unless a shorter one is needed, ms.
        look: ``each``: home and look after every cube; ``never``: from cube to cube, home at the end; or a number n:
            home and look after every n cubes, and at the end.
        order, assignment: ``free``: the planner chooses the next cube, and its destination, for time; ``given``: as in
            the list of transfers.
        certificate: ``tight`` proves clearances close to the true ones; ``decide`` only proves the required clearance,
            which is cheaper.
        aim: ``time``: the fastest plan with the required clearance; ``clearance``: the one with the largest clearance
            (`plan.program.aim`), which takes some ten times as long to plan.
        clearance_worth: with ``clearance``, how much longer a plan may be for more clearance, s per m; None: any time.
        solver: solver of the quadratic programs of lines (`plan.cartesian.differential_ik`): ``daqp`` or ``osqp``.
        timing: time parametrisation of joined motions and lines: ``own`` (`plan.trajectory.topp_ra`) or ``toppra``, the
            library of this name with our corrections (`plan.trajectory.toppra_timing`), without jerk limits.
        seed: seed of every random choice.
        transit: budget of the transit search.
    """

    speed: float = 0.5
    velocity_fraction: float = 0.9
    acceleration_fraction: float = 0.5
    clearance: float = 0.010
    least_clearance: float = LEAST_CLEARANCE
    line_clearance: float = 0.005
    near_ends: bool = False
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
    aim: str = "time"
    clearance_worth: float | None = None
    solver: str = "daqp"
    timing: str = "own"
    seed: int = 0
    transit: TransitBudget = field(default_factory=TransitBudget)

    @property
    def by_toppra(self) -> bool:
        """Whether the library times motions (`plan.trajectory.timing.time_curve`)."""
        return self.timing == "toppra"

    @property
    def slowest(self) -> float:
        """Tool speed that joints must allow on lines, m/s (`plan.cartesian.differential_ik.LineOptions`).

        Too near a singular configuration, joints cannot keep it. Below half of the registers' speed it is proportional
        to `speed`; otherwise a low speed alone would look like a singularity.
        """
        return _SLOWEST * min(self.speed / _SLOWEST_AT, 1.0)

    def __post_init__(self) -> None:
        self._within("speed", 1e-3, 1.0)
        self._within("velocity_fraction", 1e-2, 1.0)
        self._within("acceleration_fraction", 1e-2, 1.0)
        self._within("least_clearance", 0.0, LEAST_CLEARANCE, "m")
        self._within("clearance", 0.0, 1.0, "m")
        if self.least_clearance == LEAST_CLEARANCE and 0.0 <= self.clearance < LEAST_CLEARANCE:
            why = (
                f"clearance = {self.clearance:g} m: must be from {LEAST_CLEARANCE:g} to 1 m; set least_clearance to "
                "allow less"
            )
            raise InputError(why, name="clearance", value=self.clearance)
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
            why = f"transit = {shown(self.transit)}: must be a TransitBudget, such as TransitBudget(rrt=3000)"
            raise InputError(why, name="transit")
        if self.look not in LOOKS and (
            not isinstance(self.look, int) or isinstance(self.look, bool) or self.look < 1
        ):
            why = f"look = {self.look!r}: must be one of {', '.join(LOOKS)}, or a number of cubes, 1 or more"
            raise InputError(why, value=self.look)
        if self.clearance_worth is not None:
            self._within("clearance_worth", 1.0, 1e7, "s/m")
        for name, known in (
            ("order", CHOICES),
            ("assignment", CHOICES),
            ("certificate", CERTIFICATES),
            ("aim", AIMS),
            ("solver", SOLVERS),
            ("timing", TIMINGS),
        ):
            if getattr(self, name) not in known:
                why = f"{name} = {getattr(self, name)!r}: must be one of {', '.join(known)}"
                raise InputError(why, name=name, value=getattr(self, name))
        if self.timing == "toppra" and self.jerk_time > 0.0:
            why = f"timing = 'toppra': must be 'own' with a jerk limit (jerk_time = {self.jerk_time:g} s)"
            raise InputError(why, name="timing", value=self.timing)

    def _within(self, name: str, low: float, high: float, unit: str = "") -> None:
        value = getattr(self, name)
        checked = number(name, value, low, high, unit)
        if not isinstance(value, int | float):  # a numpy number, which JSON cannot encode
            object.__setattr__(self, name, checked)

    def looks_after(self, cubes: int) -> bool:
        """Return whether the arm goes home to look after `cubes` cubes, if more are left."""
        if self.look == "never":
            return False
        return self.look == "each" or cubes % int(self.look) == 0

    def to_json(self) -> dict[str, Any]:
        """Return all options as JSON types."""
        return asdict(self)
