"""The other files of a cell: task, world, scene, look, pose list."""
