"""Hide user names, passwords and keys of URLs in whatever is printed, logged or stored."""

from __future__ import annotations

import re

HIDDEN = "***"
_USER = re.compile(r"://(?:(?!: |://).)+@")  # to the last @, as passwords may contain one
_QUERY = re.compile(r"(://[^\s'\"?=]*[?=])[^\s'\"]*[^\s'\".,:;)]")


def hide_credentials(text: str) -> str:
    """Hide what is before the last ``@`` of each URL in a text, and what follows its first ``?`` or ``=``.

    Cameras take user and password in either place, and some in the path. The message's own words follow a colon and a
    space.
    """
    return _QUERY.sub(rf"\1{HIDDEN}", _USER.sub(f"://{HIDDEN}@", text)) if "://" in text else text


def without_url(text: str) -> str:
    """No more of a text that holds a URL than what is before the place: in a bad URL, a password may be anywhere."""
    before, is_url, _ = text.partition("://")
    return f"{before}://..." if is_url else text
