"""What a model was found to lack, in words."""

from __future__ import annotations

from typing import Any

VERDICTS = {
    "no_discrepancy": "the model explains this recording",
    "explained": "what was missing is found",
    "unexplained": "something is missing that no effect of the catalogue explains",
}


def discovery_words(told: dict[str, Any]) -> str:
    """Say to a person what :func:`rsenf.discrepancy.discovery_json` says."""
    gap, reference = told["gap"], told.get("reference", {})
    # Beside rows a reference has a gap of its own.
    alone = bool(reference) and "gap" not in reference
    power = "reference's variance" if alone else "flicker's power"
    lines = [
        f"{told['verdict']}: {VERDICTS[told['verdict']]}",
        f"  {'gap at first':15} {gap['before']:.2e} ± {gap['before_stderr']:.1e} of the {power}, "
        "in blocks of time that nothing was fitted to",
    ]
    for effect in told["effects"]:
        lines.append(f"  {'added':15} {_name(effect)}: gap {effect['gap_after']:.2e}")
        lines += [f"  {'':15}   {line}" for line in _parameters(effect)]
        if effect["class"]:
            lines.append(f"  {'what decides':15} {effect['told_apart_by']}")
    lines += _at_last(gap)
    if "gap" in reference:
        first, stderr = reference["gap"]["before"], reference["gap"]["before_stderr"]
        lines.append(f"  {'reference':15} gap {first:.2e} ± {stderr:.1e} of its variance at first")
        lines += _at_last(reference["gap"])
    if reference:
        lines.append(
            f"  {'lag':15} {reference['lag_s']:.2f} ± {reference['lag_stderr_s']:.2f} s into "
            f"{reference['name']}, taken for {reference['read_as']}"
        )
    if told["unexplained"]:
        for place in told["unexplained"]["places"]:
            lines.append(f"  {'where':15} {_place(place)}")
        for kind in told["unexplained"].get("kind", []):
            lines.append(f"  {'it looks like':15} {kind['kind']}")
        if "told_apart_by" in told["unexplained"]:
            lines.append(f"  {'what decides':15} {told['unexplained']['told_apart_by']}")
    lines.append(f"  {'model':15} {told['model_out']}")
    return "\n".join(lines)


def _at_last(gap: dict[str, Any]) -> list[str]:
    lines = [
        f"  {'gap at last':15} {gap['after']:.2e} ± {gap['stderr']:.1e}; data that the model "
        f"itself has made have {gap['floor']:.1e}, at most {gap['limit']:.1e}"
    ]
    if gap["shrinkage"] is not None:
        lines.append(f"  {'shrinkage':15} {100.0 * gap['shrinkage']:.1f} % of what was above that")
    return lines


def _name(effect: dict[str, Any]) -> str:
    return str(effect["name"]) if effect["name"] else " or ".join(effect["class"])


def _parameters(effect: dict[str, Any]) -> list[str]:
    out = []
    for name, value in effect["parameters"].items():
        error = effect["stderr"].get(name)
        if error is not None:
            out.append(f"{name} {value:.6g} ± {error:.2g}")
    return out


def _place(place: dict[str, Any]) -> str:
    return (
        f"{place['axis']} {place['low']:.4g} to {place['high']:.4g}: "
        f"{100.0 * place['share']:.0f} % of the gap"
    )
