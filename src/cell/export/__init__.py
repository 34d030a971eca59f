"""Export of plans, logs and scenes to other programs."""

from arm.former import former_names

former_names(__name__, "cell.export.export", "export_file", "csv_text", Asked="ExportOptions")
