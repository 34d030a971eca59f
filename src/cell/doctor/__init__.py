"""``a465 doctor``: check the installation, the cell and the devices, and run a self-test."""

from typing import TYPE_CHECKING

from arm.former import FormerNames

if not TYPE_CHECKING:
    __getattr__ = FormerNames(__name__, "cell.doctor.doctor", "Rows", "doctor_step")
