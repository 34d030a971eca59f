"""Settings of Sphinx for this folder: `make docs` builds docs/_build/html, with no network.

The pages are Markdown and can be read without Sphinx. The API pages are made anew at every build, one for each folder
of the source, from the modules that are there.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sphinx.application import Sphinx

HERE = Path(__file__).resolve().parent
SOURCE = HERE.parent / "src"
ROOMS = ("a465", "arm", "plan", "vision", "driver", "render", "calib", "cell")  # as they rest on each other

project = "a465"
author = "the a465 authors"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["_build", "pictures"]
myst_heading_anchors = 3
default_role = "code"  # of a docstring's `name`
html_theme = "furo"
html_title = "a465"
html_static_path = ["_static"]
html_css_files = ["a465.css"]
html_show_copyright = False
html_copy_source = False
html_show_sourcelink = False
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
# by these names, not by what they stand for
autodoc_type_aliases = {name: name for name in ("Array", "Bools", "Counts")}
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
toc_object_entries = False
python_use_unqualified_type_names = True

suppress_warnings = ["ref.python"]  # a name such as Chain that several modules have is left without a link

LONG = (  # what numpy's types stand for, and what the code says
    (
        re.compile(r"~?numpy\._typing\S*_Buffer \| .*?_NestedSequence\[complex \| bytes \| str\]"),
        "ArrayLike",
    ),
    (
        re.compile(
            r"~?numpy\.ndarray\[tuple\[~?(?:typing\.)?Any, \.{3}\], ~?numpy\.dtype\[~?numpy\.(\w+)\]\]"
        ),
        r"NDArray[\1]",
    ),
    (re.compile(r"\bnpt\.NDArray\[np\.(\w+?)_?\]"), r"NDArray[\1]"),
)
OPTIONS = ("   :members:", "   :ignore-module-all:")  # what a module passes on is shown where it is made


def public_modules(room: str) -> list[str]:
    """Dotted names of all modules of a room of which no part begins with an underscore, the room first."""
    names = []
    for path in sorted((SOURCE / room).rglob("*.py")):
        parts = path.relative_to(SOURCE).with_suffix("").parts
        parts = parts[:-1] if parts[-1] == "__init__" else parts
        if not any(part.startswith("_") for part in parts):
            names.append(".".join(parts))
    return sorted(names)


def api_pages(room: str) -> dict[str, str]:
    """A page for each folder of a room, with its modules; the room's own page leads to the others."""
    modules = public_modules(room)
    folders = [name for name in modules if (SOURCE / Path(*name.split("."))).is_dir()]
    pages = {}
    for folder in folders:
        own = [
            name
            for name in modules
            if name == folder or (name not in folders and name.rpartition(".")[0] == folder)
        ]
        lines = []
        for name in own:
            lines += [f"{'#' if name == folder else '##'} {name}", ""]
            lines += ["```{eval-rst}", f".. automodule:: {name}", *OPTIONS, "```", ""]
        below = [name for name in folders if name.rpartition(".")[0] == folder]
        if below:
            lines[8:8] = ["```{toctree}", ":maxdepth: 1", "", *below, "```", ""]
        pages[folder] = "\n".join(lines)
    return pages


def write_api_pages(app: Sphinx) -> None:
    """Write the pages that changed into docs/api, and remove those of folders that are gone."""
    folder = Path(app.srcdir) / "api"
    folder.mkdir(exist_ok=True)
    pages = {f"{name}.md": text for room in ROOMS for name, text in api_pages(room).items()}
    for page in folder.glob("*.md"):
        if page.name not in pages:
            page.unlink()
    for name, text in pages.items():
        page = folder / name
        if not page.is_file() or page.read_text() != text:
            page.write_text(text)


def short(text: str) -> str:
    """Types by the names that the code has for them."""
    for long, name in LONG:
        text = long.sub(name, text)
    return text


def short_signature(*event: Any) -> tuple[str | None, str | None]:
    """Of a function or class: arguments and what it gives, the last two of what Sphinx tells."""
    arguments, gives = event[-2:]
    return arguments and short(arguments).replace("<factory>", "..."), gives and short(gives)


def each_by_itself(lines: list[str]) -> list[str]:
    """Attributes that share what is said of them, such as ``lower, upper: rad``, as one field each."""
    fields: list[list[str]] = []
    for line in lines:
        if line.startswith((" ", "\t")) and fields and fields[-1][0].startswith(":ivar "):
            fields[-1].append(line)
        else:
            fields.append([line])
    single = []
    for first, *more in fields:
        shared = re.match(r":ivar ([\w*]+(?:, [\w*]+)+):(.*)", first)
        for name in shared[1].split(", ") if shared else ():
            single += [f":ivar {name}:{shared[2]}", *more]
        single += [] if shared else [first, *more]
    return single


def whole(_app: Sphinx, what: str, _name: str, _obj: object, _options: object, lines: list[str]) -> None:
    """Before napoleon, which takes what stands before a colon in a value's first line for its type."""
    if what in ("property", "attribute", "data"):
        lines.insert(0, "")


def as_written(_app: Sphinx, what: str, _name: str, _obj: object, _options: object, lines: list[str]) -> None:
    """Formulas of a docstring as they stand there: bars are no markup, and what a module indents is a block."""
    written: list[str] = []
    start = ""  # of the paragraph or block before
    for line in map(short, each_by_itself(lines)):
        indented = what == "module" and line.startswith(" ") and not start.startswith(("-", "*"))
        if indented and start and not start.startswith(" "):
            written += ["", "::", ""]
        elif line and start.startswith(" ") and not indented:
            written.append("")
        written.append(line if indented else line.replace("|", "\\|"))
        start = line or start
    lines[:] = written


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    app.connect("autodoc-process-docstring", whole, priority=400)
    app.connect("autodoc-process-docstring", as_written)
    app.connect("autodoc-process-signature", short_signature)
    app.connect("builder-inited", write_api_pages)
