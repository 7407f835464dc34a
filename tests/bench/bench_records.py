"""Records written by hand."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

from rsenf.bench.harness import BenchRun, Progress


def lit(seed: int, idle: dict[str, Any], enf: dict[str, Any], **more: Any) -> dict[str, Any]:
    """Return the record of a lit clip; results by method, one coding."""
    return {
        "key": f"lit {seed}", "scene": "lit", "size": "480p", "frame_rate": "29.97",
        "nominal_hz": 50.0, "seed": seed, "duration_s": 60.0, "frames": 1798, "grid": "synthetic",
        "flicker_level": 11.0, "alias_turn_rad": 3800.0, "enf_bound_mhz": 0.01,
        "idle_bound_percent": 1e-4, "versions": {"rsenf": "1"},
        "found": {"lossless": {"idle": idle, "enf": enf}},
    } | more  # fmt: skip


def idle(verdict: str, error: float | None = None, std: float | None = None) -> dict[str, Any]:
    """Return what an idle method said."""
    percent = None if error is None else 30 + error
    return {"verdict": verdict, "error_percent": error, "std_percent": std,
            "idle_percent": percent, "cpu_s": 0.6}  # fmt: skip


def enf(errors: list[float], std: float = 0.5, first_s: float = 10.5) -> dict[str, Any]:
    """Return what an ENF method said, a value a second."""
    return {"t_s": [first_s + n for n in range(len(errors))], "error_mhz": errors,
            "std_mhz": [std] * len(errors), "cpu_s": 0.3}  # fmt: skip


def run_in(folder: Path, say: Callable[[str], None] = print) -> BenchRun:
    """Return a run without options, whose results are in a folder."""

    def settings(**_: Any) -> None: ...

    def counting(what: str, total: int) -> AbstractContextManager[Progress]:
        return nullcontext(lambda done, missing: None)

    options = argparse.Namespace(table_only=False, jobs=1)
    return BenchRun(options, folder, settings, say, say, counting)
