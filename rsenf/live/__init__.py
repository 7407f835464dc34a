"""Is this feed live? Does a camera's flicker follow the grid now, or that of another time?"""

from __future__ import annotations

from rsenf.live.settings import Limits, LiveSettings
from rsenf.live.stage import Live, Silence

__all__ = ["Limits", "Live", "LiveSettings", "Silence"]
