"""``a465 doctor``: check the installation, the cell and the devices, and run a self-test."""

from arm.former import former_names

former_names(__name__, "cell.doctor.doctor", "doctor_step")
