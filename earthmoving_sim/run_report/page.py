"""The report as one HTML page, with its pictures inside it."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

__all__ = ["GENERATOR", "Page"]

GENERATOR = '<meta name="generator" content="earthmoving report">'
"""Element in the head of each page, by which a report is recognised."""

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #22252a; background: #fff; margin: 0 auto;
       max-width: 1060px; padding: 24px; }
h1 { font-size: 26px; margin: 0 0 4px; }
h2 { font-size: 20px; margin: 36px 0 8px; border-bottom: 1px solid #d9dce1; padding-bottom: 4px; }
h3 { font-size: 16px; margin: 22px 0 6px; }
p.note { color: #6b7078; margin: 4px 0 12px; }
ul.figures { display: flex; flex-wrap: wrap; gap: 12px; list-style: none; padding: 0; }
ul.figures li { background: #f3f5f7; border-radius: 6px; padding: 10px 14px; min-width: 120px; }
ul.figures b { display: block; font-size: 20px; }
ul.figures span { color: #6b7078; font-size: 13px; }
table { border-collapse: collapse; margin: 8px 0 16px; font-size: 14px; }
th, td { text-align: right; padding: 3px 12px 3px 0; border-bottom: 1px solid #e3e5e8; }
th { color: #6b7078; font-weight: 600; }
th:first-child, td:first-child { text-align: left; }
td.text, th.text { text-align: left; max-width: 560px; overflow-wrap: anywhere; }
img { max-width: 100%; height: auto; display: block; margin: 8px 0 16px; }
nav a { margin-right: 14px; color: #1f5c99; }
@media print { body { max-width: none; padding: 0; } h2 { break-after: avoid; }
               img, tr { break-inside: avoid; } nav { display: none; } }
"""


class Page:
    """An HTML page, written from top to bottom."""

    def __init__(self, title: str, subtitle: str) -> None:
        self._title = title
        self._body: list[str] = []
        self._sections: list[str] = []
        self._subtitle = subtitle

    def section(self, title: str) -> None:
        """Begin a section."""
        anchor = f"section-{len(self._sections) + 1}"
        self._sections.append(f'<a href="#{anchor}">{escape(title)}</a>')
        self._body.append(f'<h2 id="{anchor}">{escape(title)}</h2>')

    def heading(self, title: str) -> None:
        """Begin a part of a section."""
        self._body.append(f"<h3>{escape(title)}</h3>")

    def note(self, text: str) -> None:
        """Add a remark."""
        self._body.append(f'<p class="note">{escape(text)}</p>')

    def figures(self, figures: Iterable[tuple[str, str]]) -> None:
        """Add a row of figures, each a value with its unit and what it is."""
        items = "".join(
            f"<li><b>{escape(value)}</b><span>{escape(name)}</span></li>" for value, name in figures
        )
        self._body.append(f'<ul class="figures">{items}</ul>')

    def table(
        self, header: Sequence[str], rows: Iterable[Sequence[str]], *, has_texts: bool = False
    ) -> None:
        """Add a table; with `has_texts`, all columns are aligned to the left."""
        kind = ' class="text"' if has_texts else ""
        head = "".join(f"<th{kind}>{escape(each)}</th>" for each in header)
        body = "".join(
            "<tr>" + "".join(f"<td{kind}>{escape(each)}</td>" for each in row) + "</tr>"
            for row in rows
        )
        self._body.append(f"<table><tr>{head}</tr>{body}</table>")

    def picture(self, path: Path, description: str) -> None:
        """Add a PNG file to the page."""
        data = base64.b64encode(path.read_bytes()).decode()
        self._body.append(f'<img alt="{escape(description)}" src="data:image/png;base64,{data}">')

    def html(self) -> str:
        """Return the page."""
        return (
            '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            f"{GENERATOR}<title>{escape(self._title)}</title><style>{_STYLE}</style></head><body>"
            f"<h1>{escape(self._title)}</h1>"
            f'<p class="note">{escape(self._subtitle)}</p>'
            f"<nav>{''.join(self._sections)}</nav>"
            f"{''.join(self._body)}</body></html>\n"
        )
