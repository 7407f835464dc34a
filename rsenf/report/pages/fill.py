"""Renders a template to a self-contained page."""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rsenf.report.pages.picture import Picture


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
