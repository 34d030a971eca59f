"""All that a link sends and receives."""

from __future__ import annotations

from driver.line.link import Link


def send_many(link: Link, line: str) -> None:
    for _ in range(2000):
        link.send(line)
