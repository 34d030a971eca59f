"""Apply faults to an emulated unit: begin and end the effect of each kind of `Fault`."""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Callable

from driver.emulator.commands import Interpreter
from driver.emulator.faults.line import LineFaults
from driver.emulator.faults.model import LINE_KINDS, Fault, FaultEvent
from driver.emulator.faults.schedule import Schedule
from driver.emulator.line.ports import Ports
from driver.emulator.unit.machine import Machine

_NOISE = b"\x00\xff\x80\xfe"  # at power-up, unless the options give another


class FaultInjector:
    """The faults of one unit. Not thread-safe: the emulator's lock guards it.

    Args:
        interpreter: of the unit, with its machine and its options.
        ports: of the unit.
        tell: called with every event.

    Attributes:
        schedule: faults still to come.
        line: present faults of the serial line.
        events: beginnings and ends of faults; the latest `EmulatorOptions.keep_lines`.
        switched_off: the unit executes and answers nothing.
    """

    def __init__(self, interpreter: Interpreter, ports: Ports, tell: Callable[[FaultEvent], None]) -> None:
        self.machine: Machine = interpreter.machine
        self._interpreter = interpreter
        self._ports = ports
        self._tell = tell
        self.schedule = Schedule(self.machine.options.faults)
        self.line = LineFaults()
        self.events: deque[FaultEvent] = deque(maxlen=self.machine.options.keep_lines)
        self.switched_off = False
        self._port_work: list[bool] = []  # True: restore
        self.watch_segments()

    def watch_segments(self) -> None:
        """Trigger the faults that wait for segments already begun, and make the machine halt at the next one."""
        begun = self.machine.path.begun
        if begun >= self.schedule.next_segment():
            self.schedule.segments(begun, self.machine.now_ms)
        self.machine.halt_at_segment = self.schedule.next_segment()

    def apply_due(self, now_ms: float) -> None:
        """Apply all faults that are due."""
        while self.schedule.next_at() <= now_ms:
            self.apply(*self.schedule.take())

    def apply(self, fault: Fault, over: bool = False) -> None:
        """Begin a fault now, or end it."""
        event = FaultEvent(self.machine.now_ms, fault, over)
        self.events.append(event)
        self._tell(event)
        lasts_ms = 1e3 * fault.back_after_s if fault.kind == "port_gone" else fault.for_ms
        if lasts_ms and not over:
            self.schedule.put(self.machine.now_ms + lasts_ms, fault, over=True)
        if fault.kind in LINE_KINDS:
            (self.line.end if over else self.line.begin)(fault)
        else:
            self._set(fault, over)
        if self.machine.faulty:
            self.machine.freeze()

    def _set(self, fault: Fault, over: bool) -> None:
        """Set or clear the state in which a fault of the unit or the arm consists."""
        machine, defects = self.machine, self.machine.defects
        match fault.kind:
            case "power_off":
                machine.power = over
            case "motion_stop":
                machine.motion_stop = not over
            case "axis_error":
                machine.axis_errors.add(fault.axis)
            case "port_gone":
                self._port_work.append(over)
                for wire in self._ports.wires:
                    wire.forget()
                    wire.cut = True
            case "power_cycle":
                self._power_cycle(fault, over)
            case "stuck_axis" | "drift" | "lag" if over:
                machine.following.end(fault)
            case "stuck_axis" | "drift" | "lag":
                machine.following.begin(fault, machine.path.at)
            case "queue_overflow" if fault.queue:
                lowered = defects.queue is None
                defects.queue = fault.queue if lowered else None
            case "queue_overflow":
                defects.drop_segments += fault.count
            case "missed_grasp":
                defects.miss_grasps += fault.count
            case "early_ready":
                defects.early_ready += fault.count
            case "fail_reply":
                defects.fail_replies += fault.count
            case "stray_line":
                self._send(fault.text.encode("ascii") + b"\r\n")
            case "noise":
                self._send(random.Random(fault.seed).randbytes(fault.count))

    def _send(self, data: bytes) -> None:
        for wire in self._ports.wires:
            if wire.heard:
                for late, piece in self.line.to_host(data):
                    wire.answer(piece, self.machine.now_ms, late)

    def _power_cycle(self, fault: Fault, over: bool) -> None:
        if not over:
            self.machine.power_cycle()
            self._interpreter.power_up()
            for wire in self._ports.wires:
                wire.forget()
            self.switched_off = True
        if over or not fault.for_ms:
            self.switched_off = False
            self._send(self.machine.options.noise or _NOISE)

    def serve_ports(self) -> None:
        """Close and restore ports as faults require; only in the thread that waits for their bytes.

        Raises:
            OSError, A465Error: a port cannot be restored.
        """
        for restore in self._port_work:
            (self._ports.restore if restore else self._ports.lose)()
        self._port_work.clear()
