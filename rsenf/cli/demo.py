"""See it work: simulate a clip, run the graph of processes on it, compare with the truth.

Needs no network, camera, display or router. What it makes stays in --out: the clip and its truth,
the reference, the graph, the MCAP recording and a picture.
"""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsenf.messages import EnfEstimate, MatchResult

REFERENCE_S, STEP_S = 4 * 3600, 1.0
SHORTEST_S, LONGEST_S = 60, 3600
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


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    from rsenf.cli.options import count, positive

    parser.add_argument("--out", type=Path, default=Path("demo"), metavar="DIR", help="(demo)")
    parser.add_argument("--seed", type=count, default=1, metavar="N",
                        help="of the grid, the camera, the time (1)")  # fmt: skip
    parser.add_argument("--duration-s", type=positive, default=90.0, metavar="S",
                        help="of the clip (90)")  # fmt: skip
    parser.add_argument("--json", action="store_true", help="what came out, as JSON")


def run(args: argparse.Namespace) -> int:
    """Run the demo."""
    from rsenf.cli.console import print_json, say
    from rsenf.config import load_graph
    from rsenf.errors import EXIT_DONE, EXIT_FAILED, UsageError
    from rsenf.run.signals import interruptible
    from rsenf.run.supervisor import check_ended, start_graph
    from rsenf.run.view import view_of

    if not SHORTEST_S <= args.duration_s <= LONGEST_S:
        raise UsageError(
            f"--duration-s {args.duration_s:g} suits no demo", f"{SHORTEST_S} to {LONGEST_S}"
        )
    out: Path = args.out
    out.mkdir(parents=True, exist_ok=True)
    paths = {
        name: out / file
        for name, file in {
            "clip": "clip.mp4", "truth": "clip.truth.json", "reference": "reference.csv",
            "graph": "graph.yaml", "recording": "recording.mcap", "picture": "picture.png",
        }.items()
    }  # fmt: skip
    say("1/3 simulating a clip of a wall under a lamp, on a grid of its own")
    start_s = _simulate(paths, args.seed, args.duration_s)
    _write_graph(paths)
    say("2/3 running the graph: decode, rows, track, idle, reference, match, record")
    graph = load_graph(paths["graph"])
    with (
        view_of(graph, quiet=args.json) as view,
        start_graph(graph, paths["graph"], view.update) as running,
        interruptible(running.kill) as stop,
    ):
        view.started(running)
        running.wait(stop)
        if stop.is_set():
            raise KeyboardInterrupt
        check_ended(running)
    say("3/3 comparing with the truth")
    summary = _compare(paths, start_s)
    if args.json:
        print_json(summary)
    else:
        _tell(summary, paths)
    wrong = summary["verdict"]["decision"] == "match" and not summary["right"]
    return EXIT_FAILED if wrong else EXIT_DONE


def _write_graph(paths: dict[str, Path]) -> None:
    """Write the graph, with whole paths, so that it runs from any folder."""
    import json

    quoted = {name: json.dumps(str(path.absolute())) for name, path in paths.items()}
    again = shlex.quote(str(paths["graph"]))
    paths["graph"].write_text(GRAPH.format(again=again, **quoted), encoding="utf-8")


def _simulate(paths: dict[str, Path], seed: int, duration_s: float) -> float:
    """Write the reference, the clip hidden in it, and the truth; returns where it is hidden."""
    import json

    import numpy as np

    from rsenf.cli.console import progress_bar
    from rsenf.model import (
        CaptureModel,
        GridPath,
        Shutter,
        render_frames,
        synthetic_grid,
        write_video,
    )
    from rsenf.whole_file import whole_file

    freq_hz = synthetic_grid(seed, REFERENCE_S).freq_hz[: int(REFERENCE_S / STEP_S)]
    begins = np.datetime64(REFERENCE_BEGINS)
    with whole_file(paths["reference"]) as part:
        times = begins + np.arange(freq_hz.size).astype("timedelta64[s]")
        lines = (f"{t}Z,{f:.6f}" for t, f in zip(times, freq_hz, strict=True))
        part.write_text("time,frequency\n" + "\n".join(lines) + "\n", encoding="utf-8")
    start_s = float(np.random.default_rng(seed).uniform(0, REFERENCE_S - duration_s - 1))
    model = CaptureModel(shutter=Shutter(columns=640, rows=480))
    frames = render_frames(model, GridPath(freq_hz, STEP_S, start_s, 50.0), duration_s, seed)
    rate_hz = float(frames.frame_rate)
    with progress_bar("filming", duration_s) as show:
        write_video(paths["clip"], frames, model.codec, lambda done: show(done / rate_hz))
    with whole_file(paths["truth"]) as part:
        part.write_text(json.dumps(frames.truth, indent=1) + "\n", encoding="utf-8")
    return start_s


def _compare(paths: dict[str, Path], start_s: float) -> dict[str, Any]:
    """Read the recording back, draw the picture, and put everything beside the truth."""
    import json

    from rsenf.messages import EnfEstimate, MatchResult, ReferenceBlock, RowBlock
    from rsenf.record import open_recording
    from rsenf.report.picture import draw
    from rsenf.report.spectrum import ThinRows
    from rsenf.report.verdict import verdict_json

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
    verdict = verdict_json(result, list(result.warnings))
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
        "verdict": verdict,
    }


def enf_errors_mhz(estimates: list[EnfEstimate], truth: dict[str, Any]) -> list[float]:
    """Estimated ENF less the true mean over the second around the same time, in mHz."""
    import numpy as np

    # The truth holds means over whole seconds, centred on halves, as projection's estimates are;
    # those of a 20 s window are centred on whole seconds: there, the mean of two is the truth.
    t_s, enf_hz = np.array(truth["t_s"]), np.array(truth["enf_hz"])
    usable = [e for e in estimates if e.usable and t_s[0] <= e.t_s <= t_s[-1]]
    true_hz = np.interp([e.t_s for e in usable], t_s, enf_hz)
    return [1e3 * (e.enf_hz - f) for e, f in zip(usable, true_hz.tolist(), strict=True)]


def _tell(summary: dict[str, Any], paths: dict[str, Path]) -> None:
    verdict = summary["verdict"]
    rms_mhz, worst_mhz = summary["enf_error_rms_mhz"], summary["enf_error_max_mhz"]
    print(
        f"ENF        {summary['usable']} values, one a second; error against the truth "
        f"{rms_mhz:.2f} mHz rms, {worst_mhz:.2f} mHz at most"
        if rms_mhz is not None
        else "ENF        no usable signal"
    )
    if verdict["decision"] == "match":
        print(
            f"Time       {verdict['start_utc']} ± {verdict['lag_std_s']:.2f} s, found among "
            f"{verdict['search_size']} lags; the truth is {summary['lag_error_s']:+.2f} s away"
        )
    else:
        print(f"Time       {verdict['decision']}: {verdict['reason']}")
    clip, reference = (shlex.quote(str(paths[name])) for name in ("clip", "reference"))
    print(f"Recording  {paths['recording']}   (MCAP: opens in Foxglove)")
    print(f"Picture    {paths['picture']}")
    print(f"Next       rsenf verify {clip} --reference {reference}")
