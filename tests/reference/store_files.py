"""Stores filled for a test."""

from __future__ import annotations

import numpy as np

from rsenf.reference import open_reference
from rsenf.reference.readings import ReadOptions
from rsenf.reference.store import import_file
from rsenf.reference.store.sample_file import BLOCK

TODAY = "2026-01-01T00:00:00Z"
# Samples of 1 s, numbered from 1970: shortly before a block of the store's files ends.
BORDER = 6400 * BLOCK
S = 10**9


def write_csv(path, seconds, freq_hz):
    """Write values at seconds since 1970, with as many decimals as they have."""
    times = np.asarray(seconds).astype("datetime64[s]").astype(str)
    rows = [f"{t}Z,{f!r}" for t, f in zip(times, np.asarray(freq_hz).tolist(), strict=True)]
    path.write_text("\n".join(["time,frequency", *rows]) + "\n", encoding="utf-8")
    return path


def bring(store, path, grid="ce", **options):
    return import_file(store, path, grid, ReadOptions(**options), imported_utc=TODAY)


def held(store, grid="ce"):
    """Everything the store has of a grid: seconds since 1970, values, readings."""
    reference = open_reference(f"store:{grid}", store=store)
    step_ns = round(reference.step_s * S)
    t_ns = reference.t0_ns + np.arange(reference.freq_hz.size) * step_ns
    return t_ns, np.asarray(reference.freq_hz), np.asarray(reference.readings)


def files_in(store):
    return sorted(str(p.relative_to(store)) for p in store.rglob("*") if p.is_file())
