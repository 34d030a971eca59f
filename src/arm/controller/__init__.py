"""The controller from the planner's side: counts and limits of a unit, and paths of integer segments."""
