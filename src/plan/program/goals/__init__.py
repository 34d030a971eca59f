"""Goals: what they ask for, the lines that lead to them, and what moves with the tool between them."""
