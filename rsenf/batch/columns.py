"""The columns of the result table: common ones, and those of each analysis."""

from __future__ import annotations

from typing import Any, Literal

from rsenf.batch.recordings import Recording

VERSION = 1  # changes when a column is removed or changes its meaning
Kind = Literal["text", "texts", "number", "count"]
Row = dict[str, Any]

DONE, NO_SIGNAL, UNUSABLE, FAILED = STATUSES = ("done", "no_signal", "unusable", "failed")

FIRST: dict[str, Kind] = {"path": "text", "status": "text", "reason": "text"}
LAST: dict[str, Kind] = {
    "warnings": "texts",
    "loss": "text",
    "recording_s": "number",
    "size_bytes": "count",
    "modified_utc": "text",
    "sha256": "text",
    "took_s": "number",
    "tries": "count",
    "host": "text",
    "rsenf_version": "text",
}
# Names as in the JSON of the command for one recording.
ANALYSES: dict[str, dict[str, Kind]] = {
    "verify": {
        "decision": "text",
        "grid": "text",
        "start_utc": "text",
        "lag_s": "number",
        "lag_std_s": "number",
        "correlation": "number",
        "log10_lr": "number",
        "log10_lr_absent": "number",
        "verbal": "text",
        "claim": "text",
        "claim_log10_lr": "number",
        "clock_ppm": "number",
        "clock_std_ppm": "number",
        "idle_ratio": "number",
        "search_size": "count",
        "seconds_used": "number",
        "method": "text",
    },
    "idle": {
        "verdict": "text",
        "idle_ratio": "number",
        "idle_ratio_std": "number",
        "idle_ratio_low": "number",
        "idle_ratio_high": "number",
        "read_out_time_s": "number",
        "read_out_time_std_s": "number",
        "direction": "text",
        "frame_rate_hz": "number",
        "nominal_hz": "number",
        "method": "text",
    },
    "track": {
        "values": "count",
        "usable_values": "count",
        "enf_mean_hz": "number",
        "enf_mean_std_hz": "number",
        "enf_min_hz": "number",
        "enf_max_hz": "number",
        "enf_std_median_hz": "number",
        "snr_median_db": "number",
        "nominal_hz": "number",
        "harmonic": "count",
        "line_hz": "number",
        "frame_rate_hz": "number",
        "enf_file": "text",
    },
    "discover": {
        "verdict": "text",
        "effects": "texts",
        "gap_before": "number",
        "gap_before_stderr": "number",
        "gap_after": "number",
        "gap_stderr": "number",
        "gap_floor": "number",
        "gap_limit": "number",
        "shrinkage": "number",
        "unexplained": "text",
        "report": "text",
    },
}


def columns_of(analysis: str) -> dict[str, Kind]:
    """Return the columns of an analysis's table, in order."""
    return FIRST | ANALYSES[analysis] | LAST


def make_row(
    recording: Recording, analysis: str, settings: str, status: str, reason: str, **more: Any
) -> Row:
    """Return the journal's row of a recording.

    Parameters
    ----------
    recording : Recording
    analysis : str
    settings : str
        Fingerprint of everything else that the result depends on.
    status : str
        One of ``STATUSES``.
    reason : str
        Why there is no result, or only a negative one.
    **more
        Other columns; those not given are unknown.
    """
    return {
        "version": VERSION,
        "key": recording.key,
        "analysis": analysis,
        "settings": settings,
        "size_bytes": recording.size_bytes,
        "modified_ns": recording.modified_ns,
        "path": recording.path,
        "status": status,
        "reason": reason,
        **more,
    }
