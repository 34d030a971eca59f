"""Commands for a person beside the arm: where it is, stop it, bring it home, open the jaws, remember a pose."""
