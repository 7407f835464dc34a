"""Verbs that film a lamp with the simulator: a clip, and the demo."""

from __future__ import annotations

import argparse
import dataclasses
import inspect
import json
import re
import shlex
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsenf.cli import console, options
from rsenf.cli.options import count, given_by, positive
from rsenf.errors import EXIT_DONE, EXIT_FAILED, UsageError

if TYPE_CHECKING:
    from rsenf.model import CaptureModel, Codec, Effect


SIMULATE = """\
Simulate a rolling-shutter video of a lamp on a grid with a given or random frequency path.

X.truth.json beside the clip has the true values, enough to evaluate any estimator."""


# Parts of the model, whose fields become options; and fields that other options set.
PARTS = {
    "light": "the lamp", "scene": "the scene", "shutter": "the shutter", "sensor": "the sensor",
    "codec": "the encoder",
}  # fmt: skip
OTHERWISE = (
    "profile", "shake.shake_px", "shake.time_constant_s", "frame_rate", "rows", "columns",
    "bitrate_bps", "lossless",
)  # fmt: skip
WIDTH = 100  # of the catalogue
# Commas separate parameters, but not within a list such as at_frames=[10,20].
_COMMA = re.compile(r",(?![^\[]*\])")


def add_simulate(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    from rsenf.model import CATALOGUE, CaptureModel

    model = CaptureModel()

    parser.add_argument(
        "--out", type=Path, required=True, metavar="X",
        help="X.mp4, .mov, .mkv, .avi or .webm for video; X.npz or X.mcap for row means",
    )  # fmt: skip
    what = parser.add_argument_group("the clip")
    what.add_argument("--duration-s", type=positive, default=60.0, metavar="S", help="length (60)")
    what.add_argument("--seed", type=count, default=1, metavar="N", help="of everything random (1)")
    what.add_argument(
        "--strips", type=int, default=1, metavar="N", help="of each row, in row means (1)"
    )
    what.add_argument("--site", default="simulated", metavar="NAME", help="in X.mcap (simulated)")
    what.add_argument("--camera", default="camera", metavar="NAME", help="in X.mcap (camera)")
    grid = parser.add_argument_group("the grid")
    grid.add_argument("--reference", type=Path, metavar="REF", help="measured; drawn otherwise")
    grid.add_argument("--start-s", type=float, default=0.0, metavar="S", help="where on it (0)")
    grid.add_argument("--nominal-hz", type=float, choices=(50.0, 60.0), help="50, or that of REF")
    console.add_reference_arguments(parser, store=False)
    camera = parser.add_argument_group("the capture, over the model file")
    camera.add_argument("--model", type=Path, metavar="FILE", help="YAML; see configs/model")
    camera.add_argument("--size", type=size, metavar="1280x720", help="columns and rows")
    camera.add_argument("--frame-rate", dest="rate", metavar="30000/1001", help="frames a second")
    camera.add_argument("--clock-ppm", type=float, metavar="PPM", help="fast > 0")
    camera.add_argument(
        "--effect", action="append", default=[], metavar="NAME:PARAMETER=VALUE,...",
        help="in place of the model file's own of that name; repeatable: " + ", ".join(CATALOGUE),
    )  # fmt: skip
    camera.add_argument(
        "--effects", action="append", default=[], type=Path, metavar="FILE.py",
        help="adds your own effects to the catalogue; configs/model/my_effect.py is a template",
    )  # fmt: skip
    coding = parser.add_argument_group("the encoder")
    coding.add_argument("--bitrate", type=bits, metavar="150k", help="constant quality otherwise")
    coding.add_argument("--lossless", action="store_true", default=None)
    coding.add_argument(
        "--encodings", type=labels, metavar="lossless,150k,...",
        help="X.lossless.mp4, X.150k.mp4, ... of one and the same clip, filmed once",
    )  # fmt: skip
    for part, heading in PARTS.items():
        kind = type(getattr(model, part))
        options.add_settings(parser, heading, kind, leave_out=OTHERWISE)
    parser.add_argument(
        "--list-effects", action=ListEffects, nargs=0, help="print the catalogue of effects and end"
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print the result as JSON")


def run_simulate(args: argparse.Namespace) -> int:
    """Write the clip and its truth."""
    from rsenf.api.shared import open_references
    from rsenf.api.simulate import simulate
    from rsenf.model import load_effects

    for path in args.effects:
        load_effects(path)
    model = _model_of(args)
    reading = console.read_options(args) | {"nominal_hz": args.nominal_hz}
    references = open_references(args.reference, **reading) if args.reference else None
    for line in references[0].notes if references else ():
        console.note(f"{args.reference}: {line}")
    with console.progress_bar("filming", args.duration_s) as progress:
        made = simulate(
            args.out, duration_s=args.duration_s, seed=args.seed, model=model,
            reference=references, start_s=args.start_s, nominal_hz=args.nominal_hz,
            strips=args.strips, site=args.site, camera=args.camera,
            encodings=_codecs_of(model, args.encodings) if args.encodings else None,
            progress=progress,
        )  # fmt: skip
    console.tell(args, made.to_dict(), made, made.truth["notes"])
    return EXIT_DONE


def _model_of(args: argparse.Namespace) -> CaptureModel:
    """Return the capture model of the file, or the default one, overridden by the options."""
    from rsenf.config.schemas import load_model
    from rsenf.model import CaptureModel

    model = (load_model(args.model) if args.model else CaptureModel()).changed(
        size=args.size, frame_rate=args.rate, clock_ppm=args.clock_ppm, bitrate_bps=args.bitrate,
        lossless=args.lossless,
    )  # fmt: skip
    for name in PARTS:
        part = getattr(model, name)
        given = dataclasses.replace(part, **given_by(args, type(part)))
        model = dataclasses.replace(model, **{name: given})
    return _with_effects(model, args.effect)


def _with_effects(model: CaptureModel, texts: list[str]) -> CaptureModel:
    """Add effects; the first of each name replaces the model file's."""
    from rsenf.model import make_effect

    first_of: set[str] = set()
    for text in texts:
        name, _, given = text.partition(":")
        values = dict(_value(pair, text) for pair in _COMMA.split(given) if pair)
        effect = make_effect(name, values)
        model = (model if name in first_of else model.without(name)).plus(effect)
        first_of.add(name)
    return model


def _value(pair: str, text: str) -> tuple[str, object]:
    """Read ``parameter=value``; values are written as in JSON, plain words without quotes."""
    name, equals, value = pair.partition("=")
    if not (name and equals and value):
        raise UsageError(f"--effect {text}: {pair!r} is not PARAMETER=VALUE")
    try:
        return name, json.loads(value)
    except json.JSONDecodeError:
        return name, value


def _codecs_of(model: CaptureModel, labels: list[str]) -> dict[str, Codec]:
    """Return the encodings by the label in their files' names."""
    return {
        label: dataclasses.replace(model.codec, bitrate_bps=rate, lossless=rate is None)
        for label in labels
        for rate in [None if label == "lossless" else bits(label)]
    }


def size(text: str) -> tuple[int, int]:
    """Argument type: columns x rows.

    >>> size("1280x720")
    (1280, 720)
    """
    columns, _, rows = text.lower().partition("x")
    try:
        return int(columns), int(rows)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a size like 1280x720") from None


def bits(text: str) -> int:
    """Argument type: a bit rate in bit/s.

    >>> bits("150k")
    150000
    """
    factor = {"k": 1_000, "m": 1_000_000}.get(text[-1:].lower(), 1)
    try:
        return round(float(text if factor == 1 else text[:-1]) * factor)
    except (ValueError, OverflowError):
        raise argparse.ArgumentTypeError(f"{text!r} is not a bit rate like 150k or 2M") from None


def labels(text: str) -> list[str]:
    """Argument type: encodings by name."""
    found = [label.strip() for label in text.split(",")]
    for label in found:
        if label != "lossless":
            bits(label)
    return found


class ListEffects(argparse.Action):
    """An option that prints the catalogue of effects and exits."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        """Print all effects, including those of preceding ``--effects`` files."""
        from rsenf.model import CATALOGUE, load_effects

        for path in namespace.effects:
            load_effects(path)
        print("\n\n".join(describe(effect) for effect in CATALOGUE.usable().values()))
        parser.exit()


def describe(effect: type[Effect]) -> str:
    """Return the description of an effect, with its parameters and their plausible ranges."""
    lines = [effect.name, *_wrapped(inspect.getdoc(effect) or "")]
    for f in dataclasses.fields(effect):
        low, high = f.metadata["low"], f.metadata["high"]
        number = isinstance(f.default, int | float) and not isinstance(f.default, bool)
        choices = ", ".join(f.metadata["choices"])
        within = f", {low:g} to {high:g}" if number else f" ({choices})" if choices else ""
        lines.append(f"    {f.name} = {f.default}: {f.metadata['doc']}{within}")
    lines += _wrapped(f"Known from: {effect.source}.")
    others = ", ".join(effect.confused_with) or "nothing known"
    lines += _wrapped(f"Looks like: {others}. Told by: {effect.told_apart_by}.")
    return "\n".join(lines)


def _wrapped(text: str) -> list[str]:
    paragraphs = text.replace("``", "").split("\n\n")
    return [
        line
        for paragraph in paragraphs
        for line in textwrap.wrap(paragraph, WIDTH, initial_indent="  ", subsequent_indent="  ")
    ]


DEMO = """\
Demonstrate rsenf: simulate a clip, run the graph of processes on it, compare with the truth.

Needs no network, camera, display or router. All files stay in --out: the clip and its truth, the
reference, the graph, the MCAP recording and a picture."""


SHORTEST_S, LONGEST_S = 60, 3600


def add_demo(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("--out", type=Path, default=Path("demo"), metavar="DIR", help="(demo)")
    parser.add_argument("--seed", type=count, default=1, metavar="N",
                        help="of the grid, the camera, the time (1)")  # fmt: skip
    parser.add_argument("--duration-s", type=positive, default=90.0, metavar="S",
                        help="of the clip (90)")  # fmt: skip
    parser.add_argument("--json", action="store_true", help="what came out, as JSON")


def run_demo(args: argparse.Namespace) -> int:
    """Run the demo."""
    from rsenf.api.demo import FILES, compare, make_clip, write_graph
    from rsenf.config import load_graph
    from rsenf.run.process import interruptible
    from rsenf.run.supervisor import check_ended, start_graph
    from rsenf.run.view import view_of

    if not SHORTEST_S <= args.duration_s <= LONGEST_S:
        raise UsageError(
            f"--duration-s {args.duration_s:g} suits no demo", f"{SHORTEST_S} to {LONGEST_S}"
        )
    out: Path = args.out
    out.mkdir(parents=True, exist_ok=True)
    paths = {name: out / file for name, file in FILES.items()}
    console.say("1/3 simulating a clip of a wall under a lamp, on a grid of its own")
    with console.progress_bar("filming", args.duration_s) as progress:
        start_s = make_clip(paths, args.seed, args.duration_s, progress)
    write_graph(paths)
    console.say("2/3 running the graph: decode, rows, track, idle, reference, match, record")
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
    console.say("3/3 comparing with the truth")
    summary = compare(paths, start_s)
    if args.json:
        console.print_json(summary)
    else:
        _tell(summary, paths)
    wrong = summary["verdict"]["decision"] == "match" and not summary["right"]
    return EXIT_FAILED if wrong else EXIT_DONE


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
