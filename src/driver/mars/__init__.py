"""One arm on one controller: identify, initialise, home, move, grip, stop."""

from typing import TYPE_CHECKING

from arm.former import FormerNames

if not TYPE_CHECKING:
    __getattr__ = FormerNames(__name__, "driver.mars.mars", "Mars")
