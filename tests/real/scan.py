"""What rsenf claims of a folder of videos, and by which evidence.

``python -m tests.real.scan FOLDER`` prints a table; ``--out DIR`` writes a page with a picture of
each file's rows over time; ``--keep DIR`` writes the rows of each file, means over strips in which
no picture is left, with what ``--about`` says of camera and lamp: this is what to contribute.
"""

from __future__ import annotations

import argparse
import html
import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

import rsenf
from rsenf.api.idle import IdleResult
from rsenf.api.recordings import RecordedRows
from rsenf.api.track import TrackResult
from rsenf.errors import InputError, UsageError
from rsenf.idle import METHODS as IDLE_METHODS
from rsenf.rows.settings import AUTO, RowsSettings
from rsenf.track import METHODS as TRACK_METHODS

STRIPS, STEP = 8, 64  # of rows that are kept; steps a level
SHOWN_FRAMES = 120
COLUMNS = ("file", "method", "claims", "evidence", "frames/s")


def table(path: Path, name: str, every_method: bool) -> Iterator[tuple[str, ...]]:
    """Yield a line of the table for each method; one with the reason where nothing can be read."""
    try:
        held = rsenf.read_recording(path, rows=RowsSettings(read_out_axis=AUTO, tile_means=True))
        rate = frame_rate(held)
        idle = list(IDLE_METHODS) if every_method else [None]
        track = list(TRACK_METHODS) if every_method else [None]
        for method in idle:
            yield name, *_of_idle(rsenf.idle(held, method=method)), rate
        for method in track:
            yield name, *_of_track(rsenf.track(held, method=method), method), rate
    except (InputError, UsageError) as exc:
        yield name, "–", "can't be read", str(exc), "–"


def frame_rate(held: RecordedRows) -> str:
    """Tell the rate by the frames' times, and what is said against it."""
    times_s = held.frame_time_s
    if times_s.size < 2:
        return "–"
    rate_hz = (times_s.size - 1) / (times_s[-1] - times_s[0])
    return "; ".join([f"{rate_hz:.3f}", *held.warnings])


def _of_idle(found: IdleResult) -> tuple[str, str, str]:
    name = f"idle {found.method}"
    if found.idle_ratio is None or found.idle_ratio_std is None:
        return name, found.verdict, found.reason or ""
    claim = f"idle {100 * found.idle_ratio:.3f} ± {100 * found.idle_ratio_std:.3f} %"
    told = [f"{found.nominal_hz or math.nan:.0f} Hz grid", found.direction or "direction open"]
    if found.read_out_time_s and found.read_out_time_std_s:
        read_out = 1e3 * np.array([found.read_out_time_s, found.read_out_time_std_s])
        told.append("read-out {:.3f} ± {:.3f} ms".format(*read_out))
    return name, claim, ", ".join(told)


def _of_track(found: TrackResult, method: str | None) -> tuple[str, str, str]:
    name, usable = f"track {method or 'projection'}", found.usable
    if not usable.any():
        return name, "nothing", found.summary
    mean_hz = found.enf_hz[usable].mean()
    mean_std_hz = np.sqrt(np.mean(found.enf_std_hz[usable] ** 2))
    claim = f"ENF {mean_hz:.4f} ± {mean_std_hz:.4f} Hz in {usable.sum()} of {usable.size} s"
    return name, claim, f"SNR {np.median(found.snr_db[usable]):.0f} dB; {found.summary}"


def draw_rows(held: RecordedRows, path: Path) -> None:
    """Draw rows over time, less each row's own mean: bands of mains light are slanted lines."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    level = held.rows[:SHOWN_FRAMES].mean(axis=2)
    mean = np.maximum(level.mean(axis=0), 1.0)
    percent = 100.0 * (level / mean - 1.0)
    percent -= np.median(percent, axis=1, keepdims=True)  # of the whole picture
    most = float(np.percentile(np.abs(percent), 99)) or 1.0
    figure, axis = plt.subplots(figsize=(11, 3), layout="constrained")
    shown = axis.imshow(percent.T, aspect="auto", cmap="gray", vmin=-most, vmax=most)
    axis.set(xlabel="frame", ylabel="row")
    figure.colorbar(shown, label="% of the row's mean")
    figure.savefig(path, dpi=90)
    plt.close(figure)


def keep(path: Path, out: Path, about: str) -> None:
    """Write the rows of a file, (frames, rows, strips), their times, and a few lines about it."""
    rows = RowsSettings(read_out_axis=AUTO, strips=STRIPS, tiles=STRIPS, mask=False)
    held = rsenf.read_recording(path, rows=rows)
    said = "\n".join([about, f"frames/s: {frame_rate(held)}", f"read out: {held.read_out_axis}"])
    level = np.round(held.rows * STEP) / STEP
    np.savez_compressed(out, rows=level, frame_time_s=held.frame_time_s, about=said)


def page(lines: Sequence[tuple[str, ...]], out: Path) -> None:
    """Write the table, and under it the pictures that are there."""
    cells = [
        "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in line) + "</tr>"
        for line in (COLUMNS, *lines)
    ]
    pictures = [
        f"<h2>{html.escape(name)}</h2><img src='{html.escape(name)}.png' alt='rows over frames'>"
        for name in dict.fromkeys(line[0] for line in lines)
        if (out / f"{name}.png").exists()
    ]
    style = "<style>td{border-bottom:1px solid #ccc;padding:2px 8px;vertical-align:top}</style>"
    parts = ["<meta charset='utf-8'>", style, "<table>", *cells, "</table>", *pictures]
    (out / "index.html").write_text("\n".join(parts), encoding="utf-8")


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.real.scan", description=__doc__)
    parser.add_argument("folder", type=Path, help="of videos or .npz, or one of them")
    parser.add_argument("--all-methods", action="store_true", help="not only the default ones")
    parser.add_argument("--out", type=Path, metavar="DIR", help="write a page with pictures")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="write the rows, to contribute")
    parser.add_argument("--about", default="", help="which camera, lamp and grid; who says so")
    asked = parser.parse_args(argv)
    for folder in filter(None, (asked.out, asked.keep)):
        folder.mkdir(parents=True, exist_ok=True)
    paths = [asked.folder] if asked.folder.is_file() else sorted(asked.folder.rglob("*"))
    lines = []
    for path in filter(Path.is_file, paths):
        name = (
            str(path.relative_to(asked.folder)).replace("/", "_") if len(paths) > 1 else path.name
        )
        for line in table(path, name, asked.all_methods):
            lines.append(line)
            print(" | ".join(line), flush=True)
        if lines[-1][1] == "–":
            continue
        if asked.out:
            draw_rows(rsenf.read_recording(path), asked.out / f"{name}.png")
        if asked.keep:
            keep(path, asked.keep / f"{name.removesuffix('.npz')}.npz", asked.about)
    if asked.out:
        page(lines, asked.out)
    if not lines:
        sys.exit(f"no file in {asked.folder}")


if __name__ == "__main__":
    main()
