"""Select one of the connected Basler cameras."""

from __future__ import annotations

import ipaddress
import re
import warnings
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from arm.credentials import without_url
from arm.errors import CameraError, InputError

KINDS = ("name", "serial", "ip", "class")
EMULATED = "BaslerCamEmu"  # device class of pylon's emulation


@dataclass(frozen=True)
class FoundDevice:
    """A camera listed by pylon, whether or not it can be opened.

    Attributes:
        name: user-defined; "" if none.
        serial: number on its label.
        ip: address of a GigE camera, else "".
        device_class: of its interface: BaslerGigE, BaslerUsb, BaslerCamEmu, ...
        model: such as acA1920-40gm.
    """

    name: str
    serial: str
    ip: str
    device_class: str
    model: str

    @property
    def marks(self) -> dict[str, str]:
        """What a selector of each kind compares, by `KINDS`."""
        return dict(zip(KINDS, (self.name, self.serial, self.ip, self.device_class), strict=True))

    def __str__(self) -> str:
        return " ".join([self.model, *(f"{kind}:{mark}" for kind, mark in self.marks.items() if mark)])


@dataclass(frozen=True)
class Selector:
    """Criterion that selects a camera.

    Attributes:
        kind: one of `KINDS`, or "" for a bare text, which is a user-defined name or else a serial number.
        text: required value.
    """

    kind: str
    text: str

    def __str__(self) -> str:
        return f"{self.kind}:{self.text}" if self.kind else self.text

    def choose(self, found: Sequence[FoundDevice]) -> int:
        """Return the index of the one matching device in `found`.

        Raises:
            CameraError: none or several match; the message lists all that were found.
        """
        for kind in (self.kind,) if self.kind else ("name", "serial"):
            fitting = [number for number, device in enumerate(found) if device.marks[kind] == self.text]
            if len(fitting) == 1:
                return fitting[0]
            if fitting:
                raise self._refused(found, "ambiguous", f"matches {len(fitting)} cameras; use serial:NUMBER")
        if not self.kind and (file := Path(self.text)).exists() and not self._webcam():
            what = (
                "folder (images of a folder: --images)"
                if file.is_dir()
                else f"file (a recording: video:{file})"
            )
            raise self._refused(found, "missing", f"is no camera but a {what}")
        if not found:
            rule = "not found, nor is any other; is it powered, and is its cable plugged in?"
            raise self._refused(found, "missing", f"{rule}{self._webcam()}")
        raise self._refused(found, "missing", f"not found{self._webcam()}")

    def _webcam(self) -> str:
        """What a number or a device of a webcam, or an address, is written as; "" for what is none."""
        is_webcam = not self.kind and re.fullmatch(r"[0-9]{1,2}|/dev/(video|v4l/).+", self.text)
        if not self.kind and re.fullmatch(r"(\d{1,3}\.){3}\d{1,3}", self.text):
            return f" (for a camera of this address give ip:{self.text})"
        return f" (for a webcam give video:{self.text})" if is_webcam else ""

    def _refused(self, found: Sequence[FoundDevice], reason: str, rule: str) -> CameraError:
        there = f"; connected: {', '.join(map(str, found))}" if found else ""
        return CameraError(self, reason, f"{rule}{there}", found=[asdict(device) for device in found])


def load_pylon() -> tuple[Any, Any]:
    """Import pypylon's modules `genicam` and `pylon`.

    Raises:
        ImportError: it is not installed, or cannot be loaded.
    """
    with warnings.catch_warnings():
        # its SWIG types warn; as an error (python -W error) that would crash the interpreter
        warnings.simplefilter("ignore")
        from pypylon import genicam, pylon
    return genicam, pylon


def find_devices(pylon: Any) -> list[tuple[FoundDevice, Any]]:
    """List the cameras that `pylon` (the library) finds, each with pylon's own record of it."""

    def device(info: Any) -> FoundDevice:
        ip = info.GetIpAddress() if info.IsIpAddressAvailable() else ""
        names = info.GetUserDefinedName(), info.GetSerialNumber(), ip, info.GetDeviceClass()
        return FoundDevice(*names, info.GetModelName())

    return [(device(info), info) for info in pylon.TlFactory.GetInstance().EnumerateDevices()]


def _meant(shown: str, kind: str) -> str:
    """What may be meant by a selector of no such kind."""
    if kind.lower() in KINDS and kind:
        return f"kinds are written small: {kind.lower()}:"
    if "://" in shown:
        return f"a stream is video:{shown}"
    return "cameras of other makes are video:SOURCE"


def read_selector(text: str) -> Selector:
    """Parse a selector.

    ``name:camera-crs93``, ``serial:21923415``, ``ip:192.168.0.7`` or ``class:BaslerUsb``; a bare text is a user-defined
    name or else a serial number.

    Raises:
        InputError: it is empty, of another kind, or not a valid IP address.
    """
    kind, colon, rest = (part.strip() for part in text.partition(":"))
    if not colon:
        kind, rest = "", kind
    if (colon and kind not in KINDS) or not rest:
        shown = without_url(text)
        raise InputError(
            f"camera {shown!r}: must be name:NAME, serial:NUMBER, ip:ADDRESS or class:CLASS; "
            f"a bare text is a user name or a serial number; {_meant(shown, kind)}",
            camera=shown,
        )
    if kind == "ip":
        try:
            rest = str(ipaddress.IPv4Address(rest))
        except ValueError as error:
            why = f"camera {text!r}: {error}; must be such as ip:192.168.0.7"
            raise InputError(why, camera=text) from error
    return Selector(kind, rest)
