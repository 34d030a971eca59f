"""Programs of goals: tasks with cubes, lists of poses, single motions."""
