"""What operations cost, whatever the machine and its load."""
