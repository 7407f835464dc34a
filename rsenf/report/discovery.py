"""Effects that a capture model was found to lack, and hints on the rest, as text and JSON."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

from rsenf.messages import DiscoveryVerdict
from rsenf.report.values import lines_text, number, texts

Lines = list[tuple[str, str]]  # names and texts
# Limits for a place to be named: share of a spectral line, and share of a part over the even share.
LINE, UNEVEN = 0.1, 1.5
KINDS: dict[str, str] = texts("discovery")["kinds"]
LISTED = 8  # frame numbers that are listed


def discovery_words(doc: dict[str, Any]) -> str:
    """Return the result of a discovery, from rows or against a reference, as text.

    Parameters
    ----------
    doc : dict
        Of :func:`rsenf.discrepancy.result.discovery_json`, joined with that of a reference or not;
        or of :func:`rsenf.discrepancy.clock_offset.beside_json`.
    """
    gap, reference = doc["gap"], doc.get("reference", {})
    beside_rows = "gap" in reference  # the reference has a gap beside that of the rows
    power = "reference's variance" if reference and not beside_rows else "flicker's power"
    held_out = ", in blocks of time that nothing was fitted to"
    lines = [("gap at first", f"{_at_first(gap)} of the {power}{held_out}")]
    for effect in doc["effects"]:
        lines.append(("added", f"{_name(effect)}: gap {effect['gap_after']:.2e}"))
        if effect.get("words"):
            lines.append(("", f"  in no catalogue: {effect['words']} ({effect['file']})"))
        lines += [("", f"  {line}") for line in _parameters(effect)]
        if effect.get("course"):
            lines.append(("", f"  over time: {_course(effect['course'])}"))
        if effect["class"]:
            lines.append(("what decides", effect["told_apart_by"]))
    lines += _at_last(gap)
    if doc["unexplained"] and doc["unexplained"] != reference.get("unexplained"):
        lines += _residual_lines(doc["unexplained"], doc["where_before"])
    if reference:
        begins = f"{reference['lag_s']:.2f} ± {reference['lag_stderr_s']:.2f} s"
        taken = f"{reference['name']}, taken for {reference['read_as']}"
        lines.append(("reference", f"{taken}; the recording begins {begins} into it"))
    if beside_rows:
        first = f"{_at_first(reference['gap'])} of the reference's variance"
        lines += [("gap at first", first), *_at_last(reference["gap"])]
        if reference["unexplained"]:
            lines += _residual_lines(reference["unexplained"], reference["where_before"])
    lines += [("camera", camera_words(doc["camera"]))] if "camera" in doc else []
    lines.append(("model", doc["model_out"]))
    return lines_text(f"{doc['verdict']}: {texts('discovery')['verdicts'][doc['verdict']]}", lines)


def camera_words(fit: dict[str, Any]) -> str:
    """Return whether a recording fits a camera's model, as text.

    Parameters
    ----------
    fit : dict
        Of :func:`rsenf.discrepancy.fleet.fit_to`.
    """
    said = f"{fit['verdict']}: {fit['reason']}" if fit["reason"] else fit["verdict"]
    if not fit["parameters"]:
        return said
    worst = fit["parameters"][0]
    return (
        f"{said} ({worst['name']} {worst['value']:.6g} where {worst['expected']:.6g} is expected, "
        f"t = {worst['t']:.1f}; p = {fit['p_value']:.2g})"
    )


def _at_first(gap: dict[str, Any]) -> str:
    return f"{gap['before']:.2e} ± {gap['before_stderr']:.1e}"


def _at_last(gap: dict[str, Any]) -> Lines:
    last = (
        f"{gap['after']:.2e} ± {gap['stderr']:.1e}; data that the model itself has made have "
        f"{gap['floor']:.1e}, at most {gap['limit']:.1e}"
    )
    codec = (
        "the model's own rows, coded again as this recording was, have "
        f"{gap['codec']:.1e}: effects that are smaller can't be seen"
    )
    shrinks = f"{100.0 * (gap['shrinkage'] or 0.0):.1f} % of what was above that"
    return [
        ("gap at last", last),
        *([("its codec", codec)] if gap["codec"] else []),
        *([("shrinkage", shrinks)] if gap["shrinkage"] is not None else []),
    ]


def watch_json(verdict: DiscoveryVerdict) -> dict[str, Any]:
    """Return the JSON document of the verdict on one window of a stream; its keys are stable."""
    return {
        "verdict": verdict.verdict,
        "reason": verdict.reason,
        "changed": list(verdict.changed),
        "effects": [
            {
                "name": effect.name or None,
                "class": list(effect.members),
                "parameters": dict(
                    zip(effect.parameter_names, map(float, effect.parameters), strict=True)
                ),
            }
            for effect in verdict.effects
        ],
        "gap": {
            name: number(getattr(verdict, f"gap_{name}"))
            for name in ("before", "after", "stderr", "floor", "limit")
        },
        "unexplained": verdict.unexplained_text,
        "frames": [verdict.header.frame_first, verdict.header.frame_last],
        "frames_missing": verdict.frames_missing,
        "windows_skipped": verdict.windows_skipped,
    }


def _residual_lines(residual: dict[str, Any], everywhere: list[dict[str, Any]]) -> Lines:
    """Describe the unexplained residual: its place, where it is uneven, and its possible kind."""
    counts = Counter(place["axis"] for place in everywhere)
    most = [place for place in residual["places"] if _stands_out(place, counts[place["axis"]])]
    tone = tone_words(residual)
    return [
        *(("where", _place(place)) for place in most),
        ("perhaps", kind_words(residual)),
        *([("", tone)] if tone else []),
        *(("would tell", text) for text in residual["would_tell"]),
    ]


def _stands_out(place: dict[str, Any], parts: int) -> bool:
    if place["axis"] == "alias_hz":
        return bool(place["share"] > LINE)
    return bool(parts > 1 and place["share"] > UNEVEN / parts)


def effect_words(effect: dict[str, Any]) -> str:
    """Return an effect as one line: its name, or those of its class, and its parameters."""
    return ": ".join(filter(None, [_name(effect), ", ".join(_parameters(effect))]))


def _name(effect: dict[str, Any]) -> str:
    return str(effect["name"]) if effect["name"] else " or ".join(effect["class"])


def _parameters(effect: dict[str, Any]) -> list[str]:
    out, errors = [], effect["stderr"]
    frames = effect["parameters"].get("at_frames")
    if frames:  # single events: their rate follows from them
        return [f"at frames {', '.join(map(str, frames[:LISTED]))}{' …' * (len(frames) > LISTED)}"]
    for name, value in effect["parameters"].items():
        error = errors.get(name)
        if isinstance(error, list):
            out += [f"{name}[{n}] {v:.4g} ± {error[n]:.2g}" for n, v in enumerate(value)]
        elif error is not None:
            out.append(f"{name} {value:.6g} ± {error:.2g}")
        elif isinstance(value, float) and not errors:
            out.append(f"{name} {value:.3g}")
    return out


def _place(place: dict[str, Any]) -> str:
    return (
        f"{place['axis']} {place['low']:.4g} to {place['high']:.4g}: "
        f"{100.0 * place['share']:.0f} % of the gap"
    )


def _course(course: dict[str, Any]) -> str:
    """Return the form of a parameter's course over time, and its coefficients, as text."""
    terms = [f"{k} {v:.3g}" for k, v in course.items() if isinstance(v, float) and k != "leaves"]
    if "at_s" in course:
        terms.append(f"at {', '.join(f'{t_s:.1f}' for t_s in course['at_s'])} s")
    return f"{course['form']}: {', '.join(terms)}"


