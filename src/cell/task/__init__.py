"""A run of a task: look, plan, execute, confirm, resume."""
