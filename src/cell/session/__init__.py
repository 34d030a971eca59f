"""An open cell: the arm's connection, cameras, homing, speed, and the person at the terminal."""
