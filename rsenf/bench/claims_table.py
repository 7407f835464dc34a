"""Records of scenes with nothing to claim, to the table of false claims."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rsenf.bench.bounds import rate_bound
from rsenf.bench.groups import cells
from rsenf.bench.results import Record

ALL = "all"
_CLAIMING = ("estimated", "ambiguous")


def claims_rows(records: Iterable[Record]) -> list[dict[str, Any]]:
    """Return a row for each scene, for all of them, coding and method, with the 95 % bound."""
    known = list(records)
    everything = [record | {"scene": ALL} for record in known]
    return [
        cell
        | {
            "kind": kind,
            "method": method,
            "clips": len(found),
            "claims": (claims := sum(claimed(result) for _, result in found)),
            "bound_ratio": rate_bound(claims, len(found)),
            "broke": sum("broke" in result for _, result in found),
        }
        for kind in ("idle", "enf")
        for cell, methods in cells([*known, *everything], ("scene",), kind)
        for method, found in methods.items()
    ]


def claimed(result: dict[str, Any]) -> bool:
    """Whether a method claims to have found something: an idle ratio, or one second of ENF."""
    if result.get("t_s"):
        return True
    return result.get("verdict") in _CLAIMING and result["idle_percent"] is not None
