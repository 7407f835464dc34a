"""The page of a batch: counts, a table that sorts by its headings, and settings.

``SHOWN`` defines the columns of each analysis: values with errors, in customary units.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple
from urllib.parse import quote

from markupsafe import Markup

from rsenf.report.page import Cell, Head, Section, badge, facts, render, table, whole
from rsenf.report.values import with_error

Row = Mapping[str, Any]
Column = tuple[str, Callable[[Row], Cell]]  # a heading, with # before it for numbers, and its cells
UNKNOWN = Cell("")


def _text(heading: str, name: str) -> Column:
    """Return a column of the texts under a key of the row."""

    def cell(row: Row) -> Cell:
        value = row[name]
        shown = "; ".join(value) if isinstance(value, list) else str(value or "").replace("_", " ")
        return Cell(shown, shown or None)

    return heading, cell


def _numbers(heading: str, names: Sequence[str], show: Callable[..., str], scale: float) -> Column:
    """Return a column of the numbers of some keys as one text, sorted by the first, scaled."""

    def cell(row: Row) -> Cell:
        values = [row[name] for name in names]
        return UNKNOWN if values[0] is None else Cell(show(*values), scale * values[0])

    return f"#{heading}", cell


def _figure(
    heading: str, name: str, std: str = "", scale: float = 1.0, *, small: bool = False
) -> Column:
    """Return a column of numbers, times ``scale``, with standard errors of the key ``std``."""

    def show(value: float, error: float | None = None) -> str:
        if error is None:
            return f"{value:.2e}" if small else f"{scale * value:.2f}"
        return f"{value:.2e} ± {error:.1e}" if small else with_error(value, error, scale)

    return _numbers(heading, [name, std] if std else [name], show, scale)


def _between(heading: str, low: str, high: str, scale: float, places: int) -> Column:
    """Return a column of intervals, with the ends that are known."""

    def show(*ends: float | None) -> str:
        return " to ".join(f"{scale * end:.{places}f}" for end in ends if end is not None)

    return _numbers(heading, [low, high], show, scale)


def _file(heading: str, name: str) -> Column:
    """Return a column of links to files beside the page."""
    link = Markup('<a href="{}">open</a>').format
    return heading, lambda row: Cell(link(quote(row[name])), row[name]) if row[name] else UNKNOWN


SHOWN: dict[str, tuple[Column, ...]] = {
    "verify": (
        _text("decision", "decision"),
        ("start (UTC)", lambda row: Cell(whole(t), t) if (t := row["start_utc"]) else UNKNOWN),
        _figure("into the reference (s)", "lag_s", "lag_std_s"),
        _text("grid", "grid"),
        _figure("log10 LR, other times", "log10_lr"),
        _figure("log10 LR, elsewhere", "log10_lr_absent"),
        _text("in words", "verbal"),
        _text("claim", "claim"),
        _figure("camera's clock (ppm)", "clock_ppm", "clock_std_ppm"),
        _figure("usable (s)", "seconds_used"),
    ),
    "idle": (
        _text("verdict", "verdict"),
        _figure("idle (%)", "idle_ratio", "idle_ratio_std", 100.0),
        _between("95 % interval (%)", "idle_ratio_low", "idle_ratio_high", 100.0, 3),
        _figure("read-out (ms)", "read_out_time_s", "read_out_time_std_s", 1e3),
        _text("direction", "direction"),
        _figure("frames/s", "frame_rate_hz"),
        _figure("grid (Hz)", "nominal_hz"),
    ),
    "track": (
        _numbers("usable values", ["usable_values", "values"], "{} of {}".format, 1),
        _figure("mean ENF (Hz)", "enf_mean_hz", "enf_mean_std_hz"),
        _between("from, to (Hz)", "enf_min_hz", "enf_max_hz", 1.0, 4),
        _figure("error of one (mHz)", "enf_std_median_hz", "", 1e3),
        _figure("SNR (dB)", "snr_median_db"),
        _figure("line (Hz)", "line_hz"),
        _figure("frames/s", "frame_rate_hz"),
        _file("values", "enf_file"),
    ),
    "discover": (
        _text("verdict", "verdict"),
        _text("effects", "effects"),
        _figure("gap before", "gap_before", "gap_before_stderr", small=True),
        _figure("gap after", "gap_after", "gap_stderr", small=True),
        _figure("of the model's own data, at most", "gap_limit", small=True),
        _text("unexplained", "unexplained"),
        _file("report", "report"),
    ),
}


def batch_page(analysis: str, rows: Sequence[Row], settings: dict[str, str]) -> str:
    """Return the page of a batch as HTML.

    Parameters
    ----------
    analysis : str
        The verb: a key of ``SHOWN``.
    rows : sequence of mapping
        Rows with all columns of the result table.
    settings : dict of str
        Settings of the analysis, as text.
    """
    counts = Counter(row["status"].replace("_", " ") for row in rows).most_common()
    folder = os.path.commonpath([os.path.dirname(row["path"]) for row in rows])
    head = Head(
        title=f"rsenf batch {analysis}: {len(rows)} recordings",
        kind=f"rsenf batch {analysis}",
        heading=f"{len(rows)} recordings: {', '.join(f'{n} {status}' for status, n in counts)}",
        note=Markup(
            'In <span class="hash">{}</span>. A heading sorts by its column. What is after ± is a '
            "standard error; the same figures in full are in batch.parquet."
        ).format(folder),
    )
    return render(head, SECTIONS, BatchSummary(analysis, rows, settings, folder), sorts=True)


class BatchSummary(NamedTuple):
    """A batch: its verb, rows and settings, and the folder that all recordings are in."""

    analysis: str
    rows: Sequence[Row]
    settings: dict[str, str]
    folder: str


def _recordings(about: BatchSummary) -> list[Markup]:
    columns: list[Column] = [
        ("recording", lambda row: Cell(p := os.path.relpath(row["path"], about.folder), p)),
        ("status", lambda row: Cell(badge(s := row["status"], s.replace("_", " ")), s)),
        *SHOWN[about.analysis],
        _figure("recording (s)", "recording_s"),
        ("remarks", _remarks),
    ]
    cells = ([cell(row) for _, cell in columns] for row in about.rows)
    return [table([heading for heading, _ in columns], cells, sorts=True)]


def _settings(about: BatchSummary) -> list[Markup]:
    versions = sorted({str(row["rsenf_version"] or "") for row in about.rows} - {""})
    pairs = [(name.replace("_", " "), value) for name, value in about.settings.items()]
    return [facts([*pairs, ("rsenf", ", ".join(versions))])]


SECTIONS = (Section("recordings", "", _recordings), Section("settings", "Settings", _settings))


def _remarks(row: Row) -> Cell:
    text = "; ".join(filter(None, [row["reason"], row["loss"], *(row["warnings"] or [])]))
    return Cell(text, text or None)
