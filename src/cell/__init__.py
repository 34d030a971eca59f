"""The only room that knows all the others: command line, tasks, simulated cell, preview, reports."""
