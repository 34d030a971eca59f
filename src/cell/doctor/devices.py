"""``a465 doctor``: check serial ports, the controller on one of them, and cameras."""

from __future__ import annotations

import grp
import os
import time
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from arm.errors import CameraError, InputError
from cell.doctor.finding import NOTE, OK, CheckResult

if TYPE_CHECKING:
    from cell.config.cell import Cell

VIDEO_DEVICES = Path("/sys/class/video4linux")
FIRMWARE = "MARS8"  # that every known unit reports


def check_ports() -> CheckResult:
    """List the serial ports, and whether this user may open them. Open none."""
    from serial.tools import list_ports

    ports = [_port(d) for d in sorted({p.device for p in list_ports.comports(include_links=True)})]
    data = {"ports": ports}
    if not ports:
        help = "a real arm needs one: plug in its adapter; the simulated cell needs none"
        return CheckResult("serial ports", NOTE, "none", help, data)
    closed = [p for p in ports if not p["may_open"]]
    shown = ", ".join(p["device"] + ("" if p["may_open"] else " (no permission)") for p in ports)
    if closed:
        groups = " or ".join(sorted({p["group"] for p in closed if p["group"]})) or "dialout"
        help = f"join the group {groups}: sudo usermod -aG GROUP USER, and log in again"
        return CheckResult("serial ports", NOTE, shown, help, data)
    them = "it" if len(ports) == 1 else "them"
    return CheckResult("serial ports", OK, f"{shown}: you may open {them}", "", data)


def _port(device: str) -> dict[str, Any]:
    """Return a device, whether this user may open it, and the group that owns it, "" if unknown."""
    group = ""
    with suppress(OSError, KeyError):
        group = grp.getgrgid(os.stat(device).st_gid).gr_name
    return {"device": device, "may_open": os.access(device, os.R_OK | os.W_OK), "group": group}


def ask(url: str, firmware: str) -> dict[str, Any]:
    """Identify a unit by commands that are allowed before identification: they move and set nothing.

    Returns:
        The firmware version that it reports, and the wall time of an answer, `answer_s`.

    Raises:
        InputError: the port cannot be opened, or no unit with this firmware answers.
        ExecutionStopped: the port is lost during the exchange.
    """
    from driver.mars.identity import identified

    with identified(url, firmware) as (link, version):
        began = time.monotonic()
        link.synchronise()  # by STAMP
        return {"version": version, "answer_s": time.monotonic() - began}


def check_controller(port: str) -> CheckResult:
    """Identify the controller on a port.

    Raises:
        InputError, ExecutionStopped: see `ask`.
    """
    answer = ask(port, FIRMWARE)
    speed = f"answers in {1e3 * answer['answer_s']:.0f} ms"
    found = f"{port}: {answer['version']}; {speed}; it cannot report which arm it drives"
    return CheckResult("controller", OK, found, "", {"port": port, **answer})


def check_cameras() -> CheckResult:
    """List the cameras that pylon finds, and the video devices of this machine. Open none.

    Raises:
        CameraError: pylon fails.
    """
    from vision.camera.basler_devices import find_devices, load_pylon

    videos = _video_devices()
    others = [
        f"{v['name']} video:{v['device']}" + ("" if v["may_open"] else " (no permission)") for v in videos
    ]
    try:
        genicam, pylon = load_pylon()
    except ImportError as error:
        found = "; ".join([f"pylon cannot be loaded: {error}", *others])
        return CheckResult("cameras", NOTE, found, "make basler, for Basler cameras", {"videos": videos})
    try:
        devices = [device for device, _ in find_devices(pylon)]
    except genicam.GenericException as error:
        raise CameraError("of any kind", "pylon", f"pylon cannot list them: {error}") from error
    data = {"cameras": [asdict(device) for device in devices], "videos": videos}
    if not devices and not videos:
        help = "for a real cell: check the camera's power and its cable"
        return CheckResult("cameras", NOTE, "none: neither pylon's nor video devices", help, data)
    return CheckResult("cameras", OK, "; ".join([*map(str, devices), *others]), "", data)


def _video_devices() -> list[dict[str, Any]]:
    """Video devices of this machine; one camera may have several, not all of which take images."""
    found = []
    for file in sorted(VIDEO_DEVICES.glob("video*/name")):
        device = f"/dev/{file.parent.name}"
        found.append({"name": file.read_text().strip(), **_port(device)})
    return found


def check_photograph(selector: str, cell: Cell | None) -> CheckResult:
    """Take an image with one camera. What the camera does not tell about its images makes the verdict a note.

    Args:
        selector: selector of the camera; `cell.config.camera_keys.OF_CELL`: the one of the cell file.
        cell: cell with the camera's settings, the size of its images, and the markers that show whether it is sharp
            and exposed (`cell.doctor.sharpness`); None: any settings and size, and nothing about these.

    Raises:
        InputError: the selector is invalid.
        CameraError: the camera delivers no image.
    """
    from cell.config.camera_keys import OF_CELL
    from cell.doctor.sharpness import judge_image
    from cell.session.cameras import camera_by, device_of

    device = selector if selector != OF_CELL else device_of(None if cell is None else cell.live_camera)
    if device is None:
        why = f"--camera {OF_CELL} needs --cell FILE whose [look.basler] or [look.video] names a device"
        raise InputError(why, camera=selector)
    live, size = (None, None) if cell is None else (cell.live_camera, cell.camera.size)
    with camera_by(device, live, size) as camera:
        (image,) = camera.grab(1)
        description, doubts, stand_in = camera.description, camera.doubts, camera.stand_in
    grey = float(image.mean())
    data = {
        "camera": str(camera.selector),
        "size_px": list(image.shape[::-1]),
        "mean_grey": grey,
        "doubts": doubts,
        "stand_in": stand_in,
    }
    found = f"{description}; mean grey {grey:.0f} of 255"
    if cell is not None:
        data |= asdict(judge_image(image, cell))
    return CheckResult("photograph", NOTE if doubts else OK, found, "; ".join(doubts), data)
