"""The result table of a batch as an HTML page."""

from __future__ import annotations

from rsenf.report.batch_page.page import batch_page

__all__ = ["batch_page"]
