"""The estimated models: camera intrinsics, and kinematic chains taken from a URDF."""
