"""A camera's model from many recordings, and whether another recording fits it.

In: models that ``discover`` has fitted, one for each recording of one camera, as plain values with
the standard errors of their parameters. Out: one capture model of the camera, with what its
recordings have in common, and the spread; and of another recording's model whether it fits.

Model: ``x_i = μ + b_i + e_i`` for a parameter in recording ``i``. ``μ`` is the camera's; ``b``
varies between its recordings (temperature, a codec), with variance ``τ²``; ``e`` is the error of
the fit, of the stated variance. Random-effects meta-analysis gives ``μ`` and ``τ`` (DerSimonian
1986); that of the idle ratio is shrunk to a usual one, as in ``idle/compare.py``. The shutter, and
the effects that say so (``of_camera``: clock, crop, direction, fields, tone curve, banding), are
the camera's; all others are each recording's own.

Statistic of another recording: ``t = (x − μ) / √(τ² + s² + var μ)`` for each parameter, Student's
t with the degrees of freedom of ``τ``: one fewer than there were recordings, and what the usual one
counts. p-values are corrected for the number of parameters (Holm 1979).

Approximate: parameters are taken as independent. Equal parameters don't prove one camera: others
of its model have the same.

References
----------
- DerSimonian, R. and Laird, N. (1986), Meta-analysis in clinical trials, Controlled Clinical
  Trials 7, 177.
- Holm, S. (1979), A simple sequentially rejective multiple test procedure, Scandinavian Journal of
  Statistics 6, 65.
"""

from __future__ import annotations

import contextlib
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy import special

from rsenf.errors import InputError, UsageError
from rsenf.idle.compare import USUAL_FREEDOM, USUAL_SCATTER_RATIO, shrunk_std
from rsenf.medians import between_var
from rsenf.messages.schema import FloatArray
from rsenf.model import CaptureModel
from rsenf.model.effects import CATALOGUE
from rsenf.whole_file import whole_file

SAME_RATE = 1.01e-3  # largest relative difference of equal frame rates: 30 and 29.97, as written
IDLE, CLOCK = "shutter.idle_ratio", "clock_skew"
MADE_BY = "rsenf batch discover"
DIFFERS = 1e-3  # corrected p-value below which a recording doesn't fit
Plain = Mapping[str, Any]  # of CaptureModel.to_dict


@dataclass(frozen=True)
class Common:
    """A parameter that the recordings of a camera have in common.

    Attributes
    ----------
    mean, stderr : float
    spread : float
        Standard deviation between recordings, beyond their stated errors.
    recordings : int
    freedom : float
        Degrees of freedom of the spread.
    """

    mean: float
    stderr: float
    spread: float
    recordings: int
    freedom: float

    @property
    def is_valid(self) -> bool:
        """Whether it holds what :func:`pooled` returns."""
        values = (self.mean, self.stderr, self.spread, self.freedom)
        known = all(isinstance(v, float | int) and math.isfinite(v) for v in values)
        return known and self.stderr > 0.0 and self.spread >= 0.0 and self.freedom > 0.0

    def deviation(self, value: float, stderr: float) -> tuple[float, float]:
        """Return how far another value is off, in standard errors, and its two-sided p-value."""
        t = (value - self.mean) / math.hypot(self.stderr, self.spread, stderr)
        return t, float(2.0 * special.stdtr(self.freedom, -abs(t)))


def pooled(value: FloatArray, stderr: FloatArray, usual_std: float = 0.0) -> Common:
    """Pool values with their errors by random-effects meta-analysis (DerSimonian and Laird 1986).

    Parameters
    ----------
    value, stderr : ndarray (recordings,)
        Two at least; errors above 0.
    usual_std : float
        Usual standard deviation between recordings, to which the found one is shrunk; 0 if unknown.

    Examples
    --------
    >>> one = pooled(np.array([1.0, 1.2, 0.8]), np.full(3, 0.1))
    >>> round(one.mean, 3), round(one.spread, 3), one.recordings
    (1.0, 0.173, 3)
    """
    var = between_var(value, stderr**2)
    spread = shrunk_std(var, value.size - 1, usual_std) if usual_std else math.sqrt(var)
    weight = 1.0 / (stderr**2 + spread**2)
    mean = float(np.average(value, weights=weight))
    freedom = value.size - 1 + (USUAL_FREEDOM if usual_std else 0.0)
    return Common(mean, float(weight.sum()) ** -0.5, spread, value.size, freedom)


