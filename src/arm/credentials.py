"""Hide user names, passwords and keys of URLs in whatever is printed, logged or stored."""

from __future__ import annotations

import re

HIDDEN = "***"
_USER = re.compile(r"://(?:(?!: |://).)+@")  # to the last @, as passwords may contain one
_QUERY = re.compile(r"(://[^\s'\"?=]*[?=])[^\s'\"]*[^\s'\".,:;)]")

# A mistyped URL has no ://. What is after its @ must look like a host then: not a size of images, nor a file.
_ADDRESS = r"(?:\[[\da-fA-F:.]+\]|localhost\b|\d{1,3}(?:\.\d{1,3}){3}(?![\w.-]))"
_FILE = r"[\w.-]*\.(?:avi|mp4|m4v|mov|mkv|webm|mjpe?g|mpe?g|png|jpe?g|tiff?|bmp|toml|jsonl?|txt|csv)\b"
_NAME = rf"(?!\d+x\d+\b)(?!{_FILE})(?=[\d.-]*[^\W\d])[^\W_][\w.-]*"
_SCHEME = r"(?i:rtsps?|rtmp|https?|rtp|udp|tcp|srt)"
_SELECTOR = r"(?<![^\s'\"])((?:[^\s'\":]*\b(?:video|name|serial|ip|class):)?+)"
_SPACED = re.compile(  # a password with spaces: its host must have a port or a path
    rf"{_SELECTOR}[^\s'\":]*:(?! |//)(?:(?!: |://)[^\n'\"]){{0,200}}@(?={_ADDRESS}|{_NAME}(?:[/\\]|:\d))"
)
_MISTYPED = re.compile(
    rf"{_SELECTOR}(?:[^\s'\":]*:(?!//)|{_SCHEME}[/\\])(?:(?!://)[^\s'\"])*@(?={_ADDRESS}|{_NAME})"
    rf"|{_SELECTOR}(?:(?!://)[^\s'\"])+@(?={_ADDRESS}|{_NAME}:\d)"
)


def hide_credentials(text: str) -> str:
    """Hide what is before the last ``@`` of each URL in a text, and what follows its first ``?`` or ``=``.

    Cameras take user and password in either place, and some in the path. The message's own words follow a colon and a
    space. In a URL without ``://``, which is mistyped, what is before an ``@`` is hidden if something like a host
    follows it: ``video:0@1280x720`` and ``video:clip@2.mp4`` stay.
    """
    if "://" in text:
        text = _QUERY.sub(rf"\1{HIDDEN}", _USER.sub(f"://{HIDDEN}@", text))
    if "@" in text:
        for pattern in (_SPACED, _MISTYPED):
            text = pattern.sub(lambda m: f"{m[1] or m[m.re.groups] or ''}{HIDDEN}@", text)
    return text


def without_url(text: str) -> str:
    """No more of a text that holds a URL than what is before the place: in a bad URL, a password may be anywhere."""
    before, is_url, _ = text.partition("://")
    return f"{before}://..." if is_url else text
