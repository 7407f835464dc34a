"""Presents a comparison with a reference as plain values and as a model; joins it with rows."""

from __future__ import annotations

import dataclasses
import math
from itertools import pairwise
from typing import Any

import numpy as np

from rsenf.discrepancy.clock_offset.fit import LagFit, clock_ppm
from rsenf.discrepancy.clock_offset.hypotheses import SKEWED
from rsenf.discrepancy.clock_offset.verdict import ClockOffsetDiscovery
from rsenf.discrepancy.next_measurement import TELLS
from rsenf.discrepancy.residual_breakdown import ResidualShare
from rsenf.discrepancy.residual_classifier import ResidualClass, hint_json
from rsenf.model import CATALOGUE, CaptureModel

# A crystal's error is smaller; beyond, the assumed frame rate is more likely wrong.
CRYSTAL_PPM = 200.0
SURE = 3.0  # standard errors from which on a share is reported
BANDS_HZ = (0.0, 0.005, 0.01, 0.02, 0.05, 0.1, 0.5)
OTHER = "other_course"  # class of a residual that no hypothesis explains


def beside_json(found: ClockOffsetDiscovery, model_out: str) -> dict[str, Any]:
    """Return a comparison as plain values with stable keys.

    Parameters
    ----------
    found : ClockOffsetDiscovery
    model_out : str
        Path of the extended model file.
    """
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
            "codec": 0.0,  # a codec doesn't change the times of the flicker
            "shrinkage": None if math.isnan(found.shrinkage) else found.shrinkage,
        },
        "where_before": [dataclasses.asdict(share) for share in where_beside(found, found.first)],
        "reference": reference_json(found),
        "unexplained": _unexplained(found),
        "model_out": model_out,
    }


def reference_json(found: ClockOffsetDiscovery) -> dict[str, Any]:
    """Return how clip and reference were aligned, as plain values."""
    beside, (_, lag_s, stderr) = found.beside, found.final
    return {
        "name": beside.grid.name,
        "lag_s": beside.begins_s + lag_s,
        "lag_stderr_s": float(stderr[0]),
        "read_as": "an average over 20 s" if beside.averaged else "the grid's frequency",
        "std_hz": math.sqrt(beside.power_hz2),
        "estimate_noise_hz": found.chance.estimate_std_hz,
        "reference_noise_hz": found.chance.reference_std_hz,
        "block_s": beside.block_s,
    }


def joined(rows: dict[str, Any], beside: dict[str, Any]) -> dict[str, Any]:
    """Join the JSON results of rows and reference on a recording; the gap is that of the rows."""
    verdicts = {rows["verdict"], beside["verdict"]}
    worst = ("unexplained", "explained", "no_discrepancy")
    kept = {name: beside[name] for name in ("verdict", "gap", "where_before", "unexplained")}
    return rows | {
        "verdict": next(verdict for verdict in worst if verdict in verdicts),
        "effects": [*rows["effects"], *beside["effects"]],
        "reference": beside["reference"] | kept,
        "unexplained": rows["unexplained"] or beside["unexplained"],
    }


def beside_model(found: ClockOffsetDiscovery, made_from: str) -> CaptureModel:
    """Return the extended model, with its provenance and the standard error of its clock.

    Parameters
    ----------
    found : ClockOffsetDiscovery
    made_from : str
        Name of the recording, for the provenance.
    """
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


def _skew_json(found: ClockOffsetDiscovery) -> dict[str, Any]:
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


def _unexplained(found: ClockOffsetDiscovery) -> dict[str, Any] | None:
    if found.verdict != "unexplained":
        return None
    places = [place for place in where_beside(found, found.last) if place.sure > SURE]
    kinds = [way.kind.name for way in found.rest] or [OTHER]
    leaps = tuple(w.kind.at_s for w in found.rest if not math.isnan(w.kind.at_s))
    would_tell = dict.fromkeys(text for kind in kinds for text in TELLS[kind])
    return {
        "gap": found.gap(found.last).value,
        "std_hz": math.sqrt(max(found.gap(found.last).value, 0.0) * found.beside.power_hz2),
        "places": [dataclasses.asdict(place) for place in places],
        **hint_json(ResidualClass(kinds[0], tuple(kinds[1:]), tuple(would_tell), at_s=leaps)),
    }


def where_beside(found: ClockOffsetDiscovery, fit: LagFit) -> list[ResidualShare]:
    """Split a fit's residual by time and by frequency of the wander."""
    return [*_by_time(found, fit), *_by_frequency(found, fit)]


def _by_time(found: ClockOffsetDiscovery, fit: LagFit) -> list[ResidualShare]:
    """Share of each held-out block in their residual beyond chance."""
    beside, chance = found.beside, found.chance
    held = beside.held_out & np.isfinite(fit.residual_hz)
    total = float((fit.residual_hz[held] ** 2 - chance.var_hz2).sum())
    out = []
    for number in np.unique(beside.block[held]):
        here = held & (beside.block == number)
        over = float((fit.residual_hz[here] ** 2 - chance.var_hz2).sum())
        spread = float((chance.sets_hz[:, here] ** 2).sum(axis=1).std(ddof=1))
        first_s = float(number) * beside.block_s
        out.append(_share("time_s", first_s, first_s + beside.block_s, over, total, spread))
    return out


def _by_frequency(found: ClockOffsetDiscovery, fit: LagFit) -> list[ResidualShare]:
    """Share of each frequency band of the wander, over all values."""
    known = np.isfinite(fit.residual_hz)
    every = np.vstack([fit.residual_hz[known], found.chance.sets_hz[:, known]])
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


def _share(
    axis: str, low: float, high: float, over: float, total: float, spread: float
) -> ResidualShare:
    return ResidualShare(axis, low, high, over / (total or 1e-30), over / max(spread, 1e-30))
