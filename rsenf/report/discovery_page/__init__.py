"""The page on what a capture model lacks of a recording: by its rows, and beside a reference.

Read ``page`` (sections and verdicts in sentences), then ``steps`` (tables) and ``pictures``.
"""

from __future__ import annotations

from rsenf.report.discovery_page.page import beside_page, discovery_page

__all__ = ["beside_page", "discovery_page"]
