"""Lines that are sent once at start-up, built from the unit's parameters."""

from __future__ import annotations

from arm.controller.unit import Unit
from driver.line.protocol import VERTEX_STEPS, encode

ENGAGE_MS = 300  # speed 0 for this long closes the shoulder's loop; can fail if the arm is horizontal [D]


def axis_lines(unit: Unit) -> list[str]:
    """Set controller parameters, speed and acceleration limits of the arm's axes, and the idle release."""
    lines = [
        encode(register, value, axis=axis)
        for register, values in unit.axis_registers.items()
        for axis, value in zip(unit.axes, values, strict=True)
    ]
    lines += limit_lines(unit, unit.speed_registers, unit.acceleration_registers)
    return [*lines, encode("IDLEREL", unit.idle_release_s)]


def limit_lines(unit: Unit, speed: tuple[int, ...], acceleration: tuple[int, ...]) -> list[str]:
    """Set speed (REGMS) and acceleration (REGACC) limits of the arm's axes.

    Raises:
        InputError: a register is below 1 or above the unit's cap.
    """
    unit.limits(speed, acceleration)
    return [encode("REGMS", v, axis=a) for a, v in zip(unit.axes, speed, strict=True)] + [
        encode("REGACC", v, axis=a) for a, v in zip(unit.axes, acceleration, strict=True)
    ]


def gripper_lines(unit: Unit) -> list[str]:
    """Set up the gripper as an analog servo axis; nothing for an arm without one."""
    gripper = unit.gripper
    if not gripper.fitted:
        return []
    setup = encode("ANAXSETUP", gripper.adc_channel, gripper.current_channel, axis=gripper.axis)
    return [setup, *(encode(name, value, axis=gripper.axis) for name, value in gripper.registers.items())]


def engage_line(unit: Unit) -> str:
    """Close the shoulder's servo loop without moving it."""
    return encode("SPDT", 0, ENGAGE_MS, axis=unit.axes[1])


def group_lines(unit: Unit) -> list[str]:
    """Form the coordinated group of the arm's axes, and set the speed jump allowed at a vertex."""
    return [encode("COORDGRP", *unit.axes), encode("COORDDISCONT", VERTEX_STEPS)]


def slow_registers(unit: Unit) -> tuple[int, ...]:
    """Return the speed registers of a slow move: a fifth of the default, the lowest that the public client allows."""
    return tuple(max(1, round(r / 5)) for r in unit.speed_registers)


def move_time(distance: tuple[int, ...], speed: tuple[int, ...], acceleration: tuple[int, ...]) -> float:
    """Return the shortest time, s, of a straight joint move from rest to rest: the slowest axis' trapezoid.

    Args:
        distance: per axis, counts.
        speed: counts/256 per ms.
        acceleration: counts/256 per ms^2.
    """
    slowest = 0.0
    for d, v, a in zip(distance, speed, acceleration, strict=True):
        length, v_ms, a_ms2 = abs(d), v / 256.0, a / 256.0
        reaches_speed = length * a_ms2 > v_ms**2
        time_ms = length / v_ms + v_ms / a_ms2 if reaches_speed else 2.0 * (length / a_ms2) ** 0.5
        slowest = max(slowest, time_ms / 1e3)
    return slowest
