"""Contact sheet: all figures with captions and measured values, as HTML and as Markdown."""

from __future__ import annotations

import html
from collections.abc import Iterator, Sequence
from pathlib import Path

from earthmoving_sim.figures.figure import Figure

__all__ = ["write_contact_sheet"]

_INTRODUCTION = (
    "Pictures after the figures of the reference of 2014, made by `earthmoving figures`. The titles"
    " are the captions of the reference. Speeds are real-time factors: simulated time over the"
    " computing time of one core of this computer, without drawing."
)

_STYLE = """\
body { font: 15px/1.45 system-ui, sans-serif; color: #22252a; }
body { max-width: 1180px; margin: 2em auto; padding: 0 1em; }
section { border-top: 1px solid #d9dce1; margin-top: 2em; }
h2 { font-size: 1.15em; }
.pictures { display: grid; gap: 12px; }
.pictures { grid-template-columns: repeat(auto-fit, minmax(340px, 1fr)); }
figure { margin: 0; }
img { width: 100%; border-radius: 4px; }
figcaption, td, th { font-size: 13px; color: #4a4f57; text-align: left; }
td, th { padding: 1px 16px 1px 0; font-weight: normal; }
"""


def write_contact_sheet(figures: Sequence[Figure], folder: Path) -> tuple[Path, Path]:
    """Write index.html and index.md into the folder of the pictures; return their paths."""
    page, text = folder / "index.html", folder / "index.md"
    ordered = sorted(figures, key=lambda figure: figure.number)
    page.write_text("\n".join(_html_lines(ordered, folder)), encoding="utf-8")
    text.write_text("\n".join(_markdown_lines(ordered, folder)), encoding="utf-8")
    return page, text


def _html_lines(figures: Sequence[Figure], folder: Path) -> Iterator[str]:
    yield '<!doctype html><html lang="en"><meta charset="utf-8"><title>Figures</title>'
    yield f"<style>{_STYLE}</style><h1>Figures</h1><p>{html.escape(_INTRODUCTION)}</p>"
    for figure in figures:
        yield f"<section><h2>Figure {figure.number}. {html.escape(figure.title)}</h2>"
        yield f'<p>{html.escape(figure.text)}</p><div class="pictures">'
        for picture in figure.pictures:
            source = html.escape(picture.path.relative_to(folder).as_posix())
            caption = html.escape(picture.caption)
            yield f'<figure><img src="{source}" alt="{caption}"><figcaption>{caption}</figcaption>'
            yield "</figure>"
        yield "</div><table>"
        for name, value in figure.measurements.items():
            yield f"<tr><th>{html.escape(name)}</th><td>{html.escape(value)}</td></tr>"
        yield "</table></section>"
    yield "</html>"


def _markdown_lines(figures: Sequence[Figure], folder: Path) -> Iterator[str]:
    yield "# Figures"
    yield ""
    yield _INTRODUCTION
    for figure in figures:
        yield ""
        yield f"## Figure {figure.number}. {figure.title}"
        yield ""
        yield figure.text
        for picture in figure.pictures:
            yield ""
            yield f"![{picture.caption}]({picture.path.relative_to(folder).as_posix()})"
            yield ""
            yield f"*{picture.caption}*"
        if figure.measurements:
            yield ""
            yield "| measured | value |"
            yield "|---|---|"
            for name, value in figure.measurements.items():
                yield f"| {name} | {value} |"
    yield ""
