"""Settings other than the default for every field of every kind of node, and where each can run.

A kind or a field that isn't here fails ``test_node_kinds``.
"""

from __future__ import annotations

import dataclasses
import typing
from typing import Any

from pydantic import BaseModel

from rsenf.config.node_kind import NodeKind

# Say what a node is, and where it stands; a test gives them.
PLACE = {"kind", "restart", "cameras", "camera", "grid", "input", "out", "archive", "topics"}
PLACE |= {"rename", "command", "reads", "sends"}

_ROWS = {
    "block_frames": 4,
    "strips": 4,
    "tiles": 16,
    "mask": False,
    "tile_means": True,
    "stabilise": False,
}
_STFT = {"nominal_hz": 50, "harmonic": 2, "line_m": -5, "window_s": 16, "hop_s": 2}
_IDLE = {"method": "vertical_phase", "nominal_hz": 50, "every_s": 7}
_LIMITS = {"search_hz": 0.4, "min_snr": 30, "max_std_hz": 0.03}

# Of each kind, settings that together leave no field at its default. All of one number are run in
# one graph, each number of a camera of its own.
VARIANTS: dict[str, list[dict[str, Any]]] = {
    "decode": [
        {"frames": "fused", "rows": {**_ROWS, "read_out_axis": "auto"}, "threads": 1,
         "effort": "full", "hwaccel": "auto"},
        {"frames": "tcp", "ring_slots": 4, "open_timeout_s": 20, "read_timeout_s": 20,
         "max_reconnects": 2, "backoff_initial_s": 0.5, "backoff_max_s": 20,
         "wait_for_source": True, "frame_rate_hz": 30},
    ],
    "rows": [{}, {"rows": {**_ROWS, "read_out_axis": "columns"}}],
    "track": [
        {"track": {"method": "stft", **_STFT, **_LIMITS}, "idle": _IDLE},
        {"track": {"method": "paper", "nominal_hz": 50, "interpolation": "linear"}},
    ],
    "idle": [{}, {"idle": _IDLE}],
    "match": [
        {"method": "ncc", "interim_every_s": 20, "keep_hours": 0.0125, "match": {
            "min_seconds": 10, "min_overlap": 0.4, "smoothing": "window", "reference_std_hz": 2e-3,
            "reference_noise_hz": 1e-4, "clock_scale_ppm": 50, "max_chance": 0.02,
            "min_log10_lr": 1.5, "min_fit": 0.02, "tolerance_s": 2, "candidates": 3,
            "threshold_correlation": 0.9}},
        {"method": "metric3"},
    ],
    "live": [
        {"start": "2026-01-02T03:05:00Z", "live": {
            "earliest_s": -3, "latest_s": 7, "clock_scale_ppm": 60, "lost_s": 6, "frozen_s": 6,
            "limits": {"live": 6, "stale": -30, "most": 13, "least": -40}, "loop_s": 2,
            "keep_hours": 12, "search_every_s": 30, "report_every_s": 2}},
        {},
    ],
    "discover": [
        {"model": "MODEL", "discover": {
            "nominal_hz": 50, "window_s": 30, "every_s": 20, "lines": 48}},
        {},
    ],
    "reference": [
        {"store": "STORE", "step_s": 1, "column": "frequency", "nominal_hz": 50, "stamp": "centre",
         "timezone": "Europe/Paris", "time_column": "time", "time_format": "%Y-%m-%d %H:%M:%S"},
        {"follow": True},
    ],
    "record": [
        {"overwrite": True, "flush_every_s": 0.2, "compress": False,
         "disk": {"warn_mb": 2, "stop_mb": 1}},
        {"rotation": {"every_s": 600, "size_mb": 10}, "retention": {"days": 2, "disk_share": 0.4},
         "alarms": {"trigger": "cam/alarm", "before_s": 5, "after_s": 5, "only": True,
                    "memory_mb": 16}},
    ],
    "replay": [
        {"rate": 1, "start_s": 1, "end_s": 9, "loop": 0, "frames": "tcp", "ring_slots": 4},
    ],
    "foxglove": [{"host": "localhost", "port": 0}],
    "dashboard": [{"host": "localhost", "port": 0, "password_env": "PATH"}],
    "notify": [{"queue": "QUEUE", "to": [{"via": "exec", "command": ["true"]}]}],
    "external": [{}],
}  # fmt: skip


# What can't be otherwise in a test, and why.
FIXED = {
    "decode": {"pace": "played at its own speed, it takes as long", "record_video": "regress needs"
               " the video"},
}  # fmt: skip


def untried(kind: type[NodeKind], variants: list[dict[str, Any]]) -> set[str]:
    """Return the fields of a kind that no variant sets to another value than the default."""
    missing: set[str] = set()
    for name, field in kind.model_fields.items():
        if name not in PLACE:
            given = [variant[name] for variant in variants if name in variant]
            missing |= _untried(name, field.annotation, field.get_default(), given)
    return missing


def _untried(name: str, hint: Any, default: Any, given: list[Any]) -> set[str]:
    """Return what of a field, or of the settings in it, is at its default wherever it is given."""
    cls = next((t for t in (hint, *typing.get_args(hint)) if dataclasses.is_dataclass(t)), None)
    if cls is None:
        return set() if any(_differs(value, default) for value in given) else {name}
    hints = typing.get_type_hints(cls)
    missing: set[str] = set()
    for field in dataclasses.fields(typing.cast("Any", cls)):
        values = [value[field.name] for value in given if field.name in value]
        factory = field.default_factory
        its = field.default if factory is dataclasses.MISSING else factory()
        missing |= {f"{name}.{m}" for m in _untried(field.name, hints[field.name], its, values)}
    return missing


def _differs(value: Any, default: Any) -> bool:
    plain = default.model_dump() if isinstance(default, BaseModel) else default
    return bool(value != plain)
