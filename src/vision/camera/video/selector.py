"""Select a video source: ``video:0``, ``video:/dev/video2``, ``video:rtsp://host/path`` or ``video:clip.mp4``."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from arm.errors import InputError

PREFIX = "video:"
STREAMS = ("rtsp", "rtsps", "rtmp", "http", "https", "rtp", "udp", "tcp", "srt")
COUNTED = ("http", "https")  # their time stamps may be a count of frames, as those of motion JPEG are
FORMS = "video:NUMBER, video:/dev/NAME, video:URL or video:FILE"
_SIZED = re.compile(r"(?P<device>\d+|/dev/[^@]+)@(?P<width>\d{2,5})x(?P<height>\d{2,5})")
_SCHEME = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*)://")


@dataclass(frozen=True)
class VideoSelector:
    """A video source.

    Attributes:
        kind: a device of this machine, a stream from the network, or a file, which is a recording.
        source: number or path of the device, URL of the stream, or path of the file.
        size: width and height to ask of a device, px; None: not given.
    """

    kind: Literal["device", "stream", "file"]
    source: str
    size: tuple[int, int] | None = None

    @property
    def scheme(self) -> str:
        """Protocol of a stream, such as rtsp; "" for others."""
        found = _SCHEME.match(self.source)
        return found[1].lower() if found and self.kind == "stream" else ""

    @property
    def path(self) -> Path:
        """Path of a device or file."""
        return Path(f"/dev/video{self.source}" if self.source.isdigit() else self.source)

    def __str__(self) -> str:
        shown = (
            re.sub(r"(://[^/@:]*):[^/]*@", r"\1:***@", self.source) if self.kind == "stream" else self.source
        )
        return f"{PREFIX}{shown}" + ("" if self.size is None else f"@{self.size[0]}x{self.size[1]}")


def is_video(selector: str) -> bool:
    """Whether a selector of ``--camera`` is one of a video source."""
    return selector.strip().startswith(PREFIX)


def read_video(text: str) -> VideoSelector:
    """Parse the selector of a video source.

    Digits are a device's number; a character device, or any name in /dev that is not a regular file, is a device; a
    text with ``://`` is a stream; all else is a file. A device may state the size of its images:
    ``video:0@1920x1080``.

    Raises:
        InputError: it is empty, or a stream of an unknown protocol.
    """
    source = text.strip().removeprefix(PREFIX).strip()
    if not is_video(text) or not source:
        raise InputError(f"camera {text!r}: must be {FORMS}", camera=text)
    if scheme := _SCHEME.match(source):
        if scheme[1].lower() not in STREAMS:
            why = f"camera {PREFIX}{scheme[1]}://...: a stream's protocol must be one of {', '.join(STREAMS)}"
            raise InputError(why, camera=scheme[1])
        return VideoSelector("stream", source)
    if sized := _SIZED.fullmatch(source):
        return VideoSelector("device", sized["device"], (int(sized["width"]), int(sized["height"])))
    path = Path(source)
    if source.isdigit() or path.is_char_device() or (source.startswith("/dev/") and not path.is_file()):
        return VideoSelector("device", source)
    return VideoSelector("file", source)
