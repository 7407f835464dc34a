"""The settings of a batch, checked before anything long begins, and what tells them from others."""

from __future__ import annotations

import argparse
import hashlib
import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rsenf.cli.batch_work import Settings
    from rsenf.cli.references import Opened

# Of the batch itself: no result depends on them.
# fmt: off
OWN = (
    "debug", "analysis", "inputs", "list", "out", "jobs", "scheduler", "timeout_s", "retry", "json",
)
# fmt: on


def settings_of(args: argparse.Namespace, threads: int) -> Settings:
    """Return the settings that the arguments ask for.

    Raises
    ------
    UsageError
        When they can't be meant so: said once here rather than of every recording.
    """
    from rsenf import __version__
    from rsenf.cli.batch_work import Settings
    from rsenf.cli.references import open_references

    arguments = _absolute(args)
    _check(args.analysis, arguments)
    references = open_references(arguments) if getattr(arguments, "reference", None) else []
    told = {name: _told(value) for name, value in vars(arguments).items() if name != "store"}
    told |= {"reference": [_content(reference) for reference in references]}
    text = json.dumps([args.analysis, __version__, told], sort_keys=True)
    fingerprint = hashlib.sha256(text.encode()).hexdigest()[:16]
    return Settings(args.analysis, fingerprint, arguments, os.path.abspath(args.out), threads)


def told_settings(settings: Settings) -> dict[str, Any]:
    """Return the settings that were given, for people."""
    given = vars(settings.arguments).items()
    return {name: value for name, value in given if value not in (None, "", False, [])}


def _absolute(args: argparse.Namespace) -> argparse.Namespace:
    """Return the verb's arguments with paths that hold in any folder."""
    kept = {name: value for name, value in vars(args).items() if name not in OWN}
    if kept.get("reference"):
        kept["reference"] = [_absolute_reference(spec) for spec in kept["reference"]]
    if kept.get("store"):
        kept["store"] = os.path.abspath(kept["store"])
    if kept.get("model"):
        kept["model"] = kept["model"].absolute()
    if kept.get("effects"):
        kept["effects"] = [path.absolute() for path in kept["effects"]]
    return argparse.Namespace(**kept)


def _absolute_reference(spec: str) -> str:
    from rsenf.reference.open import STORE

    return spec if spec.startswith(STORE) else os.path.abspath(spec)


def _check(analysis: str, arguments: argparse.Namespace) -> None:
    """Refuse what would be wrong for every recording."""
    from rsenf.cli.console import track_settings

    if analysis == "track":
        track_settings(arguments, None)
    elif analysis == "idle":
        from rsenf.cli.idle import idle_settings

        idle_settings(arguments)
    elif analysis == "verify":
        from rsenf.cli.verify import claimed_ns_of
        from rsenf.match.stage import Match

        claimed_ns_of(arguments)
        track_settings(arguments, None)
        Match(method=arguments.method)
    else:
        from rsenf.cli.discover import begun_with

        begun_with(arguments)


def _told(value: Any) -> Any:
    """Return a setting as plain values; of a file, its content."""
    if isinstance(value, Path):
        return hashlib.sha256(value.read_bytes()).hexdigest()
    return [_told(each) for each in value] if isinstance(value, list) else value


def _content(reference: Opened) -> Sequence[Any]:
    """Return what tells a reference from any other, and from itself after an import."""
    span = (reference.t0_ns, reference.step_s, int(reference.freq_hz.size))
    return (reference.grid, reference.nominal_hz, reference.sha256, *span)
