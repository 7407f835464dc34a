"""Verdicts on liveness and alarms as JSON."""

from __future__ import annotations

from typing import Any

from rsenf.messages import Alarm, Liveness
from rsenf.report.verdict import number
from rsenf.timebase import seconds, utc_text


def live_json(liveness: Liveness) -> dict[str, Any]:
    """Return the JSON document of a verdict on liveness; None for what is unknown."""
    return {
        "t_s": seconds(liveness.header.pts_ns),
        "epoch": liveness.header.epoch,
        "verdict": liveness.verdict,
        "since_utc": utc_text(liveness.since_ns),
        "lag_s": number(liveness.lag_s),
        "lag_std_s": number(liveness.lag_std_s),
        "clock_ppm": number(liveness.clock_ppm),
        "clock_std_ppm": number(liveness.clock_std_ppm),
        "log10_lr": number(liveness.log10_lr),
        "origin_utc": utc_text(liveness.origin_utc_ns),
        "evidence": liveness.evidence,
    }


def alarm_json(alarm: Alarm) -> dict[str, Any]:
    """Return the JSON document of an alarm, or of its end."""
    return {
        "start_s": seconds(alarm.start_pts_ns),
        "end_s": None if alarm.active else seconds(alarm.end_pts_ns),
        "epoch": alarm.header.epoch,
        "kind": alarm.kind,
        "severity": alarm.severity,
        "active": alarm.active,
        "value": number(alarm.value),
        "limit": number(alarm.limit),
        "unit": alarm.unit,
        "text": alarm.text,
    }
