"""What would help where nothing, or nothing certain, was found."""

from __future__ import annotations

from rsenf.report.recording_time.case import Case

_NO_SIGNAL = (
    "The camera's own file, not a copy that was coded again on its way (messengers, video sites).",
    "A part of the recording lit by mains lamps, with a camera and a scene that hold still.",
    "Another recording by the same camera with a short exposure: 1/100 s (1/120 s on a 60 Hz grid) "
    "swallows the flicker whole.",
    "Another estimator and another harmonic: --enf-method stft --harmonic 2.",
    "If the grid is known, its nominal frequency: --nominal-hz 50 or 60.",
)
_LONGER = "A longer recording, or more of the same one: a few minutes tell more than one."
_NO_MATCH = (
    "A reference that covers other days, and references of other grids.",
    "A check of the reference's times: their zone (--timezone) and what they stamp (--stamp).",
    "Whether the clip is one unedited piece, played at its own speed.",
    "The camera's own file, not a copy that was coded again.",
)
_UNEDITED = "The recording as the camera wrote it, before anything was done to it."
_NO_DECISION = (
    "A reference of fewer hours, if other evidence narrows the time: fewer wrong times to mistake.",
    "The camera's own file, not a copy that was coded again: clearer flicker, smaller errors.",
    "A second, independent reference of the same grid and time.",
)


def what_would_help(case: Case) -> list[str]:
    """Return what a person could do, the most useful first; nothing for a match."""
    result = case.result
    usable_s = sum(e.usable for e in case.estimates)
    if result.decision == "match":
        return []
    if not usable_s:
        return list(_NO_SIGNAL)
    if result.segments:
        return [_UNEDITED]
    gaps = ["A reference with fewer gaps."] if any(r.gaps for r in case.references) else []
    if result.decision == "no_match":
        return [*_NO_MATCH, *gaps]
    return [_LONGER, *_NO_DECISION, *gaps]
