"""What the name of a serial port was rather meant to be."""

from __future__ import annotations

import re


def port_fault(url: str) -> str:
    """Return the rule that the name of a serial port breaks, "" if none; whether it is there is not asked."""
    if (inner := url.strip(" \t\"'")) != url and inner:
        around = "quotes" if {url[0], url[-1]} & {'"', "'"} else "spaces"
        return f"has {around} in its value, which are no part of a name; must be {inner}"
    if url.startswith("socket://"):
        found = re.fullmatch(r"socket://[^/:]+:(\d+)/?(\?.*)?", url)
        right = found and 0 < int(found[1]) < 2**16
        return (
            "" if right else "must be socket://HOST:PORT, such as socket://127.0.0.1:4650 (PORT up to 65535)"
        )
    if found := re.fullmatch(r"(?i)(?:socket|tcp|telnet)(?::/*|//)([^/:]+(:\d+)?)/?", url):
        return f"must be socket://{found[1]}{'' if found[2] else ':PORT'}"
    if found := re.fullmatch(r"(/.*):(9600|19200|38400|57600|115200)", url):
        return f"must be {found[1]}: the line's speed is fixed, and no part of the name"
    if "://" in url:
        return "must be a device, or socket://HOST:PORT"
    if re.fullmatch(r"(\d{1,3}\.){3}\d{1,3}", url):
        return f"must be socket://{url}:PORT, or a device"
    if re.fullmatch(r"[\w.-]+:\d{1,5}", url):
        return f"must be socket://{url}, or a device"
    return "" if url.strip() else "must be a device, such as /dev/mars, or socket://HOST:PORT"
