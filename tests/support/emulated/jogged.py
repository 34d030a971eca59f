"""A jog in stepped time: keys come at stated times, and the unit keeps a record of where the arm was."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from arm.controller.unit import Unit
from cell.commands.jog.command import JOINT_SPEED, Choice, Session
from cell.commands.jog.steps import StepMaker
from cell.config.cell import Cell
from driver.emulator import Emulator, EmulatorOptions, Fault
from driver.line.stepped_clock import SteppedClock
from driver.mars.mars import Mars
from driver.mars.streaming.jog import Jog
from emulated.stepped_cell import set_homed
from plan.scene import Scene
from typed.heard import Heard


@dataclass(eq=False)
class Jogged:
    """A unit at rest, and a jog on it."""

    emulator: Emulator
    clock: SteppedClock
    mars: Mars
    jog: Jog
    heard: Heard = field(default_factory=Heard)
    session: Session | None = None
    last_key_s: float = 0.0

    @property
    def keys_session(self) -> Session:
        """The session of `jogged_cell`."""
        assert self.session is not None
        return self.session

    def press(self, at_s: float, data: bytes) -> None:
        """Let a terminal deliver these bytes then."""
        session = self.keys_session

        def arrive() -> None:
            session.keys.append((data, self.clock.now()))
            self.mars.link.wake()

        self.last_key_s = max(self.last_key_s, at_s)
        self.clock.call_at(at_s, arrive)

    def hold(
        self, at_s: float, data: bytes, for_s: float, every_s: float = 1 / 30, first_s: float = 0.3
    ) -> float:
        """Hold a key: it comes at once, after the delay of repeats, and then at their rate; return the last time."""
        times = [at_s, *np.arange(at_s + first_s, at_s + for_s, every_s)]
        for time in times:
            self.press(float(time), data)
        return float(times[-1])

    def rests_at(self) -> float:
        """Return the time at which the arm last moved, s."""
        return self.emulator.last_motion()[0] / 1e3

    def serve(self, until_s: float) -> None:
        """Let the jog serve the link until then, and until the arm is at rest."""
        while self.clock.now() < until_s or self.jog.moving:
            self.jog.serve(self.clock.now() + 0.05)


@contextmanager
def jogged(
    unit: Unit,
    at_deg: Sequence[float],
    *faults: Fault,
    nominal: Unit | None = None,
    options: Mapping[str, Any] | None = None,
) -> Iterator[Jogged]:
    """A jog on a unit that was homed and stands there; faults begin with the jog."""
    clock = SteppedClock()
    made = EmulatorOptions(power_up_deg=tuple(at_deg), **(options or {}))
    with Emulator(nominal or unit, clock, options=made) as emulator:
        set_homed(emulator)
        with Mars(emulator.open_line(), unit, clock) as mars:
            mars.identify()
            mars.initialise(home=False)
            mars.anchor(mars.settled_counts())
            for fault in faults:
                emulator.inject(fault)
            with mars.guarded("jog"):
                yield Jogged(emulator, clock, mars, Jog(mars, np.abs(unit.counts_per_rad) * JOINT_SPEED))


@contextmanager
def jogged_cell(
    cell: Cell, scene: Scene, at_deg: Sequence[float], choice: Choice | None = None
) -> Iterator[Jogged]:
    """A jog by keys among the bodies of a scene."""
    with jogged(cell.unit, at_deg, nominal=cell.nominal_unit) as made:
        made.session = Session(made.jog, StepMaker(cell, scene), made.heard, choice or Choice())
        yield made
