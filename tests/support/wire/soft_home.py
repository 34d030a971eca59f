"""Where the scripted unit stands after homing."""

SOFT_HOME = (-181650, -349, -12200, 99200, 33300, -96500)  # counts of crs93, soft home of ctu_crs
