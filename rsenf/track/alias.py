"""The illumination frequency's alias at the frame rate: all that one value a frame can show."""

from __future__ import annotations

from collections.abc import Sequence

from rsenf.errors import UsageError
from rsenf.flicker.lines import Line
from rsenf.track.settings import TrackSettings
from rsenf.track.sliding import NO_FLICKER


def check_line(settings: TrackSettings, method: str) -> None:
    """Refuse settings that ask for another line than the harmonic's own.

    Parameters
    ----------
    settings : TrackSettings
    method : str
        Name of the method, for the message.

    Raises
    ------
    UsageError
        If they do.
    """
    if settings.line_m not in (None, 0):
        raise UsageError(
            f"{method} reads the illumination frequency itself, not line {settings.line_m}",
            "leave the line out, or take another method",
        )


def is_folded(line: Line, frame_rate_hz: float, search_hz: float) -> bool:
    """Whether the search band overlaps its own mirror image.

    One real value a frame has the same spectrum on both sides of 0 Hz and of half the frame rate,
    so that near them the sign of the deviation is unknown.

    Parameters
    ----------
    line : Line
    frame_rate_hz : float
    search_hz : float
        Half-width of the search band.

    Examples
    --------
    >>> is_folded(Line(50.0, 1, 0), 25.0, 1.0), is_folded(Line(50.0, 1, 0), 29.97, 1.0)
    (True, False)
    """
    twice_hz = 2.0 * line.carrier_hz
    apart_hz = abs(twice_hz - frame_rate_hz * round(twice_hz / frame_rate_hz))
    return apart_hz <= 2.0 * search_hz


def why_nothing(lines: Sequence[Line], frame_rate_hz: float, search_hz: float) -> str:
    """Return why nothing was found at the aliases of some lines, which may be folded.

    Parameters
    ----------
    lines : sequence of Line
    frame_rate_hz : float
    search_hz : float
        Half-width of the search band.
    """
    grids = [f"{x.nominal_hz:.0f}" for x in lines if is_folded(x, frame_rate_hz, search_hz)]
    if not grids:
        return NO_FLICKER
    alias_hz = min(abs(x.alias_hz(frame_rate_hz)) for x in lines)
    where = "0 Hz" if alias_hz <= search_hz else "half the frame rate"
    blind = (
        f"flicker of a {' or '.join(grids)} Hz grid shows too near {where} at "
        f"{frame_rate_hz:.3f} frames/s for one value a frame"
    )
    return blind if len(grids) == len(lines) else f"{NO_FLICKER}; {blind}"
