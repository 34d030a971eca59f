"""Every citation of docs/sources.md names a heading there; no file cites what is not in the repository."""

from __future__ import annotations

import re

from typed.doc_pages import ROOT

HEADINGS = set(re.findall(r"^## (.*)$", (ROOT / "docs/sources.md").read_text(), re.M))
FILES = [
    file
    for pattern in ("src/**/*.py", "src/**/*.toml", "bench/**/*.py", "docs/*.md", "urdf/**/*.*")
    for file in sorted(ROOT.glob(pattern))
]
CITATION = re.compile(r'docs/sources\.md(?: says)?[,:]((?:(?: and|,)? "[^"]+")+)')
ABSENT = re.compile(r"fact\s+sheet|\b(first|second)\s+seed\b|\bissue \d|original\s+report", re.I)


def test_citations_name_a_heading() -> None:
    names = []
    for file in FILES:
        text = re.sub(r"\s+", " ", file.read_text())
        found = CITATION.findall(text)
        if file.suffix == ".py":
            assert len(found) == text.count("docs/sources.md"), file.relative_to(ROOT)
        names += [name for quoted in found for name in re.findall(r'"([^"]+)"', quoted)]
    assert len(names) > 30
    assert set(names) <= HEADINGS


def test_no_file_cites_what_is_not_in_the_repository() -> None:
    for file in FILES:
        assert not ABSENT.search(file.read_text()), file.relative_to(ROOT)
