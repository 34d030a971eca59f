"""A plan as a self-contained HTML file: 3D view, time line, steps, plots."""
