"""Match: a clip's ENF against a reference of grid frequency, by a method chosen by name."""

from __future__ import annotations

from rsenf.match.matcher import Finding, Matcher, check_lengths
from rsenf.match.ncc import LagTable, masked_ncc
from rsenf.match.settings import MatchSettings
from rsenf.match.stage import METHODS, Match

__all__ = [
    "METHODS",
    "Finding",
    "LagTable",
    "Match",
    "MatchSettings",
    "Matcher",
    "check_lengths",
    "masked_ncc",
]
