"""Templates escape what they show and refuse what they do not know."""

from __future__ import annotations

import re

import jinja2
import pytest

from cell.report.html import _TEMPLATES, Table, render

PARTS = '{% import "report/templates/parts.html.j2" as parts %}'


def shown(source: str, **values: object) -> str:
    """The text of a template that is not a file."""
    return _TEMPLATES.from_string(PARTS + source).render(values)


def test_every_value_is_escaped() -> None:
    name = '<script>"it\'s" & more</script>'
    table = Table((name,), [(name,)])
    source = (
        "{{ parts.badge(true, name) }}{{ parts.figures([(name, name)]) }}{{ parts.bullets([name], name) }}"
    )
    html = shown(source + "{{ parts.table(table) }}", name=name, table=table)
    assert "<script" not in html
    assert html.count("&lt;script&gt;&#34;it&#39;s&#34; &amp; more&lt;/script&gt;") == 7


def test_a_name_that_is_not_given_is_an_error() -> None:
    with pytest.raises(jinja2.UndefinedError, match="'live' is undefined"):
        render("preview/page/waiting.html.j2", style="", scripts=[])


def test_tolerances_are_written_as_on_paper_and_data_of_scripts_stay() -> None:
    table = Table(("x",), [("+1.2+-0.1",)])
    assert "<td>+1.2±0.1</td>" in shown("{{ parts.table(table) }}", table=table)
    assert shown("{{ a }} {{ a | safe }}", a="1 +- 2") == "1 ± 2 1 +- 2"


def test_negative_numbers_have_a_minus_sign_and_names_keep_their_hyphens() -> None:
    rows = [("-0.5 px",), ("2026-11-28",), ("-",), ("-o",), ("1e-05",)]
    html = shown("{{ parts.table(table) }}", table=Table(("x",), rows))
    assert [cell for (cell,) in rows[1:]] == re.findall(r"<td[^>]*>([^<]*)</td>", html)[1:]
    assert "\N{MINUS SIGN}0.5 px" in html


def test_columns_of_numbers_are_on_the_right() -> None:
    rows = [("01-02/1", "1", "-"), ("2", "-3.5", "held"), ("4.png", "1e-05", "+1.2+-0.1"), ("5a", "", "1 px")]
    table = Table(("", "n", "x"), rows, out=[1])
    html = shown("{{ parts.table(table) }}", table=table)
    assert '<tr><th class="t"></th><th>n</th><th>x</th></tr>' in html
    assert '<tr class="out"><td class="t">2</td><td>\N{MINUS SIGN}3.5</td><td>held</td></tr>' in html
    assert html.count('class="out"') == 1
    assert "<ul>" not in shown('{{ parts.bullets([], "none") }}')
