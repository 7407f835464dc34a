"""The rows stage as settings ask for it. The only place where the read-out axis meets its judge."""

from __future__ import annotations

from rsenf.rows.settings import AUTO, RowsSettings
from rsenf.stage import Stage


def make_rows(settings: RowsSettings) -> Stage:
    """Build the stage from frames to row blocks."""
    from rsenf.rows.stage import Rows  # OpenCV: 40 ms that not everybody needs

    if settings.read_out_axis != AUTO:
        return Rows(settings)
    from rsenf.flicker.axis import find_axis
    from rsenf.rows.auto import AutoRows

    return AutoRows(settings, find_axis)
