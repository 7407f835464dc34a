"""Rows: steady-pixel mask and row means, from frames to row blocks."""

from rsenf.rows.luminance import blocks_from_luminance
from rsenf.rows.stage import Rows, RowsSettings

__all__ = ["Rows", "RowsSettings", "blocks_from_luminance"]
