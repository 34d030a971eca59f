"""The controller as a plan must know it: a unit's counts and limits, and paths of integer segments."""
