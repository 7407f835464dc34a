"""The tables as text and as Markdown.

False alarms against delay, as the limit is moved: of the verdict and of the correlation.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rsenf.bench.tables import Row, Table, made_from, picture, shown, titled

_NOTE = """\
Delay: from the first false picture to the alarm at the monitor, all buffers of the trackers in it;
median and 90 % of those found. live before: attacks on feeds that were called live when they began.
below: the rate that so few false alarms refute with 95 % confidence (Poisson). Honest hours are all
feeds up to their attack. Alarms within a minute of another count as one false alarm.
verdict: stale or frozen. no longer live: any other verdict, no signal too. nats: evidence from the
surest "live" down to "stale". Half of the other cameras are as live as the first. The trade-off is
of the attacks that were coded once more, and of other cameras: no picture gives them away."""


def text(document: Row, *, on_page: bool = False) -> str:
    """Return the tables of :func:`rsenf.bench.live.table.tabulated`."""
    live = document["live_share"]
    made = made_from(
        document,
        "feeds",
        f"grids: {', '.join(document['grids'])}",
        "limit: " + ", ".join(f"{n:.1f} nats" for n in document["limits_nats"]),
        always=() if live is None else (f"called live in {100 * live:.1f} % of the honest time",),
    )
    return titled(_tables(document), [_NOTE, made], on_page=on_page)


def _tables(document: Row) -> Iterator[Table]:
    yield (
        "Honest feeds",
        ("rule", "hours", "false alarms", "an hour", "below"),
        [[row["rule"], *_rates(row)] for row in document["honest"]],
    )
    yield (
        "Attacks",
        ("attack", "rule", "feeds", "live before", "found", "95 % interval", "delay", "90 %"),
        [[row["kind"], row["rule"], str(row["attacks"]), str(row["live_before"]), *_found(row)]
         for row in document["attacks"]],
    )  # fmt: skip
    for name, rows in document["trade_off"].items():
        yield (
            f"Trade-off by {name}",
            (name, "hours", "false alarms", "an hour", "below", "found", "95 % interval", "delay",
             "90 %"),
            [[f"{row['limit']:g}", *_rates(row), *_found(row)] for row in rows],
        )  # fmt: skip
    yield (
        "False alarms of the live stage",
        ("feed", "at", "said"),
        [[row["key"], f"{row['t_s']:.0f} s", row["said"]] for row in document["false"]],
    )


def _rates(row: Row) -> list[str]:
    return [f"{row['hours']:.1f}", str(row["false"]), shown(row["per_hour"], ".2g"),
            shown(row["bound_per_hour"], ".2g")]  # fmt: skip


def _found(row: Row) -> list[str]:
    interval = f"{100 * row['found_low']:.0f} to {100 * row['found_high']:.0f} %"
    return [f"{row['found']}/{row['attacks']}", interval, shown(row["delay_median_s"], ".0f", " s"),
            shown(row["delay_90_s"], ".0f", " s")]  # fmt: skip


_SHOWN = {
    "nats": ("the verdict, by its limit in nats", "#0b62a4", "o"),
    "correlation": ("sliding correlation, by its limit", "#c23b22", "s"),
}


def draw(path: Path, document: dict[str, Any]) -> None:
    """Draw the trade-off into a PNG file; the upper bound stands for no false alarm at all.

    Raises
    ------
    RecordingError
        When the file can't be written.
    """
    with picture(path, (7, 5)) as figure:
        axes = figure.subplots()
        for name, (label, colour, marker) in _SHOWN.items():
            rows = [r for r in document["trade_off"][name] if r["delay_median_s"] is not None]
            delay = [r["delay_median_s"] for r in rows]
            rates = [r["per_hour"] or r["bound_per_hour"] for r in rows]
            axes.plot(delay, rates, color=colour, linewidth=1, label=label)
            for row, x, y in zip(rows, delay, rates, strict=True):
                some = row["false"] > 0
                axes.plot(
                    x, y, marker if some else "v", color=colour, mfc=colour if some else "none"
                )
                note = f"{row['limit']:g} ({row['found']}/{row['attacks']})"
                axes.annotate(note, (x, y), (4, 4), textcoords="offset points", fontsize="x-small")
        axes.set_yscale("log")
        axes.set_xlabel("median delay of the attacks found (s)")
        axes.set_ylabel("false alarms an hour (open: below, 95 %)")
        axes.set_title(f"{document['feeds']} feeds; limit (attacks found)", loc="left")
        axes.legend(frameon=False)
