"""The reproduction of a paper on NAO calibration: stances by optimal design, the robot, the field, the tables."""
