"""The emulated unit from outside: clients, faults, damage and logs."""