FEW = 4  # frequencies or times that are listed


def kind_words(residual: dict[str, Any]) -> str:
    """Return the possible kinds of an unexplained residual as text.

    Parameters
    ----------
    residual : dict
        ``unexplained`` of :func:`rsenf.discrepancy.result.discovery_json`.
    """
    words = [KINDS[residual["kind"]], *(KINDS[kind] for kind in residual["also"])]
    if residual["at_s"]:
        words[0] += f", {_some(residual['at_s'], '.1f')} s after the start"
    if residual["period_frames"]:
        words[0] += f", coming again after {residual['period_frames']} frames"
    if residual["slow"] is not None:
        words[0] += ", wandering slowly" if residual["slow"] else ", at random from frame to frame"
    if residual["rows"]:
        first, last = residual["rows"]
        words[words.index(KINDS["rows"])] += f" ({first:.0f} to {last:.0f})"
    return "; ".join(words)


def tone_words(residual: dict[str, Any]) -> str:
    """Return the frequencies that a tone with this alias may have, as text; '' without a tone."""
    if "alias_hz" not in residual:
        return ""
    alias = f"the frames show {residual['alias_hz']:.2f} Hz"
    likely = _some(residual["likely_hz"], ".1f", " or ")
    by_rows = f", which down the rows looks like {likely} Hz" if likely else ""
    others = residual["may_be_hz"]
    return (
        f"{alias}{by_rows}; by the frames alone it may be any of {len(others)} frequencies up to "
        f"{others[-1]:.0f} Hz ({_some(others, '.1f')})"
    )


def _some(values: Sequence[float], how: str, between: str = ", ") -> str:
    text = between.join(f"{value:{how}}" for value in values[:FEW])
    return f"{text} …" if len(values) > FEW else text
