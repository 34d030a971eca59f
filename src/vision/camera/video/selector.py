"""Select a video source: ``video:0``, ``video:/dev/video2``, ``video:rtsp://host/path`` or ``video:clip.mp4``."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal
from urllib.parse import urlsplit

from arm.credentials import hide_credentials, without_url
from arm.errors import InputError
from vision.camera.frame_source import IMAGE_SUFFIXES

PREFIX = "video:"
STREAMS = ("rtsp", "rtsps", "rtmp", "http", "https", "rtp", "udp", "tcp", "srt")
COUNTED = ("http", "https")  # their time stamps may be a count of frames, as those of motion JPEG are
FORMS = "video:NUMBER, video:/dev/NAME, video:URL or video:FILE"
_SIZED = re.compile(r"(?P<device>\d+|/dev/[^@]+)@(?P<width>\d{2,5})x(?P<height>\d{2,5})")
_HALF_SIZED = re.compile(r"(\d+|/dev/[^@]+)@.*")
CALLED = ("rtsp", "rtsps", "rtmp", "http", "https")  # their URLs name a host
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
    source: str = field(repr=False)  # may hold a password
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
        shown = hide_credentials(self.source)
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
        InputError: it is empty, an image, a stream of an unknown protocol, a URL without host or with a port that is
            none, or a device with a size that is none.
    """
    source = text.strip().removeprefix(PREFIX).strip()
    if not is_video(text) or not source:
        raise InputError(f"camera {without_url(text)!r}: must be {FORMS}", camera=without_url(text))
    if scheme := _SCHEME.match(source):
        if scheme[1].lower() not in STREAMS:
            why = f"camera {PREFIX}{scheme[1]}://...: a stream's protocol must be one of {', '.join(STREAMS)}"
            raise InputError(why, camera=scheme[1])
        _require_host(source)
        return VideoSelector("stream", source)
    if sized := _SIZED.fullmatch(source):
        return VideoSelector("device", sized["device"], (int(sized["width"]), int(sized["height"])))
    if found := _HALF_SIZED.fullmatch(source):
        rule = f"its size must be WIDTHxHEIGHT in px: {PREFIX}{found[1]}@1920x1200"
        raise InputError(f"camera {PREFIX}{source}: {rule}", camera=source)
    path = Path(source)
    if path.suffix.lower() in IMAGE_SUFFIXES:
        rule = f"is an image, and {PREFIX}FILE is a recording; --images FOLDER reads a folder of images"
        raise InputError(f"camera {PREFIX}{source}: {rule}", camera=source)
    if source.isdigit() or path.is_char_device() or (source.startswith("/dev/") and not path.is_file()):
        return VideoSelector("device", source)
    return VideoSelector("file", source)


def _require_host(url: str) -> None:
    """Refuse a URL that names no place, also because of characters in its password; do not print any of it.

    Raises:
        InputError: it has a space or quote, no host, or a port that is not a number from 1 to 65535.
    """
    try:
        parts = urlsplit(url)
        fits = parts.port != 0 and (bool(parts.hostname) or parts.scheme not in CALLED)
    except ValueError:
        fits = False
    if not fits or re.search(r"[\s'\"]", url):
        rule = "must be a URL with a host and a port from 1 to 65535, if any; write space / ? # @ ' \" of a name or "
        rule += "password as %20 %2F %3F %23 %40 %27 %22"
        shown = f"{PREFIX}{without_url(url)}"
        raise InputError(f"camera {shown}: {rule}", camera=shown)