def camera_of(models: Sequence[Plain]) -> CaptureModel:
    """Return one model of the camera that all recordings are of.

    Its ``provenance`` says what they have in common (a :class:`Common` for each parameter), and in
    how many recordings each other effect was found.

    Parameters
    ----------
    models : sequence of mapping
        Of :func:`without_series`.

    Raises
    ------
    InputError
        If there are fewer than two, or they are of several modes: frame rate, rows, direction.
    """
    # One mean a frame tells nothing of the shutter.
    models = [model for model in models if IDLE in model["provenance"]["stderr"]]
    if len(models) < 2:
        raise InputError("a camera's model takes two recordings of rows", "name more of them")
    if other := next((m for m in models if not _same_mode(models[0], m)), None):
        modes = f"{_mode_words(models[0])}, and {_mode_words(other)}"
        raise InputError(f"recordings of several modes: {modes}", "give those of one mode")
    seen = Counter(name for model in models for name in _effects(model))
    always = [n for n in _effects(models[0]) if seen[n] == len(models) and _is_of_camera(n)]
    if not all(_same_rate(models[0], model) for model in models):
        always = [name for name in always if name != CLOCK]
    found = [_parameters(model) for model in models]
    mine = {"shutter", *always}
    names = [n for n in found[0] if n.split(".")[0] in mine and all(n in one for one in found)]
    values = {name: np.array([one[name] for one in found]) for name in names}
    usual = {IDLE: USUAL_SCATTER_RATIO * (1.0 - models[0]["shutter"]["idle_ratio"])}
    common = {name: pooled(v[:, 0], v[:, 1], usual.get(name, 0.0)) for name, v in values.items()}
    shutter, effects = dict(models[0]["shutter"]), {n: _effects(models[0])[n] for n in always}
    parts = {"shutter": shutter, **{n: dict(effect) for n, effect in effects.items()}}
    for name, one in common.items():
        part, _, parameter = name.partition(".")
        parts[part][parameter] = one.mean
    plain = CaptureModel(name="camera").to_dict() | {
        "shutter": shutter,
        "sensor": models[0]["sensor"],
        "effects": [{name: parts[name]} for name in always],
        "provenance": {
            "made_by": MADE_BY,
            "recordings": len(models),
            "common": {name: asdict(one) for name, one in common.items()},
            "other_effects": {n: count for n, count in seen.items() if n not in always},
        },
    }
    return CaptureModel.from_dict(plain)


def write_camera(path: Path, models: Sequence[Plain]) -> dict[str, Any]:
    """Write the model that :func:`camera_of` makes of recordings; return its provenance."""
    camera = camera_of(models)
    with whole_file(path) as part:
        part.write_text(yaml.safe_dump(camera.to_dict(), sort_keys=False), encoding="utf-8")
    return camera.provenance


def without_series(model: CaptureModel) -> dict[str, Any]:
    """Return plain values of a model for :func:`camera_of`, without what is a recording's own."""
    plain = model.to_dict()
    # A series is a recording's own.
    effects = [
        {name: {k: v for k, v in effect.items() if not isinstance(v, list)}}
        for name, effect in _effects(plain).items()
    ]
    parts = {part: plain[part] for part in ("shutter", "sensor")}
    known = model.provenance.get("stderr", {}).items()
    stderr = {name: error for name, error in known if math.isfinite(error)}
    return parts | {"effects": effects, "provenance": {"stderr": stderr}}


