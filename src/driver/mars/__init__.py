"""One arm on one controller: identify, initialise, home, move, grip, stop."""

from arm.former import former_names

former_names(__name__, "driver.mars.mars", "Mars")
