"""A plan as one HTML file that opens by double click, without network: 3D, time line, steps, plots."""
