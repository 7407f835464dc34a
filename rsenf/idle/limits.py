"""When an estimate is not to be claimed, whatever the method."""

from __future__ import annotations

from rsenf.idle.seen import Finding, Seen

# Flicker that is still to so great a part has turned by less than about a radian: at a span of
# ``s`` radians the mean of ``exp(jψ)`` is ``sinc(s/2)``.
MAX_STILL_RATIO = 0.96
# The weakest lamps on the market flicker by half a per cent; what an exposure of a whole number of
# periods leaves is less than a thousandth, and grows with the grid's deviation.
MIN_FLICKER_RATIO = 1e-3
# Below this many turns every row sees the same light: half a millisecond of read-out.
MIN_TURNS = 0.05
MAX_STD_RATIO = 0.025  # standard error of the idle ratio
# Of the frame period: a read-out can't take longer, an estimate may by its error.
SLACK_RATIO = 0.02

CROP = "a crop, as by electronic image stabilisation, counts as idle"


def checked(seen: Seen, finding: Finding) -> Finding:
    """Return the finding, or why it must not be claimed."""
    if finding.verdict != "estimated":
        return finding
    std_ratio = finding.turns_std / seen.most_turns
    if abs(finding.turns) < max(MIN_TURNS, 2.0 * finding.turns_std):
        return _refused(
            "every row sees the light at once: a global shutter, or a very short read-out"
        )
    if not std_ratio <= MAX_STD_RATIO:
        return _refused(f"too uncertain: ±{100 * std_ratio:.1f} points, the codec has gone too far")
    if seen.idle_ratio(finding.turns) < -max(SLACK_RATIO, 3.0 * std_ratio):
        return _refused("the rows' phases would take longer than a frame to read")
    return finding


def too_still(seen: Seen) -> bool:
    """Whether the flicker hardly turned from frame to frame, so that texture hides it."""
    return seen.moments.still_ratio() > MAX_STILL_RATIO


def _refused(reason: str) -> Finding:
    return Finding(verdict="refused", reason=reason)


STILL = Finding(
    verdict="ambiguous",
    reason="the flicker stands still from frame to frame, and its phase turned by less than about "
    "a radian: it can't be told from the picture's texture",
)
WEAK = _refused(
    "hardly any flicker is left: an exposure of a whole number of its periods (anti-flicker), or "
    "a nearly steady light"
)
