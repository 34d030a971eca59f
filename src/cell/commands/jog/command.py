"""``a465 jog``: a key moves the arm one step; every step is certified before it is sent.

The terminal is read by a thread of its own. Each key has its time of arrival, and `driver.mars.streaming.jog` sends no
step that would end too late after it.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from arm.errors import ExecutionStopped, ImpossibleError, InputError
from cell.commands.jog.keys import HELP, JOINTS, Press, presses
from cell.commands.jog.steps import StepMaker
from cell.commands.manual.session import (
    arrive,
    beside,
    manual_speed,
    q_now,
    require_consent,
    scene_now,
)
from cell.config.calibration_state import calibration_lines
from cell.console import Console
from cell.files.task import read_place
from cell.session.dialogue import at_terminal
from cell.session.homed import home_or_check, which_arm
from cell.session.keyboard import reading_keys
from cell.task.run import TaskRun
from driver.mars.streaming.jog import REST_S, Jog

DEG, MM = 0.1, 0.5  # default steps
RANGE_DEG, RANGE_MM = (0.01, 1.0), (0.05, 5.0)
JOINT_SPEED = np.radians(10.0)  # rad/s, of every joint
TOOL_SPEED = 0.05  # m/s
IDLE_END_S = 300.0  # without a key
WAIT_S = 0.1


@dataclass
class Choice:
    """What a key moves, and how far.

    Attributes:
        axis: joint, or direction of the tool.
        deg, mm: steps.
    """

    axis: str = JOINTS[0]
    deg: float = DEG
    mm: float = MM

    @property
    def size(self) -> float:
        """The step, rad or m."""
        return float(np.radians(self.deg)) if self.axis in JOINTS else 1e-3 * self.mm

    def describe(self) -> str:
        """Name axis and step."""
        if self.axis in JOINTS:
            return f"{self.axis}, step {self.deg:g} deg"
        return (
            f"the tool along {'its own z axis' if self.axis == 'along' else self.axis}, step {self.mm:g} mm"
        )

    def scale(self, sign: int) -> None:
        """Double or halve the step, in its range."""
        if self.axis in JOINTS:
            self.deg = float(np.clip(self.deg * 2.0**sign, *RANGE_DEG))
        else:
            self.mm = float(np.clip(self.mm * 2.0**sign, *RANGE_MM))


@dataclass(eq=False)
class Session:
    """A jog on an open arm: what was pressed, and what is to be told.

    Attributes:
        jog: sends the steps.
        maker: makes them.
        console: output.
        choice: what a key moves.
        keys: bytes of the terminal with their time of arrival; another thread appends to them.
    """

    jog: Jog
    maker: StepMaker
    console: Console
    choice: Choice
    keys: deque[tuple[bytes, float]] = field(default_factory=deque)

    def __post_init__(self) -> None:
        self.nearest = self.maker.distance(self.jog.end)
        self._clock = self.jog.mars.clock
        self._told, self._was_moving = "", False
        self._pressed_at = self._clock.now()

    def run(self) -> None:
        """Act on keys until one ends it, or none comes for `IDLE_END_S`.

        Raises:
            ExecutionStopped: stopped by a key or the end of the terminal while the arm may move, or a fault.
        """
        jog = self.jog
        while True:
            while self.keys:
                data, at = self.keys.popleft()
                self._pressed_at = at
                for press in presses(data):
                    if press.act == "stop" and (jog.moving or not data):
                        why = "stopped by a key" if data else "the terminal is gone"
                        raise ExecutionStopped(why, reason="aborted" if data else "terminal")
                    if press.act in ("stop", "end"):
                        return
                    self._act(press, at)
            if self._clock.now() > self._pressed_at + IDLE_END_S:
                self.console.say(f"no key for {IDLE_END_S:g} s")
                return
            jog.serve(self._clock.now() + WAIT_S)
            if self._was_moving and not jog.moving:
                self._tell_place()
            self._was_moving = jog.moving

    def _act(self, press: Press, at: float) -> None:
        choice = self.choice
        if press.act == "choose":
            choice.axis = press.axis
        elif press.act == "scale":
            choice.scale(press.sign)
        if press.act != "move":
            self._tell(choice.describe())
            return
        jog, by = self.jog, press.sign * choice.size
        start, arrow = jog.end, "+" if press.sign > 0 else "-"
        try:
            step = self.maker.step(start, choice.axis, by)
        except ImpossibleError as error:
            self._tell(f"{choice.axis} {arrow}: stays: {error}")
            return
        direction = f"{choice.axis}{by:+g}"
        if jog.step(step.by, direction, at, step.tool_m / TOOL_SPEED):
            self.maker.took(start, choice.axis, by, jog.end)
            self._told = ""
        elif not jog.moving:
            slow = f"this step would take longer than {REST_S:g} s from the key until the arm rests"
            self._tell(f"{choice.axis} {arrow}: stays: {slow}; halve it with the key ,")

    def _tell(self, text: str) -> None:
        """Say a line, unless it was said last."""
        if text != self._told:
            self.console.say(text)
        self._told = text

    def _tell_place(self) -> None:
        unit = self.jog.mars.unit
        degrees = ", ".join(f"{d:.2f}" for d in np.degrees(unit.positions(self.jog.end)) + 0.0)
        clear = self.maker.distance(self.jog.end)
        self.nearest = min(self.nearest, clear)
        self._tell(f"at [{degrees}] deg, {1e3 * clear:.1f} mm clear")


def choice_of(axis: str | None, deg: float, mm: float) -> Choice:
    """Return the choice at the beginning.

    Raises:
        InputError: a step is out of its range.
    """
    for name, value, (low, high), unit in (("--deg", deg, RANGE_DEG, "deg"), ("--mm", mm, RANGE_MM, "mm")):
        if not low <= value <= high:
            raise InputError(
                f"{name} {value:g}: must be from {low:g} to {high:g} {unit}", option=name, value=value
            )
    return Choice(axis or JOINTS[0], deg, mm)


def jog_step(
    place: Path, port: str | None, look: Path | None, deg: float, mm: float, console: Console
) -> dict[str, Any]:
    """Move the arm by keys of the terminal.

    Args:
        place: cell or task file.
        port: of the controller; see `cell.session.ports.choose_port`.
        look: detected boards, which stand there still; None: the whole zone for boards counts as occupied.
        deg, mm: steps of joints and tool.
        console: output.

    Raises:
        InputError: a file, value or port is wrong, there is no terminal, or the name was not typed; nothing moved.
        ImpossibleError: the unit was not homed, or the arm may not move.
        ExecutionStopped: stopped while it moved, or a fault; the state is in the error's data.
    """
    task, choice = read_place(place), choice_of(None, deg, mm)
    cell = task.cell
    if not at_terminal():
        raise InputError("jog needs a terminal, whose keys move the arm; a465 move goes to a stated place")
    makers: list[StepMaker] = []

    def ask(run: TaskRun) -> None:
        q = q_now(run)
        makers.append(StepMaker(cell, scene_now(run, look)))
        degrees = ", ".join(f"{d:.1f}" for d in np.degrees(q) + 0.0)
        arm = f"{which_arm(run.connection.mars.link.url)}, {cell.unit.name}"
        console.say(f"this moves {arm}, step by step, without a preview; it is at [{degrees}]")
        for line in calibration_lines(cell, camera=False):
            console.say(line)
        console.say(
            f"each step keeps {1e3 * cell.clearance:g} mm of clearance to what the cell file has"
            + ("; the zone for boards counts as occupied" if look is None else " and the look has seen")
        )
        for pair in makers[0].too_near(tuple(map(int, cell.unit.counts(q)))):
            console.say(f"{pair}: first, only steps that lead them apart are made")
        require_consent(False, "", console, f"type {cell.unit.name} to let it move:", cell.unit.name)

    with beside(task, port, console, "jog", manual_speed(cell, None), ask, keys=None, look=look) as run:
        mars = run.connection.mars
        home_or_check(mars, cell, console, True, jaws_too=False)
        run.homed = True
        mars.anchor(mars.settled_counts())
        for line in HELP:
            console.say(line)
        keys: deque[tuple[bytes, float]] = deque()

        def deliver(data: bytes) -> None:
            keys.append((data, mars.clock.now()))
            mars.link.wake()

        with (
            reading_keys(deliver, fresh=True) as heard,
            mars.guarded("jog"),
        ):  # STOP is sent before the terminal is restored
            if not heard:
                raise ExecutionStopped("the terminal is gone", reason="terminal")
            jog = Jog(mars, np.abs(cell.unit.counts_per_rad) * JOINT_SPEED)
            session = Session(jog, makers[0], console, choice, keys)
            console.say(choice.describe())
            session.run()
            jog.finish()
        run.tell(f"{jog.steps} steps; at every rest at least {1e3 * session.nearest:.1f} mm clear")
        return {
            **arrive(run, run.report()),
            "steps": jog.steps,
            "clear_at_rest_mm": round(1e3 * session.nearest, 3),
        }
