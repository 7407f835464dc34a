"""The builder of HTML pages: a page is a list of sections, and a section a list of blocks.

A section is a function of what the page is about; its blocks are made by the functions below, which
escape all text. A page needs nothing from elsewhere: style, pictures and script are in it.
"""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar

from markupsafe import Markup, escape

from rsenf.report.panels import Panel

T = TypeVar("T")
_HERE = Path(__file__).parent
_WHOLE = re.compile(r"\d{4}-\d\d-\d\d [\d:.]+ UTC|± [\d.]+ s|--[a-z-]+")


@dataclass(frozen=True)
class Section(Generic[T]):
    """A section of a page; it is left out if all its blocks are empty.

    ``short`` is its name in the table of contents.
    """

    id: str
    title: str
    blocks: Callable[[T], Sequence[Markup]]
    short: str = ""


class Head(NamedTuple):
    """The head of a page; ``answer`` is empty, or a tone and a sentence."""

    title: str
    kind: str
    heading: str
    answer: tuple[str, str] | tuple[()] = ()
    note: str | Markup = ""


class Cell(NamedTuple):
    """Content of a table's cell, and its sort key: a number, a text, or None for unknown."""

    content: Any
    key: float | str | None = None


def render(
    head: Head,
    sections: Sequence[Section[T]],
    about: T,
    footer: object = "",
    *,
    sorts: bool = False,
) -> str:
    """Return a page as HTML.

    Parameters
    ----------
    head : Head
    sections : sequence of Section
        In their order on the page.
    about : object
        What the page is about: the argument of each section's function.
    footer : str or Markup, optional
    sorts : bool, optional
        Whether the tables sort by the headings that are pressed; the page is as wide as they need.
    """
    built = [(section, section.blocks(about)) for section in sections]
    shown = [(section, blocks) for section, blocks in built if any(blocks)]
    script = (_HERE / "sort.js").read_text(encoding="utf-8") if sorts else ""
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return _FRAME.format(
        scripts=f"; script-src 'sha256-{digest}'" if sorts else "",
        title=head.title,
        style=Markup((_HERE / "page.css").read_text(encoding="utf-8")),
        body=Markup(' class="sorts"') if sorts else "",
        head=_head(head),
        contents="" if sorts else _contents([section for section, _ in shown]),
        main=_join(_section(section, blocks) for section, blocks in shown),
        footer=_tag("footer", paragraph(footer)),
        script=Markup(f"<script>{script}</script>\n") if sorts else "",
    )


_FRAME = Markup("""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="\
default-src 'none'; img-src data:; style-src 'unsafe-inline'{scripts}">
<meta name="generator" content="rsenf">
<title>{title}</title>
<style>
{style}</style>
</head>
<body{body}>
{head}{contents}<main>
{main}</main>
{footer}{script}</body>
</html>
""")


def _head(head: Head) -> Markup:
    answer = Markup("")
    if head.answer:
        tone, text = head.answer
        answer = _tag("div", paragraph(badge(tone)) + paragraph(unbroken(text)), f"answer {tone}")
    parts = (paragraph(head.kind, "kind"), _tag("h1", unbroken(head.heading)), answer)
    return _tag("header", _join(parts) + note(unbroken(head.note)))


def _contents(sections: Sequence[Section[Any]]) -> Markup:
    link = Markup('<a href="#{}">{}</a>')
    links = listed(link.format(s.id, s.short or s.title) for s in sections)
    return Markup('<nav aria-label="Contents">\n{}</nav>\n').format(links)


def _section(section: Section[Any], blocks: Iterable[Markup]) -> Markup:
    if not section.title:
        return _join(blocks)
    return Markup('<section aria-labelledby="{0}">\n<h2 id="{0}">{1}</h2>\n{2}</section>\n').format(
        section.id, section.title, _join(blocks)
    )


def _join(parts: Iterable[Markup]) -> Markup:
    return Markup("").join(parts)


def _tag(name: str, content: object, kind: str = "") -> Markup:
    """Return an element with a class of page.css; nothing if it has no content."""
    look = Markup(' class="{}"').format(kind) if kind else ""
    return Markup("<{0}{1}>{2}</{0}>\n").format(name, look, content) if content else Markup("")


def paragraph(text: object, kind: str = "") -> Markup:
    """Return a paragraph of a class of page.css; nothing without a text."""
    return _tag("p", text, kind)


def note(text: object) -> Markup:
    """Return a paragraph in small print; nothing without a text."""
    return _tag("p", text, "note")


def heading(text: object) -> Markup:
    """Return a heading within a section."""
    return _tag("h3", text)


