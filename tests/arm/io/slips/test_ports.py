"""What the name of a serial port was rather meant to be; every verb that opens one asks it."""

import pytest

from arm.io.slips.ports import port_fault


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("/dev/ttyUSB0", ""),
        ("socket://127.0.0.1:4650", ""),
        ("127.0.0.1:4650", "must be socket://127.0.0.1:4650, or a device"),
        ("/dev/ttyUSB0:19200", "must be /dev/ttyUSB0: the line's speed is fixed, and no part of the name"),
        ("'/dev/ttyUSB0'", "has quotes in its value, which are no part of a name; must be /dev/ttyUSB0"),
    ],
)
def test_what_the_name_of_a_port_should_be(name: str, told: str) -> None:
    assert port_fault(name) == told
