"""A session with a MARS-8 controller: identify, initialise, single moves, grip, stop.

Every wait has a deadline in controller seconds. A motion may end early by a fault, a silent line, an interrupt, or an
error in the caller's code. The driver then sends STOP before it raises, and the error carries the arm's state.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

from arm.controller.unit import Unit
from arm.errors import ExecutionStopped, ImpossibleError, InputError
from driver.execution.guard import Guarded
from driver.execution.pause import RELEASE_MARGIN_S
from driver.execution.rest import RestState, farthest, refuse_not_arrived, refuse_outside
from driver.line.clock import Clock
from driver.line.link import Link
from driver.line.manners import Manners
from driver.line.port import Port
from driver.line.protocol import Position, Status, encode, parse_integer
from driver.line.wire_log import WireLog
from driver.mars.absolute_move import send_verified
from driver.mars.gripper import GripperResult, move_gripper, read_jaws
from driver.mars.identity import gripper_answers, identify, refuse_another
from driver.mars.ready import refuse_failure, wait_ready
from driver.mars.refusals import (
    refuse_displaced,
    refuse_faults,
    refuse_unhomed,
)
from driver.mars.running import ParameterScale
from driver.mars.start import startup
from driver.mars.start.homing import home_all
from driver.mars.start.registers import Registers
from driver.mars.stopping import bring_to_rest, read_position, read_status

ENGAGE_S = 5.0  # time limit for closing the shoulder's loop
MOVE_FACTOR, MOVE_S = 1.5, 5.0  # time limit of a move: this factor on its shortest time, plus this


class Session(Guarded):
    """One arm on one controller, without paths (`driver.mars.mars.Mars` has these). A context manager (`Guarded`).

    Call `identify`, then `initialise`, then move. Not thread-safe.

    Args:
        port: see `Link`.
        unit: the expected arm and controller.
        clock: controller time; default wall time.
        log: records every byte and event.

    Attributes:
        reference: end of the controller's path generator, (6,) counts. None if it is not known, as after opening or a
            stop; relative segments must not be sent then.
        manners: how the unit echoes, once it is identified.
        registers: sets registers and reads them back.
        parameters: scale of the unit's segment parameter, learnt during dwells.

    Raises:
        InputError: the port does not exist, is not a serial line, or is in use.
    """

    def __init__(
        self, port: str | Port, unit: Unit, clock: Clock | None = None, log: WireLog | None = None
    ) -> None:
        super().__init__(unit, clock or Clock())
        self.log = log
        self.link = Link(port, self.clock, log)
        self.reference: tuple[int, ...] | None = None
        self.speed_registers = unit.speed_registers
        self.acceleration_registers = unit.acceleration_registers
        self.manners = Manners(echoes=False, adapter=False, takes_turns=False)
        self.parameters = ParameterScale()
        self.registers = Registers(self.link)
        self._group_formed = False
        self._initialised = False
        self._last_motion = self.clock.now()

    @property
    def identified(self) -> bool:
        """Whether `identify` has succeeded."""
        return self.link.identified

    def close(self) -> None:
        """Close the port."""
        self.link.close()

    # -- start-up

    def identify(self) -> str:
        """Identify the controller by ECHO, STAMP and VER alone. Return the firmware text.

        Raises:
            InputError: nothing answers like a MARS, or its firmware is not the unit's.
        """
        version, self.manners = identify(self.link, self.unit.firmware)
        self.note("manners", **asdict(self.manners))
        return version

    def require_unit(self) -> None:
        """Refuse an arm that is not of this unit, by queries alone: one whose gripper is on the axis of another.

        Raises:
            InputError: it is another arm.
        """
        answers = gripper_answers(self.link)
        self.note("whose_arm", unit=self.unit.name, gripper_axes=answers)
        refuse_another(self.unit, answers)

    def initialise(self, home: bool = True, soft_home: bool = True) -> None:
        """Set the registers, form the coordinated group, and home.

        Args:
            home: False if the unit was homed and has stayed powered since; nothing moves then.
            soft_home: after homing, move to the unit's soft home, straight in joint space. False leaves the arm at its
                marks, so that a planner can move it around obstacles.

        Raises:
            InputError: `identify` was not called, or the gripper is on the axis of another unit; nothing was set.
            ImpossibleError: arm power off, motion stop or an axis error; or positions that cannot be right.
            ExecutionStopped: homing failed; with the state.
        """
        if not self.link.identified:
            raise InputError("initialise: call identify() first")
        self._initialised = False
        self.require_unit()
        with self.guarded("initialise"):
            self.link.send(encode("PURGE"))
            self.link.synchronise(attempts=2)  # a stop drops unsent bytes
            rest = self.stop()
        if not rest.at_rest:
            raise ExecutionStopped(f"initialise: {rest.describe(self.unit)}", state=rest.to_json())
        refuse_faults(self.status())
        with self.guarded("initialise"):
            self.registers.forget()
            self.registers.tell(*startup.axis_lines(self.unit), *startup.gripper_lines(self.unit))
            self._engage()
            self.registers.tell(*startup.group_lines(self.unit))
            self._group_formed = True
            self.speed_registers = self.unit.speed_registers
            self.acceleration_registers = self.unit.acceleration_registers
            self.note("read_back", **self.registers.answers)
        if home:
            with self.guarded("homing", lost="its position is lost: home it again"):
                home_all(self.link, self.unit, self.settled_counts)
        else:
            refuse_unhomed(self.unit, self.counts())
        self._initialised = True
        if home and soft_home:
            self.move_to([int(c) for c in self.unit.counts(self.unit.soft_home)])

    def status(self) -> Status:
        """Read the status word."""
        return read_status(self.link)

    def require_well(self, what: str) -> None:
        """Read the status, and refuse to continue after a fault, ``FAIL!``, or a power cycle of the unit.

        Raises:
            ExecutionStopped: with the reason ``fault`` or ``restarted``.
        """
        refuse_failure(self.link, self.status(), what)

    def position(self) -> Position:
        """Read time, segment and counts.

        Raises:
            InputError: before `initialise`, which forms the coordinated group; without it the unit does not answer.
        """
        if not self._group_formed:
            why = "position: call initialise() first; on a unit that is homed, home=False moves nothing"
            raise InputError(why)
        return read_position(self.link, len(self.unit.axes))

    def counters(self) -> tuple[int, ...]:
        """Read the axes' counters, (6,), also before `initialise`. They are positions once the arm is homed.

        Raises:
            InputError: `identify` was not called.
        """
        if not self.link.identified:
            raise InputError("counters: call identify() first")
        return tuple(parse_integer(self.link.ask("AP", axis)) for axis in self.unit.axes)

    def counts(self) -> tuple[int, ...]:
        """Read the encoder counts, (6,)."""
        return self.position().counts

    # -- moving

    def set_registers(self, speed: Sequence[int], acceleration: Sequence[int]) -> None:
        """Set the speed and acceleration limits of the six axes. Only while the arm is at rest.

        Raises:
            InputError: a register is above its cap.
            ExecutionStopped: the arm is moving (the effect on queued segments is unknown).
        """
        lines = startup.limit_lines(self.unit, tuple(speed), tuple(acceleration))
        if self.status().busy:
            raise ExecutionStopped("registers can change only while the arm is at rest", reason="busy")
        self.registers.tell(*lines)
        self.speed_registers, self.acceleration_registers = tuple(speed), tuple(acceleration)

    def move_to(self, counts: Sequence[int]) -> tuple[int, ...]:
        """Move straight in joint space to absolute counts. Return the counts at which the arm settled.

        Raises:
            InputError: not one count per axis.
            ImpossibleError: outside the unit's limits; nothing moved.
            ExecutionStopped: did not arrive, or settled further from the target than `Unit.rest_tolerance`; with the
                state.
        """
        target = tuple(int(c) for c in counts)
        if len(target) != len(self.unit.axes):
            raise InputError(
                f"counts = {list(target)}: {len(target)} values, must be {len(self.unit.axes)}, one per axis",
                counts=list(target),
            )
        refuse_outside(self.unit, target, "target")
        with self.guarded("move"):
            if self.reference is None and self.link.echoes:
                self.anchor(self.require_ready())  # slow, to where it is; the move itself is then verified
            return self._go(target)

    def anchor(self, counts: Sequence[int]) -> None:
        """Set the start of the controller's path generator to these counts, which must be close to the arm's.

        After a stop, a release or a push the generator may end elsewhere than the arm is, and a relative segment would
        make the arm jump. So the arm first moves slowly to its measured position, in absolute counts
        (docs/sources.md, "What is not known of the controller").

        Raises:
            ImpossibleError: the arm is further than `Unit.rest_tolerance` from `counts`; nothing moved.
            ExecutionStopped: the arm did not arrive; with the state.
        """
        target = tuple(int(c) for c in counts)
        with self.guarded("anchor"):
            here = self.require_ready()
        if farthest(here, target) > self.unit.rest_tolerance:
            why = (
                f"the arm is {farthest(here, target)} counts from {list(target)}, must be at most "
                f"{self.unit.rest_tolerance}; move there by a planned motion"
            )
            raise ImpossibleError(why, counts=list(here), target=list(target))
        with self.guarded("anchor"):
            speed, acceleration = self.speed_registers, self.acceleration_registers
            self.set_registers(startup.slow_registers(self.unit), acceleration)
            self._go(here)
            if target != here:
                self._go(target)
            self.set_registers(speed, acceleration)

    def _go(self, target: tuple[int, ...]) -> tuple[int, ...]:
        here = self.require_ready()
        distance = tuple(b - a for a, b in zip(here, target, strict=True))
        seconds = startup.move_time(distance, self.speed_registers, self.acceleration_registers)
        line, verifiable = encode("COORDMV", *target), self.reference is not None and self.link.echoes
        if self.reference is None:
            self.registers.tell(*startup.group_lines(self.unit))  # a stop may have dissolved the group
        self.reference = None
        if verifiable:
            send_verified(self.link, len(self.unit.axes), line)
        else:
            self.link.send(line)
        wait_ready(self.link, "COORDMV", MOVE_FACTOR * seconds + MOVE_S)
        return self.arrived(target)

    def arrived(self, target: Sequence[int], held_back: int = 0) -> tuple[int, ...]:
        """Wait until the arm settles after a motion to `target`, the new reference. Return the settled counts.

        Args:
            target: counts.
            held_back: how many counts beyond `Unit.rest_tolerance` contact may hold an axis back.

        Raises:
            ExecutionStopped: further from `target`, or it does not settle.
        """
        goal = tuple(int(c) for c in target)
        end = self.settled_counts()
        refuse_not_arrived(self.unit, end, goal, held_back)
        self.reference = goal
        self._last_motion = self.clock.now()
        return end

    def require_ready(self, held: int = 0) -> tuple[int, ...]:
        """Check that the arm may move and is where the last motion left it. Return its counts.

        Args:
            held: how many counts beyond `Unit.rest_tolerance` contact may hold an axis off its target.

        Raises:
            ExecutionStopped: not initialised, a fault, moving, or displaced (pushed, or power-cycled).
        """
        if not self._initialised:
            raise ExecutionStopped("call initialise() before any motion", reason="order")
        idle_s = self.clock.now() - self._last_motion
        if self.unit.idle_release_s and idle_s > self.unit.idle_release_s - RELEASE_MARGIN_S:
            self._engage()  # IDLEREL has released the arm, or is about to
        status = self.status()
        if status.fault or status.busy:
            why = " and ".join(status.faults()) or "it is still moving"
            raise ExecutionStopped(f"the arm cannot move: {why}", status=status.word, reason="fault")
        here = self.counts()
        if self.reference is not None and farthest(here, self.reference) > self.unit.rest_tolerance:
            here = self.counts()  # the answer may have been damaged on the line
        if self.reference is not None:
            refuse_displaced(self.unit, here, self.reference, held)
        return here

    def _engage(self) -> None:
        self.link.send(startup.engage_line(self.unit))
        wait_ready(self.link, "engage the shoulder", ENGAGE_S)
        self._last_motion = self.clock.now()

    def gripper(self, fraction_closed: float) -> GripperResult:
        """Move the jaws, 0 open to 1 closed, and wait until they rest, at the target or on an object.

        Raises:
            InputError: `fraction_closed` is not from 0 to 1, or the arm carries no gripper.
            ExecutionStopped: a fault, or the jaws do not come to rest in time; with the state.
        """
        if not 0.0 <= fraction_closed <= 1.0:
            why = f"fraction_closed = {fraction_closed:g}: must be from 0 to 1"
            raise InputError(why, value=fraction_closed)
        self._require_gripper()
        with self.guarded("gripper"):
            if not self._initialised:
                raise ExecutionStopped("call initialise() before any motion", reason="order")
            result = move_gripper(self.link, self.unit.gripper, fraction_closed)
            self.position()  # raises if the unit was switched off meanwhile: it has lost its grip then
            return result

    def jaws(self) -> float:
        """Read how far the jaws are closed, 0 open to 1 closed. Nothing moves.

        Raises:
            InputError: the arm carries no gripper.
            ExecutionStopped: no answer; with the state.
        """
        self._require_gripper()
        with self.guarded("jaws"):
            return read_jaws(self.link, self.unit.gripper)

    def _require_gripper(self) -> None:
        if not self.unit.gripper.fitted:
            raise InputError(f"{self.unit.name}: the arm carries no gripper", unit=self.unit.name)

    # -- stopping

    def stop(self) -> RestState:
        """Send STOP at once and wait until the arm is at rest. Return its state. Never raises for a failing link."""
        self.reference = None
        state = bring_to_rest(self.link, self.unit.axes if self._group_formed else ())
        self.note("stop", **state.to_json())
        return state

    # -- requests of another thread or a signal handler, and waiting for them

    def wait_until(self, until: float) -> None:
        """Wait until controller time `until` or until `wake`. Lines received meanwhile are dropped, except events.

        Raises:
            Aborted, LinkLost: at once.
        """
        while self.clock.now() < until and self.link.receive(until) is not None:
            pass

    def wake(self) -> None:
        """Make a waiting `wait_until`, or the stream, go on now."""
        self.link.wake()

    def interrupt(self) -> None:
        """Make what waits or sends, or does so next, raise `Aborted`, once."""
        self.link.interrupt()

    def note(self, kind: str, **data: object) -> None:
        """Record an event in the log, if there is one."""
        if self.log is not None:
            self.log.note(kind, **data)
