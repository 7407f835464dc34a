"""Shared by the HTML pages: frame, style and embedded pictures (PNG); no external resources.

A template is rendered to a self-contained page.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rsenf.report.panels import new_figure

WIDTH_IN, HEIGHT_IN, DPI = 6.4, 3.0, 175


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A picture with its texts."""

    file: str
    title: str
    caption: str
    alt: str
    png: bytes
    width_px: int
    height_px: int


def picture_of(
    file: str,
    title: str,
    draw: Callable[[Any], None],
    caption: str,
    alt: str,
    *,
    width_in: float = WIDTH_IN,
    height_in: float = HEIGHT_IN,
) -> Picture:
    """Draw a picture; to be called within :func:`rsenf.report.panels.fixed_style`.

    Parameters
    ----------
    file, title, caption, alt : str
    draw : callable
        Draws onto the figure given.
    width_in, height_in : float, optional
        Size in inches. Text is 10 points high: the narrower the picture, the larger on a phone.
    """
    figure = new_figure(width_in, height_in)
    draw(figure)
    held = io.BytesIO()
    # Without matplotlib's version in the file, which the page lists elsewhere.
    figure.savefig(held, format="png", dpi=DPI, metadata={"Software": None})
    return Picture(
        file=file, title=title, caption=caption, alt=alt, png=held.getvalue(),
        width_px=round(width_in * DPI), height_px=round(height_in * DPI),
    )  # fmt: skip


def setting(value: Any) -> str:
    """Return a parameter's value as text.

    >>> setting((0.5, None, True))
    '0.5, not set, yes'
    """
    if value is None or value == "":
        return "not set"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        return ", ".join(map(setting, value)) or "not set"
    return f"{value:g}" if isinstance(value, float) else str(value)


def fill(
    template: Path,
    pictures: Sequence[Picture],
    filters: Mapping[str, Callable[..., Any]] | None = None,
    **values: Any,
) -> str:
    """Render a page; all values are HTML-escaped.

    Parameters
    ----------
    template : Path
        A Jinja template that extends ``frame.html.j2``.
    pictures : sequence of Picture
        The template's ``pictures``; their PNG data are its ``inlined``, in base64.
    filters : mapping of str to callable, optional
        Filters of the template.
    **values
        Variables of the template.
    """
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([template.parent, Path(__file__).parent]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters.update(filters or {})
    inlined = [base64.b64encode(p.png).decode() for p in pictures]
    return environment.get_template(template.name).render(
        pictures=pictures, inlined=inlined, **values
    )
