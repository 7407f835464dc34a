"""Benchmarks: every method on the same clips, each clip with its truth.

From a seed to a table, in the order in which a run passes through::

    scenes       which clips are filmed, and what each shows: a wall in a lamp's light, or no ENF
    measure      one clip rendered, encoded, decoded, and judged by every method
    harness      tasks in worker processes, a journal from which a run resumes, the machine
    statistics   groups of rows, medians, confidence bounds
    tables       columns aligned or in Markdown, pictures

A benchmark is a module with a function ``measure``, from a :class:`rsenf.bench.harness.BenchRun`
to a :class:`rsenf.bench.harness.Made`; the rest is the harness's. Here they are by name: what each
one measures, its options, and its module, which is imported when it runs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

from rsenf.bench.harness import BenchRun, Made

Options = Mapping[str, Mapping[str, Any]]

CAMERA = Path("tests/discrepancy/foreign_camera")  # in a checkout


@dataclass(frozen=True)
class Benchmark:
    """A benchmark, and all that its verb needs to know of it."""

    line: str  # what it measures, for the help
    module: str  # of rsenf.bench, with a function `measure`
    # By name: `kind` is count, seconds, words, file or flag; others as argparse has them.
    options: Options = field(default_factory=dict)
    plan: str = ""  # a class of settings whose fields are options too: module:name
    usual: Mapping[str, Any] = field(default_factory=dict)  # other defaults than the plan's
    quick: Mapping[str, Any] = field(default_factory=dict)  # those of a quick run
    also: Mapping[str, str] = field(default_factory=dict)  # another name of an option, by field

    def settings(self) -> type | None:
        """Import the class of settings, if there is one."""
        module, _, name = self.plan.partition(":")
        return getattr(import_module(f"rsenf.bench.{module}"), name) if name else None

    def made(self, run: BenchRun) -> Made:
        """Measure what is missing, and tabulate."""
        made: Made = import_module(f"rsenf.bench.{self.module}").measure(run)
        return made


def _option(kind: str, words: str, **others: Any) -> dict[str, Any]:
    return {"kind": kind, "help": words, **others}


_CLIPS = "scenes:Plan"
_FEW_CLIPS = {"sizes": ("240p",), "frame_rates": ("25", "29.97"), "codings": ("lossless", "50k"),
              "clips": 1, "duration_s": 24.0}  # fmt: skip
_POOL: Options = {"pool-sizes": _option("flag", "all sizes in one cell")}
_FIT: Options = {"fit": _option("file", "make a new one, into a file", metavar="FILE.json")}
_PICTURE: Options = {"picture": _option("file", "draw it", metavar="FILE.png")}
_REPEAT: Options = {"repeat": _option("count", "times each (5)")}
_FILM: Options = {
    "sizes": _option("words", "(all; feeds 1080p)"), "codings": _option("words", "codecs"),
}  # fmt: skip

BENCHMARKS: dict[str, Benchmark] = {
    "idle": Benchmark(
        "idle-period estimators: error, refusals, spread, time, Cramér–Rao bound",
        "clip_tables", _POOL, _CLIPS, quick=_FEW_CLIPS,
    ),
    "enf": Benchmark(
        "ENF estimators, on the same clips: one run serves both tables",
        "clip_tables", _POOL, _CLIPS, quick=_FEW_CLIPS,
    ),
    "claims": Benchmark(
        "scenes with nothing to claim: how often something is claimed",
        "clip_tables", _POOL, _CLIPS, {"clips": 40}, _FEW_CLIPS,  # for each of five scenes
    ),
    "cameras": Benchmark(
        "fleets of 50 cameras with the errors of such clips: which took a recording",
        "cameras_table", {"fleets": _option("count", "drawn from them (20)", default=20)}, _CLIPS,
        {"sizes": ("240p",), "frame_rates": ("23.976", "25", "29.97", "59.94"),
         "codings": ("150k", "100k", "50k"), "clips": 7, "duration_s": 20.0}, _FEW_CLIPS,
    ),
    "recording-time": Benchmark(
        "still and moving films cut into clips, each searched for in a day: decisions true, false "
        "and none, by every matcher",
        "recording_time.table", {}, "recording_time:RecordingPlan", {},
        {"size": "240p", "codings": ("lossless", "50k"), "clips": 1, "duration_s": 65.0,
         "reference_s": 3600.0},
    ),
    "calibration": Benchmark(
        "likelihood ratios of the time of recording: how reliable they are",
        "calibration.table",
        {**_FIT, **_PICTURE, "clips": _option("count", "searches (400)"),
         "real": _option("count", "of real clips made worse (200, where they are there)")},
    ),
    "match": Benchmark(
        "blind searches of a day to ten years of reference: time and memory, beside a loop over "
        "all lags and a plain FFT correlation",
        "match_trial", {**_REPEAT, "duration-s": _option("seconds", "of the clip (600)")},
    ),
    "pipeline": Benchmark(
        "frames a second from the file to the estimate, processor time, memory and latency: in "
        "one process and as a graph, beside ffmpeg's decoder",
        "pipeline.table",
        {**_REPEAT, **_FILM, "duration-s": _option("seconds", "of a film (as the size has it)")},
    ),
    "feeds": Benchmark(
        "live feeds added until this machine can't carry one more",
        "pipeline.feeds",
        {**_FILM, "duration-s": _option("seconds", "of a film (60)"),
         "feeds": _option("count", "from so many on, one by one"),
         "fast": _option("flag", "decode without the codec's loop filter")},
    ),
    "tracker": Benchmark(
        "an hour of video after its frames are decoded: processor time and memory by method, rows "
        "and frame rate; row means beside copying a plane",
        "tracker", {**_REPEAT, "duration-s": _option("seconds", "of each part (30)")},
    ),
    "discover": Benchmark(
        "effects hidden in recordings: found and named rightly, wrongly or not at all; false "
        "alarms; by how much the gap shrinks",
        "discover.table",
        {**_PICTURE,
         "foreign": {"kind": "file", "nargs": "?", "const": CAMERA,
                     "help": "hidden by a camera that is none of rsenf's: its folder or file "
                             f"({CAMERA}); 60 outside and 60 pairs then"}},
        "discover:CasePlan", {},
        {"each": 1, "none": 1, "outside": 1, "pairs": 0, "triples": 0, "duration_s": 27.0,
         "rows": 240, "effects": ("harmonics", "frame_drop", "timestamp_jitter")},
        {"each": "each", "outside": "unknown"},  # the foreign camera's names
    ),
    "foreign": Benchmark(
        "every estimator on a camera that shares nothing with rsenf's own model: errors, whether "
        "the stated ones hold, and claims where there is no mains light",
        "foreign.table",
        {"camera": _option("file", f"its folder or file ({CAMERA})", default=CAMERA),
         "methods": _option("words", "of ENF and idle period (all)", default=())},
        "foreign:EstimatorPlan", {}, {"raw": 2, "coded": 0, "nothing": 1, "duration_s": 24.0},
    ),
    "live": Benchmark(
        "honest feeds and looped, spliced, delayed or exchanged ones: how soon the live verdict "
        "tells, and how often falsely, beside a sliding correlation",
        "live.table", _FIT, "live:LivePlan", {}, {"clips": 9, "duration_s": 180.0},
    ),
}  # fmt: skip
