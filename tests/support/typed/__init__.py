"""What a user types or writes: commands, files, the documentation's commands."""
