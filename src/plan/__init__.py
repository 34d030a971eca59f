"""Poses in, checked plan out. Never sees a camera or a port."""
