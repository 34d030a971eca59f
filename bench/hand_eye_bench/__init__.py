"""Parts of bench/hand_eye.py."""
