"""First contact with a unit: ask it what can be asked, keep every byte, and compare with what the code assumes."""