def fit_to(camera: CaptureModel, model: Plain) -> dict[str, Any]:
    """Compare a recording's model with a camera's, as plain values with stable keys (Holm 1979).

    Parameters
    ----------
    camera : CaptureModel
        Of :func:`camera_of`.
    model : mapping
        Of the recording, from :func:`without_series`.

    Returns
    -------
    dict
        ``verdict`` 'fits', 'differs' or 'undecided' with its ``reason``; ``p_value``, corrected,
        of the parameter that fits worst; and ``parameters``.

    Raises
    ------
    UsageError
        If the model isn't one of a camera.
    """
    common, plain, found = check_camera(camera), camera.to_dict(), _parameters(model)
    same_mode = _same_mode(plain, model)
    apart = set() if _same_rate(plain, model) else {CLOCK}
    names = {n for n in common.keys() & found.keys() if n.split(".")[0] not in apart}
    compared = {name: common[name].deviation(*found[name]) for name in names}
    rows: list[dict[str, Any]] = [
        {
            "name": name, "value": found[name][0], "stderr": found[name][1],
            "expected": common[name].mean, "spread": common[name].spread,
            "t": t, "p_value": p_value,
        }
        for name, (t, p_value) in sorted(compared.items(), key=lambda item: item[1][1])
        if same_mode and IDLE in found
    ]  # fmt: skip
    # Holm's first step: whether any of them differs.
    p_value = min(len(rows) * rows[0]["p_value"], 1.0) if rows else 1.0
    ours, theirs = (set(filter(_is_of_camera, _effects(m))) - apart for m in (plain, model))
    verdict, reason = "differs" if p_value < DIFFERS else "fits", ""
    if IDLE not in model["provenance"]["stderr"]:
        reason = "one mean a frame tells nothing of a shutter"
    elif not same_mode:
        reason = f"it is of another mode: {_mode_words(model)}"
    elif not rows:
        reason = "no parameter is known of both"
    elif verdict == "fits" and ours != theirs:
        missing = [f"no {name}" for name in sorted(ours - theirs)]
        reason = f"it has {', '.join([*sorted(theirs - ours), *missing])}"
    return {
        "verdict": "undecided" if reason else verdict, "reason": reason,
        "p_value": p_value if rows else None, "parameters": rows,
    }  # fmt: skip


def check_camera(camera: CaptureModel) -> dict[str, Common]:
    """Return what the recordings of a camera have in common.

    Raises
    ------
    UsageError
        If the model isn't one of a camera.
    """
    common: dict[str, Common] = {}
    with contextlib.suppress(KeyError, TypeError, AttributeError):
        if camera.provenance["made_by"] == MADE_BY:
            common = {name: Common(**one) for name, one in camera.provenance["common"].items()}
    if not common:
        raise UsageError("no model of a camera", f"{MADE_BY} --one-camera makes one")
    if bad := [name for name, one in common.items() if not one.is_valid]:
        raise UsageError(f"{bad[0]} of the camera's model isn't as it was written")
    return common


def _same_rate(one: Plain, other: Plain) -> bool:
    """Whether clocks can be compared: their errors are relative to the rate as written."""
    return Fraction(one["shutter"]["frame_rate"]) == Fraction(other["shutter"]["frame_rate"])


def _same_mode(one: Plain, other: Plain) -> bool:
    a, b = one["shutter"], other["shutter"]
    ratio = float(Fraction(a["frame_rate"]) / Fraction(b["frame_rate"]))
    same = a["rows"] == b["rows"] and a["read_out"] == b["read_out"]
    return same and abs(ratio - 1.0) < SAME_RATE


def _mode_words(model: Plain) -> str:
    return "{frame_rate} fps, {rows} rows, read by {read_out}".format(**model["shutter"])


def _effects(model: Plain) -> dict[str, dict[str, Any]]:
    return {name: values for effect in model["effects"] for name, values in effect.items()}


def _is_of_camera(name: str) -> bool:
    return name in CATALOGUE and CATALOGUE[name].of_camera


def _parameters(model: Plain) -> dict[str, tuple[float, float]]:
    """Value and standard error of each parameter of the camera, by part and name."""
    parts = {n: e for n, e in _effects(model).items() if _is_of_camera(n)}
    parts["shutter"] = model["shutter"]
    out = {}
    for key, stderr in model["provenance"].get("stderr", {}).items():
        part, _, name = key.partition(".")
        value = parts.get(part, {}).get(name)
        if isinstance(value, float) and 0.0 < stderr < math.inf:
            out[key] = (value, float(stderr))
    return out
