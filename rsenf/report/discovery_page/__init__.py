"""The HTML page on effects that a model was found to lack, with pictures, in one file.

In: a discovery from rows (``Discovery``), from a reference (``ClockOffsetDiscovery``), or both.
Read ``page`` (rows) with ``steps`` and ``pictures``; then ``beside`` (reference, and the
extended model as text).
"""

from __future__ import annotations

from rsenf.report.discovery_page.beside import beside_page
from rsenf.report.discovery_page.page import discovery_page

__all__ = ["beside_page", "discovery_page"]
