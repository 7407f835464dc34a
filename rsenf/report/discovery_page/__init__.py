"""The page on what a model was found to lack: the story in pictures, one file."""

from __future__ import annotations

from rsenf.report.discovery_page.beside import beside_page
from rsenf.report.discovery_page.page import discovery_page

__all__ = ["beside_page", "discovery_page"]
