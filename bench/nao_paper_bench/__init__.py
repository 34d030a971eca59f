"""The reproduction of a paper on NAO calibration: its robot, its field of stances, its tables."""
