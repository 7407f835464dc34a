"""What is claimed of films without mains light, and found in the same scenes under a weak lamp.

``python -m tests.real.films FIRST LAST --out FILE.jsonl`` films the scenes of
:mod:`tests.real.scenes` with these seeds, dark and lit, lets every method of ``track`` and ``idle``
look at the same rows, and appends a line for each film; what has its line already is left out. Then
it tells of these seeds: false claims by method with their 95 % bound, and by the flicker's strength
what is found, and errors over stated ones (z). ``--picture PICTURE.png`` draws both.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import tempfile
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from rsenf.api.recordings import read_recording
from rsenf.flicker.follower import FlickerFollower
from rsenf.flicker.lines import alias_hz
from rsenf.flicker.second import FlickerSecond
from rsenf.idle import METHODS as IDLE_METHODS
from rsenf.idle import IdleSettings, make_idle
from rsenf.messages import EnfEstimate, IdleEstimate, RowBlock
from rsenf.rows.settings import AUTO, RowsSettings
from rsenf.track import METHODS as TRACK_METHODS
from rsenf.track import TrackSettings, make_tracker
from tests.flicker.claims import at_most
from tests.real.scenes import Lamp, draw_scene, film

WINDOW_S = 8.0  # of the methods that have one: the films are hardly longer
WRONG_Z, WRONG_HZ, WRONG_IDLE = 5.0, 0.01, 0.01
STILL_HZ = 1.0  # alias below which ten seconds don't tell flicker from texture
STRENGTHS = (2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 3e-2)
Line = dict[str, Any]


def line_of(seed: int, lit: bool, methods: Sequence[str]) -> Line:
    """Film a scene and let the methods look at it."""
    scene = draw_scene(seed, lit=lit)
    told: Line = {"seed": seed, "lit": lit, "kind": scene.kind, "rate": scene.rate}
    told |= {"coding": scene.coding, "noise": scene.noise, "seconds": round(scene.seconds, 2)}
    if scene.lamp:
        told["flicker_ratio"] = scene.lamp.flicker_ratio
        told["nominal_hz"] = scene.lamp.grid.nominal_hz
        told["idle_ratio"] = scene.lamp.idle_ratio
        light_hz = 2.0 * scene.lamp.grid.nominal_hz
        told["alias_hz"] = abs(alias_hz(light_hz, float(Fraction(scene.rate))))
    with tempfile.TemporaryDirectory() as folder:
        film(scene, path := Path(folder) / "film.mp4")
        rows = RowsSettings(read_out_axis=AUTO, tile_means=True)
        held = read_recording(path, rows=rows)
    if held.rows.size:
        deviation = float(np.sqrt(held.rows.var(axis=0).mean()))
        told["moves_ratio"] = deviation / max(float(held.rows.mean()), 1.0)
    told["said"] = dict(said_of(held.blocks, methods, scene.lamp))
    return told


def said_of(
    blocks: Sequence[RowBlock], methods: Sequence[str], lamp: Lamp | None
) -> Iterator[tuple[str, Line]]:
    """Let the methods look at rows, in which the flicker is followed once."""
    follower = FlickerFollower()
    heard = [*(follower.update(block) for block in blocks), follower.flush()]
    for method in methods:
        known = Followed(follower.origin_ns, deque(heard))
        if method in IDLE_METHODS:
            stage = make_idle(IdleSettings(method), known)
        else:
            stage = make_tracker(TrackSettings(method, window_s=WINDOW_S), known)
        told = [one for block in blocks for one in stage.update(block)] + stage.flush()
        if method in IDLE_METHODS:
            yield method, _idle(told[-1] if told else IdleEstimate(reason="no frame"), lamp)
        else:
            yield method, _enf([one for one in told if one.rank == 0], lamp)


class Followed:
    """A follower of rows that have been followed."""

    def __init__(self, origin_ns: int, heard: deque[list[FlickerSecond]]) -> None:
        self.origin_ns, self._heard = origin_ns, heard

    def update(self, block: RowBlock) -> list[FlickerSecond]:
        """Take the next block; return the seconds that it completed."""
        return self._heard.popleft()

    def flush(self) -> list[FlickerSecond]:
        """Return the seconds that were left."""
        return self._heard.popleft()


def _enf(track: Sequence[EnfEstimate], lamp: Lamp | None) -> Line:
    """What is said of the ENF, and how far off that is."""
    usable = [e for e in track if e.usable]
    told: Line = {"seconds": len(track), "usable": len(usable)}
    if not usable:
        return told | {"reason": track[0].reason if track else "too short"}
    hz = np.array([e.enf_hz for e in usable])
    std_hz = np.sqrt([max(e.enf_var_hz2, 1e-18) for e in usable])
    told |= {"enf_hz": float(hz.mean()), "enf_std_hz": float(std_hz.mean())}
    if lamp:
        turns, at_s = lamp.grid.turns, np.array([e.t_s for e in usable])
        off_hz = hz - (turns(at_s + 0.5) - turns(at_s - 0.5))
        told |= {"rms_hz": _rms(off_hz), "rms_z": _rms(off_hz / std_hz)}
    return told


def _idle(found: IdleEstimate, lamp: Lamp | None) -> Line:
    """What is said of the idle period, and how far off that is."""
    told: Line = {"verdict": found.verdict, "reason": found.reason}
    if found.verdict == "estimated":
        std = max(float(np.sqrt(found.idle_ratio_var)), 1e-9)
        told |= {"idle_ratio": found.idle_ratio, "idle_ratio_std": std}
        if lamp:
            off = found.idle_ratio - lamp.idle_ratio
            told |= {"off": off, "z": off / std}
    return told


def _rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(x))))


def is_claimed(said: Line) -> bool:
    """Whether something is claimed."""
    return bool(said.get("usable") or said.get("verdict") == "estimated")


def is_wrong(said: Line) -> bool:
    """Whether a claim is surely wrong: off by much, and by many of its standard errors."""
    if "rms_hz" in said:
        return bool(said["rms_z"] > WRONG_Z and said["rms_hz"] > WRONG_HZ)
    return bool(abs(said.get("z", 0.0)) > WRONG_Z and abs(said["off"]) > WRONG_IDLE)


def by_method(lines: Sequence[Line]) -> Iterator[tuple[str, list[tuple[Line, Line]]]]:
    """Yield all that each method said, with what of."""
    for method in (*TRACK_METHODS, *IDLE_METHODS):
        if said := [(line, line["said"][method]) for line in lines if method in line["said"]]:
            yield method, said


def summary(lines: Sequence[Line]) -> None:
    """Print what is claimed falsely, and found of flicker that moves from frame to frame."""
    bins = list(itertools.pairwise(STRENGTHS))
    print("found of films by flicker in % (median z); false in dark films (95 % bound)")
    heads = [f"{100 * low:g}–{100 * high:g}" for low, high in bins]
    print(" ".join([f"{'':15s}", *(f"{head:>15s}" for head in heads), "  false"]))
    for method, said in by_method(lines):
        dark = [told for line, told in said if not line["lit"]]
        moving = [s for s in said if s[0]["lit"] and s[0]["alias_hz"] > STILL_HZ]
        cells = []
        for low, high in bins:
            own = [told for line, told in moving if low <= line["flicker_ratio"] < high]
            z = [abs(told.get("rms_z") or told["z"]) for told in own if is_claimed(told)]
            cells.append(f"{len(z)}/{len(own)}" + (f" ({np.median(z):.2f})" if z else ""))
        false = sum(is_claimed(told) for told in dark)
        bound = f"{false} of {len(dark)} ({100 * at_most(false, len(dark)):.2f} %)"
        print(" ".join([f"{method:15s}", *(f"{cell:>15s}" for cell in cells), " ", bound]))
    for method, said in by_method(lines):
        for line, told in said:
            if is_claimed(told) and (not line["lit"] or is_wrong(told)):
                what = f"wrong at {100 * line['flicker_ratio']:.2g} %" if line["lit"] else "false"
                place = f"{line['kind']} {line['seed']}, {line['rate']} frames/s, {line['coding']}"
                print(f"{method} {what}: {place}: {told}")


def picture(lines: Sequence[Line], path: Path) -> None:
    """Draw the share found over the flicker's strength, and of false claims over the motion's."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
    for axis, lit, strength in ((axes[0], True, "flicker_ratio"), (axes[1], False, "moves_ratio")):
        edges = np.array(STRENGTHS) if lit else np.geomspace(1e-4, 1.0, 9)
        for method, said in by_method(lines):
            own = [s for s in said if s[0]["lit"] == lit]
            at = np.array([line.get(strength, 0.0) for line, _ in own])
            claimed = np.array([is_claimed(told) for _, told in own])
            inside = [(at >= a) & (at < b) for a, b in itertools.pairwise(edges)]
            shares = [100 * claimed[i].mean() if i.any() else math.nan for i in inside]
            axis.semilogx(100 * np.sqrt(edges[1:] * edges[:-1]), shares, "o-", label=method)
        axis.set_ylabel("found, % of films" if lit else "false claims, % of films")
        axis.set_ylim(-2, 102 if lit else None)
    axes[0].set_xlabel("flicker, amplitude in % of the light")
    axes[1].set_xlabel("change of the rows, rms in % of the level")
    axes[0].legend(fontsize=8)
    figure.savefig(path, dpi=120)


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.real.films", description=__doc__)
    parser.add_argument("first", type=int)
    parser.add_argument("last", type=int, help="seeds end before this one")
    parser.add_argument("--out", type=Path, required=True, help="file of JSON lines")
    every = (*TRACK_METHODS, *IDLE_METHODS)
    parser.add_argument("--methods", nargs="+", default=every, choices=every)
    parser.add_argument("--only", choices=("dark", "lit"))
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--picture", type=Path)
    asked = parser.parse_args(argv)
    seeds = range(asked.first, asked.last)
    lines = _lines(asked.out)
    done = {(line["seed"], line["lit"], method) for line in lines for method in line["said"]}
    with ProcessPoolExecutor(asked.jobs) as pool, asked.out.open("a") as out:
        running = [
            pool.submit(line_of, seed, lit, left)
            for seed in seeds
            for lit in (False, True)
            if asked.only != ("dark" if lit else "lit")
            if (left := [m for m in asked.methods if (seed, lit, m) not in done])
        ]
        for each in as_completed(running):
            out.write(json.dumps(each.result()) + "\n")
            out.flush()
    lines = [line for line in _lines(asked.out) if line["seed"] in seeds]
    summary(lines)
    if asked.picture:
        picture(lines, asked.picture)


def _lines(path: Path) -> list[Line]:
    held = path.read_text().splitlines() if path.exists() else []
    return [json.loads(line) for line in held]


if __name__ == "__main__":
    main()
