"""The demo: a simulated clip on a simulated grid, and a graph's results beside the truth."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import Any

import numpy as np

from rsenf.api.shared import Progress, silent
from rsenf.api.simulate import simulate
from rsenf.messages import EnfEstimate, MatchResult, ReferenceBlock, RowBlock
from rsenf.model import CaptureModel, synthetic_grid
from rsenf.record import open_recording
from rsenf.reference import reference_of
from rsenf.report.picture import ThinRows, draw
from rsenf.report.verdict import verdict_json
from rsenf.whole_file import whole_file

REFERENCE_S, STEP_S = 4 * 3600, 1.0
REFERENCE_BEGINS = "2026-01-15T08:00:00"
GRAPH = """\
# The demo's graph: seven processes, one camera. Again: rsenf run {again}
version: 1
site: demo
nodes:
  decode:    {{kind: decode, camera: cam1, input: {clip}}}
  rows:      {{kind: rows, cameras: [cam1]}}
  track:     {{kind: track, cameras: [cam1], track: {{nominal_hz: 50}}}}
  idle:      {{kind: idle, cameras: [cam1], idle: {{nominal_hz: 50}}}}
  reference: {{kind: reference, grid: demo, input: {reference}}}
  match:     {{kind: match, cameras: [cam1], grid: demo}}
  record:    {{kind: record, out: {recording}, overwrite: true}}
"""
FILES = {
    "clip": "clip.mp4",
    "truth": "clip.truth.json",
    "reference": "reference.csv",
    "graph": "graph.yaml",
    "recording": "recording.mcap",
    "picture": "picture.png",
}


def make_clip(
    paths: dict[str, Path], seed: int, duration_s: float, progress: Progress = silent
) -> float:
    """Write a reference, a clip made on its grid, and the truth; return the clip's start in s.

    Parameters
    ----------
    paths : dict of str to Path
        Of the files to write, by the keys of :data:`FILES`.
    seed : int
    duration_s : float
    progress : callable, optional
        Called with the seconds filmed.
    """
    freq_hz = synthetic_grid(seed, REFERENCE_S).freq_hz[: int(REFERENCE_S / STEP_S)]
    begins = np.datetime64(REFERENCE_BEGINS)
    with whole_file(paths["reference"]) as part:
        times = begins + np.arange(freq_hz.size).astype("timedelta64[s]")
        lines = (f"{t}Z,{f:.6f}" for t, f in zip(times, freq_hz, strict=True))
        part.write_text("time,frequency\n" + "\n".join(lines) + "\n", encoding="utf-8")
    start_s = float(np.random.default_rng(seed).uniform(0, REFERENCE_S - duration_s - 1))
    simulate(
        paths["clip"],
        duration_s=duration_s,
        seed=seed,
        model=CaptureModel().changed(size=(640, 480)),
        reference=reference_of(freq_hz, STEP_S, nominal_hz=50.0),
        start_s=start_s,
        progress=progress,
    )
    return start_s


def write_graph(paths: dict[str, Path]) -> None:
    """Write the graph with absolute paths, so that it runs from any folder."""
    quoted = {name: json.dumps(str(path.absolute())) for name, path in paths.items()}
    again = shlex.quote(str(paths["graph"]))
    paths["graph"].write_text(GRAPH.format(again=again, **quoted), encoding="utf-8")


def compare(paths: dict[str, Path], start_s: float) -> dict[str, Any]:
    """Read the recording, draw the picture, and compare the results with the truth.

    Parameters
    ----------
    paths : dict of str to Path
    start_s : float
        Start of the clip in the reference.
    """
    spectrum = ThinRows()
    held: dict[type[Any], list[Any]] = {EnfEstimate: [], MatchResult: [], ReferenceBlock: []}
    for _, message, _ in open_recording(paths["recording"]).messages():
        if message.header.is_end:
            continue
        if isinstance(message, RowBlock):
            spectrum.add(message)
        elif type(message) in held:
            held[type(message)].append(message)
    estimates: list[EnfEstimate] = held[EnfEstimate]
    result: MatchResult = held[MatchResult][-1]
    draw(paths["picture"], spectrum, estimates, held[ReferenceBlock], result)
    truth = json.loads(paths["truth"].read_text(encoding="utf-8"))
    errors = enf_errors_mhz(estimates, truth)
    lag_error_s = result.lag_s - start_s if result.decision == "match" else None
    return {
        **{name: str(path) for name, path in paths.items()},
        "estimates": len(estimates),
        "usable": sum(e.usable for e in estimates),
        "enf_error_rms_mhz": (sum(e * e for e in errors) / len(errors)) ** 0.5 if errors else None,
        "enf_error_max_mhz": max(map(abs, errors), default=None),
        "true_lag_s": start_s,
        "lag_error_s": lag_error_s,
        "right": lag_error_s is not None and abs(lag_error_s) <= 1.0,
        "verdict": verdict_json(result),
    }


def enf_errors_mhz(estimates: list[EnfEstimate], truth: dict[str, Any]) -> list[float]:
    """Estimated ENF less the true mean over the second around the same time, in mHz."""
    # The truth holds means over whole seconds, centred on halves, as projection's estimates are;
    # those of a 20 s window are centred on whole seconds: there, the mean of two is the truth.
    t_s, enf_hz = np.array(truth["t_s"]), np.array(truth["enf_hz"])
    usable = [e for e in estimates if e.usable and t_s[0] <= e.t_s <= t_s[-1]]
    true_hz = np.interp([e.t_s for e in usable], t_s, enf_hz)
    return [1e3 * (e.enf_hz - f) for e, f in zip(usable, true_hz.tolist(), strict=True)]
