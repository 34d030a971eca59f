"""Arms, motions and bodies that tests make up, and MuJoCo as their judge."""
