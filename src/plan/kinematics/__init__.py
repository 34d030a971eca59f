"""Inverse kinematics: in closed form, numeric, and with a free axis."""
