"""Order, places and grasps of many bodies, chosen together."""
