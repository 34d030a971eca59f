"""``a465 jog``: move the arm by keys, a certified step for each."""
