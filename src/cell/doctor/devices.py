"""``a465 doctor``: serial ports, what answers on one of them, and cameras."""

from __future__ import annotations

import grp
import os
import time
import warnings
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from arm.errors import CameraError, InputError
from cell.doctor.finding import NOTE, OK, Finding

if TYPE_CHECKING:
    from cell.config.cell import Cell

FIRMWARE = "MARS8"  # of every unit that is known


def ports_finding() -> Finding:
    """Serial ports that are there, and whether this user may open them. Opens none."""
    from serial.tools import list_ports

    ports = [_port(d) for d in sorted({p.device for p in list_ports.comports(include_links=True)})]
    data = {"ports": ports}
    if not ports:
        return Finding(
            "serial ports",
            NOTE,
            "none",
            "a real arm needs one: plug in its adapter; the simulated cell none",
            data,
        )
    closed = [p for p in ports if not p["may_open"]]
    shown = ", ".join(p["device"] + ("" if p["may_open"] else " (not for you)") for p in ports)
    if closed:
        groups = " or ".join(sorted({p["group"] for p in closed if p["group"]})) or "dialout"
        help = f"join the group {groups}: sudo usermod -aG GROUP USER, and log in anew"
        return Finding("serial ports", NOTE, shown, help, data)
    return Finding(
        "serial ports", OK, f"{shown}: you may open {'it' if len(ports) == 1 else 'them'}", "", data
    )


def _port(device: str) -> dict[str, Any]:
    return {
        "device": device,
        "may_open": os.access(device, os.R_OK | os.W_OK),
        "group": _group(device),
    }


def _group(device: str) -> str:
    """That owns a device; "" if that cannot be told."""
    try:
        return grp.getgrgid(os.stat(device).st_gid).gr_name
    except (OSError, KeyError):
        return ""


@dataclass(frozen=True)
class Answered:
    """What a unit says of itself, and the wall time of an answer."""

    version: str
    answer_s: float

    def to_json(self) -> dict[str, Any]:
        """Both."""
        return asdict(self)


def ask(url: str, firmware: str) -> Answered:
    """Ask a unit who it is. Nothing is sent but what may be sent to one that has not named itself.

    Raises:
        InputError: the port cannot be opened, or nothing answers like a unit with this firmware.
        ExecutionStopped: the port is lost meanwhile.
    """
    from driver.line.clock import Clock
    from driver.line.link import Link
    from driver.mars.identity import identify

    link = Link(url, Clock())
    try:
        version, _ = identify(link, firmware)
        began = time.monotonic()
        link.synchronise()  # by STAMP
        return Answered(version, time.monotonic() - began)
    finally:
        link.close()


def controller_finding(port: str) -> Finding:
    """What answers on a port.

    Raises:
        InputError, ExecutionStopped: see `ask`.
    """
    told = ask(port, FIRMWARE)
    found = (
        f"{port}: {told.version}; answers in {1e3 * told.answer_s:.0f} ms. Which arm it drives it cannot tell"
    )
    return Finding("controller", OK, found, "", {"port": port, **told.to_json()})


def cameras_finding() -> Finding:
    """The cameras that pylon lists. Opens none.

    Raises:
        CameraError: pylon refuses.
    """
    from vision.camera.basler_devices import find_devices

    try:
        with warnings.catch_warnings():
            # its SWIG types warn; warnings that are errors (python -W error) would crash the interpreter
            warnings.simplefilter("ignore")
            from pypylon import genicam, pylon
    except ImportError as error:
        return Finding("cameras", NOTE, f"pylon cannot be asked: {error}", "make basler")
    try:
        devices = [device for device, _ in find_devices(pylon)]
    except genicam.GenericException as error:
        raise CameraError("of any kind", "pylon", f"pylon cannot list them: {error}") from error
    data = {"cameras": [asdict(device) for device in devices]}
    if not devices:
        help = "of a real cell: has it power, is its cable plugged in?"
        return Finding("cameras", NOTE, "pylon sees none", help, data)
    return Finding("cameras", OK, "; ".join(map(str, devices)), "", data)


def photograph_finding(selector: str, cell: Cell | None) -> Finding:
    """Takes a photograph with one camera.

    Args:
        selector: which camera; `cell.config.camera_keys.OF_CELL` is the one that the cell file names.
        cell: whose settings it gets, and whose lens says how large a photograph is; None: any.

    Raises:
        InputError: the selector is none.
        CameraError: there is no photograph.
    """
    from cell.config.camera_keys import OF_CELL
    from vision.camera.basler import BaslerCamera

    device = selector if selector != OF_CELL else None if cell is None else cell.basler.device
    if device is None:
        raise InputError(
            f"--camera {OF_CELL} needs --cell FILE whose [look.basler] names a device", camera=selector
        )
    settings, size = (None, None) if cell is None else (cell.basler.settings, cell.camera.size)
    with BaslerCamera(device, settings, size) as camera:
        (image,) = camera.grab(1)
        told = camera.description
    grey = float(image.mean())
    return Finding(
        "photograph",
        OK,
        f"{told}; mean grey {grey:.0f} of 255",
        "",
        {"camera": selector, "size_px": list(image.shape[::-1]), "mean_grey": grey},
    )
