"""What is estimated: intrinsics, and chains of joints as a URDF has them."""
