"""The other files of a cell: task, world, scene, observation, list of poses."""
