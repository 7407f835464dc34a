"""Table of where model and data disagree: the share of the first gap of each part."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rsenf.discrepancy.residual_breakdown import ResidualShare

MOST = 10  # parts listed for each axis, those with the largest shares
DIGITS = {"time_s": 1, "row": 0, "level": 1, "alias_hz": 2, "wander_hz": 3}
Pair = tuple[ResidualShare | None, ResidualShare | None]
NAMES = {
    "time_s": "time (s)",
    "row": "rows",
    "level": "level of the wall",
    "strip": "strip",
    "step": "from one frame to the next",
    "alias_hz": "frequency (alias, Hz)",
    "wander_hz": "how fast it wanders (Hz)",
}


def places_table(
    before: Sequence[ResidualShare], after: Sequence[ResidualShare], smaller: float
) -> list[dict[str, Any]]:
    """Return a group of table lines for each axis.

    Parameters
    ----------
    before, after : sequence of ResidualShare
    smaller : float
        Ratio of the gap after to the gap before.
    """
    groups = []
    for axis, name in NAMES.items():
        old, new = ([s for s in shares if s.axis == axis] for shares in (before, after))
        pairs = _lines(old, new) if axis == "alias_hz" else list(zip(old, new, strict=True))
        if not pairs or (len(pairs) < 2 and axis != "step"):
            continue
        most = sorted(pairs, key=lambda pair: -max(abs(s.share) for s in pair if s))[:MOST]
        lines = [_line(*pair, smaller) for pair in pairs if pair in most]
        groups.append({"name": name, "lines": lines, "left_out": len(pairs) - len(most)})
    return groups


def _lines(before: list[ResidualShare], after: list[ResidualShare]) -> list[Pair]:
    """Pair spectral lines, which may differ before and after."""
    old, new = ({(share.low, share.high): share for share in shares} for shares in (before, after))
    return [(old.get(at), new.get(at)) for at in sorted({**old, **new})]


def _line(old: ResidualShare | None, new: ResidualShare | None, smaller: float) -> dict[str, str]:
    place = old or new
    assert place is not None
    return {
        "place": _place(place),
        "before": _percent(old, 1.0),
        "before_sure": _sure(old),
        "after": _percent(new, smaller),
        "after_sure": _sure(new),
    }


def _place(share: ResidualShare) -> str:
    if share.axis == "step":
        return "all"
    if share.axis == "strip":
        return f"{share.low + 1:.0f}"
    digits = DIGITS[share.axis]
    return f"{share.low:.{digits}f} to {share.high:.{digits}f}"


def _percent(share: ResidualShare | None, of: float) -> str:
    return f"{100.0 * share.share * of:.2f} %" if share else "no line"


def _sure(share: ResidualShare | None) -> str:
    return f"{share.sure:.{1 if abs(share.sure) < 100.0 else 0}f}" if share else ""
