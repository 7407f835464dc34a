"""What a reference told, as plain values, as a model file, and joined to what the rows told."""

from __future__ import annotations

import dataclasses
import math
from itertools import pairwise
from typing import Any

import numpy as np

from rsenf.discrepancy.grid import GridDiscovery
from rsenf.discrepancy.grid_effects import DRIFTS, LEAPT, SKEWED, WANDERS
from rsenf.discrepancy.grid_fit import clock_ppm
from rsenf.discrepancy.where import Share
from rsenf.model import CATALOGUE, CaptureModel

# Further off is no crystal: more likely the frames come at another rate than is assumed.
CRYSTAL_PPM = 200.0
SURE = 3.0  # standard errors with which a place is one
BANDS_HZ = (0.0, 0.005, 0.01, 0.02, 0.05, 0.1, 0.5)
KINDS = {
    DRIFTS: "a clock that drifts, the camera's or the reference's",
    LEAPT: "a leap of time: many frames lost or repeated, or a cut",
    WANDERS: "a frame rate that wanders, or a reference that does",
}
DECIDES = "a second reference of the same time: the camera's error is against both, theirs isn't"


def grid_json(found: GridDiscovery, model_out: str) -> dict[str, Any]:
    """Return the keys of a discovery, plain values all."""
    before, after, floor = found.gap(found.first), found.gap(found.last), found.floor
    return {
        "version": 1,
        "verdict": found.verdict,
        "effects": [_skew_json(found)] if found.skew else [],
        "gap": {
            "before": before.value,
            "before_stderr": before.stderr,
            "after": after.value,
            "stderr": after.stderr,
            "floor": floor.median,
            "limit": floor.limit,
            "shrinkage": None if math.isnan(found.shrinkage) else found.shrinkage,
        },
        "reference": reference_json(found),
        "unexplained": _left(found),
        "model_out": model_out,
    }


def reference_json(found: GridDiscovery) -> dict[str, Any]:
    """Return how clip and reference were compared."""
    beside, (_, lag_s, stderr) = found.beside, found.final
    return {
        "name": beside.grid.name,
        "lag_s": lag_s,
        "lag_stderr_s": float(stderr[0]),
        "read_as": "an average over 20 s" if beside.averaged else "the grid's frequency",
        "std_hz": math.sqrt(beside.power_hz2),
        "estimate_noise_hz": found.chance.estimate_std_hz,
        "reference_noise_hz": found.chance.reference_std_hz,
        "block_s": beside.block_s,
    }


def joined(rows: dict[str, Any], grid: dict[str, Any]) -> dict[str, Any]:
    """Join what the rows and a reference told of one recording: the gap stays that of the rows."""
    verdicts = {rows["verdict"], grid["verdict"]}
    worst = ("unexplained", "explained", "no_discrepancy")
    left = [told["unexplained"] for told in (grid, rows) if told["unexplained"]]
    places = [place for told in left for place in told["places"]]
    both = {key: value for told in left for key, value in told.items()} | {"places": places}
    return rows | {
        "verdict": next(verdict for verdict in worst if verdict in verdicts),
        "effects": [*rows["effects"], *grid["effects"]],
        "reference": grid["reference"] | {"gap": grid["gap"], "verdict": grid["verdict"]},
        "unexplained": both if left else None,
    }


def grid_model(found: GridDiscovery, made_from: str) -> CaptureModel:
    """Return the extended model, with where it comes from and how sure its clock is."""
    model, _, stderr = found.final
    known = dict(model.provenance)
    known.setdefault("made_by", "rsenf discover")
    known["from"] = made_from
    if found.skew:
        errors = {f"{SKEWED}.clock_ppm": float(stderr[1])}
        known["stderr"] = known.get("stderr", {}) | errors
    known["reference"] = reference_json(found) | {
        "verdict": found.verdict,
        "gap": {"before": found.gap(found.first).value, "after": found.gap(found.last).value},
    }
    return dataclasses.replace(model, provenance=known)


def _skew_json(found: GridDiscovery) -> dict[str, Any]:
    skew, (model, _, stderr) = found.skew, found.final
    assert skew is not None
    ppm = clock_ppm(model)
    crystal = abs(ppm) < CRYSTAL_PPM
    decides = "which of the two clocks is off, " + CATALOGUE[SKEWED].told_apart_by
    if not crystal:
        decides = "the rate at which the frames were taken: 29.97 for 30 per second is 1000 ppm"
    return {
        "name": SKEWED if crystal else None,
        "class": [] if crystal else [SKEWED, "frame rate"],
        "parameters": {"clock_ppm": ppm},
        "stderr": {"clock_ppm": float(stderr[1])},
        "told_apart_by": decides,
        "gap_before": found.gap(found.first).value,
        "gap_after": found.gap(found.last).value,
        "gain": skew.gain_hz2 / found.beside.power_hz2,
        "evidence": skew.nats,
        "tried": found.tried,
    }


def _left(found: GridDiscovery) -> dict[str, Any] | None:
    if found.verdict != "unexplained":
        return None
    places = [*_by_time(found), *_by_frequency(found)]
    return {
        "gap": found.gap(found.last).value,
        "std_hz": math.sqrt(max(found.gap(found.last).value, 0.0) * found.beside.power_hz2),
        "kind": [
            {
                "kind": KINDS[way.kind.name],
                "at_s": None if math.isnan(way.kind.at_s) else way.kind.at_s,
                "evidence": way.nats,
            }
            for way in found.rest
            if way.kind.name in KINDS
        ],
        "told_apart_by": DECIDES,
        "places": [dataclasses.asdict(place) for place in places if place.sure > SURE],
    }


def _by_time(found: GridDiscovery) -> list[Share]:
    """Share of each held-out block in what is left of them beyond chance."""
    beside, chance = found.beside, found.chance
    own = beside.held_out & np.isfinite(found.last.left_hz)
    total = float((found.last.left_hz[own] ** 2 - chance.var_hz2).sum())
    out = []
    for number in np.unique(beside.block[own]):
        here = own & (beside.block == number)
        over = float((found.last.left_hz[here] ** 2 - chance.var_hz2).sum())
        spread = float((chance.sets_hz[:, here] ** 2).sum(axis=1).std(ddof=1))
        first_s = float(number) * beside.block_s
        out.append(_share("time_s", first_s, first_s + beside.block_s, over, total, spread))
    return out


def _by_frequency(found: GridDiscovery) -> list[Share]:
    """Share of each band of frequencies of the wander, all values together."""
    known = np.isfinite(found.last.left_hz)
    every = np.vstack([found.last.left_hz[known], found.chance.sets_hz[:, known]])
    power = np.abs(np.fft.rfft(every, axis=1)) ** 2
    hz = np.fft.rfftfreq(int(known.sum()), found.beside.track.hop_s)
    over = power[0] - power[1:].mean(axis=0)
    out = []
    for low, high in pairwise(BANDS_HZ):
        band = (hz >= low) & (hz < high)
        spread = float(power[1:, band].sum(axis=1).std(ddof=1))
        out.append(
            _share("wander_hz", low, high, float(over[band].sum()), float(over.sum()), spread)
        )
    return out


def _share(axis: str, low: float, high: float, own: float, total: float, spread: float) -> Share:
    return Share(axis, low, high, own / (total or 1e-30), own / max(spread, 1e-30))