def badge(tone: str, text: str = "") -> Markup:
    """Return a word in a frame: that of the tone, a class of page.css, or another."""
    return Markup('<span class="badge {}">{}</span>').format(tone, text or plain(tone))


_WORDS = {
    "no_match": "no match",
    "no_decision": "no decision",
    "no_discrepancy": "no discrepancy",
    "supported": "claim supported",
    "refuted": "claim refuted",
    "undecidable": "claim undecidable",
}


def plain(word: str) -> str:
    """Return a decision or a verdict as text."""
    return _WORDS.get(word, word)


def unbroken(text: object) -> Markup:
    """Prevent line breaks within times and options of a text."""
    return Markup(_WHOLE.sub(r'<span class="whole">\g<0></span>', str(escape(text))))


def whole(text: object) -> Markup:
    """Return text without line breaks."""
    return Markup('<span class="whole">{}</span>').format(text)


def listed(texts: Iterable[object], kind: str = "ul") -> Markup:
    """Return a list: ``ul``, or ``ol`` for a numbered one; nothing without texts."""
    return _tag(kind, _join(_tag("li", text) for text in texts))


def terms(texts: Mapping[str, str]) -> Markup:
    """Return terms with their explanations."""
    one = Markup("<div><dt>{}</dt><dd>{}</dd></div>\n")
    return _tag("dl", _join(one.format(term, text) for term, text in texts.items()), "columns")


def columns(blocks: Iterable[Markup]) -> Markup:
    """Return blocks side by side, where there is room."""
    return _tag("div", _join(blocks), "columns")


def verbatim(text: str) -> Markup:
    """Return text with its line breaks; nothing without a text."""
    return _tag("pre", text)


def figure(picture: Panel, *, narrow: bool = False) -> Markup:
    """Return a picture with its caption."""
    return Markup(
        '<figure{}>\n<img src="data:image/png;base64,{}" width="{}" height="{}" alt="{}">\n'
        "<figcaption>{}</figcaption>\n</figure>\n"
    ).format(
        Markup(' class="narrow"') if narrow else "", base64.b64encode(picture.png).decode(),
        picture.width_px, picture.height_px, picture.alt, picture.caption,
    )  # fmt: skip


def facts(pairs: Iterable[tuple[object, object]], caption: object = "", kind: str = "") -> Markup:
    """Return a table of names and values; of a value in two parts, the second explains it."""
    row = Markup('<tr><th scope="row">{}</th><td>{}</td></tr>\n')
    body = _tag("tbody", _join(row.format(name, value) for name, value in pairs))
    return _table(body, caption, kind)


def explained(value: object, about: object) -> Markup:
    """Return a value of :func:`facts` with its explanation below it."""
    return Markup('{}<br><span class="note">{}</span>').format(value, about)


def digest(value: str) -> Markup:
    """Return a hash, or that it isn't known."""
    return Markup('<span class="hash">{}</span>').format(value or "not known")


def table(
    headings: Sequence[str],
    rows: Iterable[Sequence[object] | str],
    caption: object = "",
    *,
    sorts: bool = False,
) -> Markup:
    """Return a table.

    Parameters
    ----------
    headings : sequence of str
        One that begins with ``#`` is of a column of numbers.
    rows : iterable
        Each a sequence of texts or :class:`Cell`, or a text: the heading of the rows below it.
    caption : str or Markup, optional
    sorts : bool, optional
        Whether it sorts by its headings, for a page that ``sorts``.
    """
    looks = [Markup(' class="n"') if name.startswith("#") else "" for name in headings]
    button = Markup('<button type="button">{}</button>' if sorts else "{}")
    head = _join(
        Markup('<th scope="col"{}>{}</th>').format(look, button.format(name.removeprefix("#")))
        for look, name in zip(looks, headings, strict=True)
    )
    body = _join(
        Markup('<tr><th scope="rowgroup" colspan="{}">{}</th></tr>\n').format(len(headings), row)
        if isinstance(row, str)
        else _tag("tr", _join(map(_cell, looks, row)))
        for row in rows
    )
    return _table(_tag("thead", _tag("tr", head)) + _tag("tbody", body), caption)


def _cell(look: Markup | str, value: object) -> Markup:
    content, key = value if isinstance(value, Cell) else (value, None)
    by = "" if key is None else Markup(' data-key="{}"').format(key)
    return Markup("<td{}{}>{}</td>").format(look, by, content)


def _table(content: Markup, caption: object, kind: str = "") -> Markup:
    return _tag("div", _tag("table", _tag("caption", caption) + content, kind), "wide")
