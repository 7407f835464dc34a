"""Shared by the HTML pages: frame, style and embedded pictures; no external resources."""

from __future__ import annotations

from rsenf.report.pages.fill import HEIGHT_IN, Picture, fill, picture_of, setting

__all__ = ["HEIGHT_IN", "Picture", "fill", "picture_of", "setting"]
