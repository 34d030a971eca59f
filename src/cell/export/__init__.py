"""Export of plans, logs and scenes to other programs."""

from typing import TYPE_CHECKING

from arm.former import FormerNames

if not TYPE_CHECKING:
    __getattr__ = FormerNames(
        __name__, "cell.export.export", "export_file", "csv_text", Asked="ExportOptions"
    )
