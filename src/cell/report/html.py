"""Parts of the reports: self-contained HTML pages, light and dark."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from html import escape

STYLE = """
:root { --paper:#f3f1ec; --panel:#fffefb; --ink:#23272d; --muted:#6d7278; --line:#e2ddd2; --blue:#2f6fb3;
  --good:#2f9e87; --bad:#c0392b; --warm:#e2983a; color-scheme: light;
  font: 14px/1.5 system-ui, -apple-system, "Segoe UI", Arial, sans-serif; font-variant-numeric: tabular-nums; }
@media (prefers-color-scheme: dark) { :root { --paper:#14171b; --panel:#1b2026; --ink:#e6e8ea; --muted:#949ca5;
  --line:#2b3139; --blue:#6fa8e6; --good:#3fb59c; --bad:#ff7b6b; --warm:#eba54a; color-scheme: dark; } }
* { box-sizing:border-box } body { margin:0; background:var(--paper); color:var(--ink) }
main { max-width:1120px; margin:0 auto; padding:24px; display:grid; gap:16px }
h1 { font-size:20px; margin:0 } h2 { font-size:15px; margin:0 0 8px } p { margin:4px 0 }
section { background:var(--panel); border:1px solid var(--line); border-radius:14px; padding:16px; overflow-x:auto }
.two { columns:2 420px; column-gap:16px } .two section { break-inside:avoid; margin-bottom:16px }
.badge { display:inline-block; padding:2px 12px; border-radius:99px; color:#fff; background:var(--good) }
.badge.no { background:var(--bad) } .figures { display:flex; gap:28px; flex-wrap:wrap }
.figures b { display:block; font-size:22px; font-weight:600 } .muted, figcaption { color:var(--muted) }
table { border-collapse:collapse; width:100% }
td,th { text-align:right; padding:3px 8px; border-bottom:1px solid var(--line) }
th { color:var(--muted); font-weight:500 }
td.t,th.t { text-align:left }
svg { width:100%; height:auto; display:block } svg text { fill:var(--muted); font-size:13px } figure { margin:0 }
img { max-width:100%; display:block; border-radius:8px }
.looks { display:grid; grid-template-columns:repeat(auto-fill, minmax(min(100%, 640px), 1fr)); gap:16px }
details { margin-top:8px } summary { cursor:pointer; color:var(--muted) } a { color:var(--blue) }
.frame { fill:none; stroke:var(--line) } ul { margin:4px 0; padding-left:20px } .out td { color:var(--muted) }
"""


_NUMBER = re.compile(r"[-+]?[\d.]|-?$|held$")
"""Matches the cells of a column of numbers, empty ones included."""


def page(title: str, parts: Iterable[str]) -> str:
    """Return a page."""
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8"><meta name="viewport" '
        f'content="width=device-width"><title>{escape(title)}</title><style>{STYLE}</style></head>'
        f"<body><main>{''.join(parts)}</main></body></html>\n"
    )


def section(title: str, body: str) -> str:
    """Return a panel."""
    return f"<section>{f'<h2>{title}</h2>' if title else ''}{body}</section>"


def bullets(items: Sequence[str], title: str) -> str:
    """Return items under a title; empty without items."""
    if not items:
        return ""
    return f"<p><b>{title}</b></p><ul>{''.join(f'<li>{escape(item)}</li>' for item in items)}</ul>"


def table(header: Sequence[str], rows: Iterable[tuple[str, Sequence[str]]]) -> str:
    """Return a table of rows, each a class ("" or "out") and its texts. Columns of numbers are right-aligned."""
    rows = list(rows)
    text = [not all(_NUMBER.match(row[k]) for _, row in rows) for k in range(len(header))]
    marks = [' class="t"' if is_text else "" for is_text in text]
    head = "".join(f"<th{mark}>{h}</th>" for mark, h in zip(marks, header, strict=True))
    body = "".join(
        f'<tr class="{kind}">'
        + "".join(f"<td{mark}>{escape(v)}</td>" for mark, v in zip(marks, row, strict=True))
        + "</tr>"
        for kind, row in rows
    )
    return f"<table><tr>{head}</tr>{body}</table>"
