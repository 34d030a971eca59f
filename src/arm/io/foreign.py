"""What the content of a file is that belongs elsewhere: an image, an archive, a page, a table. For messages only."""

from __future__ import annotations

import codecs
import re

_HTML = re.compile(r"\s*<(!doctype html|html)\b", re.IGNORECASE)
_YAML = re.compile(r"(?:---\s|%YAML[ :]|(?:- +)?[A-Za-z_][\w/.-]*:(?:\s|\Z))")
_ROW = re.compile(r"[-+]?\d[\d.eE+-]*(?:\s*[,;\t ]\s*[-+]?\d[\d.eE+-]*)+\s*")
_TABLE = re.compile(r"^-{3,}(?: +-{3,})+ *$", re.MULTILINE)  # the line below the names of columns
_HEADER = re.compile(r"\s*[A-Za-z_][\w .()/^-]*(?:\s*[,;\t]\s*[A-Za-z_][\w .()/^-]*)+\s*")  # names of columns
_SPLIT = re.compile(r"\s*[,;\t ]\s*")
_ROWS = 3  # of numbers, before a text counts as a table
_BINARY = {
    b"\x89PNG": "a PNG image",
    b"\xff\xd8\xff": "a JPEG image",
    b"GIF8": "a GIF image",
    b"II*\0": "a TIFF image",
    b"MM\0*": "a TIFF image",
    b"BM": "a BMP image",
    b"%PDF": "a PDF document",
    b"PK\x03\x04": "a ZIP archive, such as an .npz file, a spreadsheet or a document",
    b"\x1f\x8b": "a gzip archive",
    b"BZh": "a bzip2 archive",
    b"\xfd7zXZ\0": "an xz archive",
    b"7z\xbc\xaf\x27\x1c": "a 7z archive",
    b"Rar!\x1a\x07": "a RAR archive",
    b"\x93NUMPY": "a NumPy array",
    b"\x7fELF": "a program",
    b"\x89MCAP": "an MCAP recording",
}


def binary(data: bytes) -> str:
    """That bytes are no text, and what they are, for a message; "" if their beginning shows none of the known kinds."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "is UTF-16 text, as editors and spreadsheets write 'Unicode' (save it as UTF-8, a table as 'CSV UTF-8')"
    return next((f"is {what}" for begin, what in _BINARY.items() if data.startswith(begin)), "")


def archive(data: bytes) -> str:
    """That bytes are an archive, for a message where a folder belongs; "" if their beginning is none of one."""
    what = binary(data).partition(",")[0]
    tar = "is a tar archive" if data[257:262] == b"ustar" else ""
    return what if what.endswith("archive") else tar


def markup(text: str) -> str:
    """What a text is that begins as XML or HTML does, for a message; "" of any other text."""
    if _HTML.match(text):
        return "is an HTML page, such as a preview or a report"
    return (
        "is XML, such as a URDF (an arm file names a URDF: arm.urdf)" if text.lstrip().startswith("<") else ""
    )


def yaml(text: str) -> str:
    """That the first line which is no comment looks like YAML, for a message; "" if it does not."""
    first = next((line for line in text.split("\n") if line.strip() and not line.startswith("#")), "")
    return "looks like YAML" if _YAML.match(first + "\n") else ""


def printed(text: str) -> str:
    """That a text is what a command of this program printed for people, for a message; "" of any other text."""
    found = _TABLE.search(text[:10_000])
    return "is the table that a command printed (-o FILE writes the file)" if found else ""


def table(text: str) -> str:
    """That a text is rows of numbers, such as a board file or a list of poses, for a message; "" if it is not."""
    lines = (line.partition("#")[0] for line in text[:10_000].split("\n"))
    rows = [line for line in lines if line.strip()][: _ROWS + 1]
    if text.startswith("time_s,"):
        return "is a table of samples, as a465 export writes it"
    if rows and _HEADER.fullmatch(rows[0]):
        rows = rows[1:]
    elif len(rows) < _ROWS:
        rows = [row for row in rows if len(_SPLIT.split(row.strip())) > _ROWS]
    is_table = len(rows) > 1 and all(map(_ROW.fullmatch, rows[:_ROWS]))
    return "is a table of numbers (CSV), such as a board file or a list of poses" if is_table else ""
