"""What is done once, when a unit is taken into use: registers and homing."""
