"""Inverse kinematics: closed form, numerical, and with a free rotation axis."""
